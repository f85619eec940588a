"""Scene and problem generators, one module per environment of the papers; demonstrations in `oracle`."""

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
from pipeline.environments.sphere import BANDS, BLOCKS, Band, SphereEnvironment, fibonacci_sphere

ENVIRONMENTS = {"sphere": SphereEnvironment}

__all__ = [
    "BANDS",
    "BLOCKS",
    "ENVIRONMENTS",
    "Band",
    "Environment",
    "Scene",
    "SphereEnvironment",
    "Split",
    "fibonacci_sphere",
    "flatten",
    "pick",
    "read_problems",
    "read_scenes",
    "unflatten",
    "validity",
    "write_problems",
    "write_scenes",
]
