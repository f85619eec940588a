"""Learning: one engine that trains any model, and a folder for each model with its networks, training and sampler.

Training is imported from `pipeline.learning.engine` and the models' recipes, so that planning does not wait for
Lightning.
"""
