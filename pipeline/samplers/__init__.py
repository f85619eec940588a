"""Samplers: one protocol, any planner. Learned ones are in `compnetx`, all by name in `choices`."""

from pipeline.samplers.base import Sampler
from pipeline.samplers.uniform import UniformSampler

__all__ = ["Sampler", "UniformSampler"]
