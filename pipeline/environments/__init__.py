"""Scene and problem generators: the sphere of the papers, and families of tasks."""

from pipeline.environments.base import Environment
from pipeline.environments.of_family import FamilyEnvironment
from pipeline.environments.sphere import BANDS, BLOCKS, Band, SphereEnvironment, fibonacci_sphere

ENVIRONMENTS = {"sphere": SphereEnvironment, "family": FamilyEnvironment}

__all__ = [
    "BANDS",
    "BLOCKS",
    "ENVIRONMENTS",
    "Band",
    "Environment",
    "FamilyEnvironment",
    "SphereEnvironment",
    "fibonacci_sphere",
]
