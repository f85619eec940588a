"""Scene and problem generators, one module per environment of the papers; demonstrations in `oracle`."""

from pipeline.environments.base import Environment
from pipeline.environments.sphere import BANDS, BLOCKS, Band, SphereEnvironment, fibonacci_sphere

ENVIRONMENTS = {"sphere": SphereEnvironment}

__all__ = [
    "BANDS",
    "BLOCKS",
    "ENVIRONMENTS",
    "Band",
    "Environment",
    "SphereEnvironment",
    "fibonacci_sphere",
]
