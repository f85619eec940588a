"""Learning: CoMPNetX's networks, their data, their file and their use at planning time.

Training is imported from `pipeline.learning.training`, so that planning does not wait for Lightning.
"""

from pipeline.learning.batches import TrainingData
from pipeline.learning.inference import CompnetxNetwork, Products
from pipeline.learning.model import Model, Normalisation, load_model, save_model
from pipeline.learning.networks import NetworkParameters
from pipeline.learning.pairs import Pairs, demonstration_pairs, split_by_scene

__all__ = [
    "CompnetxNetwork",
    "Model",
    "NetworkParameters",
    "Normalisation",
    "Pairs",
    "Products",
    "TrainingData",
    "demonstration_pairs",
    "load_model",
    "save_model",
    "split_by_scene",
]
