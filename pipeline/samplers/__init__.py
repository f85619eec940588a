"""Samplers: one protocol, any planner. Learned ones are in `compnetx`, all by name in `choices`."""

from pipeline.samplers.base import Asked, Sampler
from pipeline.samplers.combined import Mixture, Queue, Then
from pipeline.samplers.uniform import UniformSampler

__all__ = ["Asked", "Mixture", "Queue", "Sampler", "Then", "UniformSampler"]
