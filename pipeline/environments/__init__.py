"""Scene and problem generators: the sphere of the papers, families of tasks, and a user's own problem files."""

from pipeline.environments.base import Environment
from pipeline.environments.of_family import FamilyEnvironment
from pipeline.environments.of_folder import FolderEnvironment
from pipeline.environments.sphere import BANDS, BLOCKS, Band, SphereEnvironment, fibonacci_sphere

ENVIRONMENTS = {"sphere": SphereEnvironment, "family": FamilyEnvironment, "folder": FolderEnvironment}

__all__ = [
    "BANDS",
    "BLOCKS",
    "ENVIRONMENTS",
    "Band",
    "Environment",
    "FamilyEnvironment",
    "FolderEnvironment",
    "SphereEnvironment",
    "fibonacci_sphere",
]
