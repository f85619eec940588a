"""Scene and problem generators, one module per environment of the papers."""

from pipeline.environments.base import (
    Environment,
    Scene,
    Split,
    flatten,
    pick,
    read_problems,
    read_scenes,
    unflatten,
    validity,
    write_problems,
    write_scenes,
)
from pipeline.environments.oracle import Oracle, demonstrate, shards
from pipeline.environments.sphere import BANDS, BLOCKS, Band, SphereEnvironment, fibonacci_sphere

ENVIRONMENTS = {"sphere": SphereEnvironment}

__all__ = [
    "BANDS",
    "BLOCKS",
    "ENVIRONMENTS",
    "Band",
    "Environment",
    "Oracle",
    "Scene",
    "SphereEnvironment",
    "Split",
    "demonstrate",
    "fibonacci_sphere",
    "flatten",
    "pick",
    "read_problems",
    "read_scenes",
    "shards",
    "unflatten",
    "validity",
    "write_problems",
    "write_scenes",
]
