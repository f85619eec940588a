"""Samplers: one protocol, any planner."""

from pipeline.samplers.base import Sampler
from pipeline.samplers.uniform import UniformSampler

__all__ = ["Sampler", "UniformSampler"]
