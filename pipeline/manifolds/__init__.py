"""Constraint adherence: projection, atlas and tangent bundle."""

from pipeline.manifolds.base import Adherence, AdherenceParameters, Counters, Refined, Stop, Traversal
from pipeline.manifolds.projection import ProjectionAdherence

__all__ = [
    "Adherence",
    "AdherenceParameters",
    "Counters",
    "ProjectionAdherence",
    "Refined",
    "Stop",
    "Traversal",
]
