"""Constraint adherence: projection, atlas and tangent bundle."""

from pipeline.manifolds.atlas import Atlas, AtlasParameters, Chart
from pipeline.manifolds.base import Adherence, AdherenceParameters, Counters, Refined, Stop, Traversal
from pipeline.manifolds.continuation import AtlasAdherence, TangentBundleAdherence
from pipeline.manifolds.projection import ProjectionAdherence

__all__ = [
    "Adherence",
    "AdherenceParameters",
    "Atlas",
    "AtlasAdherence",
    "AtlasParameters",
    "Chart",
    "Counters",
    "ProjectionAdherence",
    "Refined",
    "Stop",
    "TangentBundleAdherence",
    "Traversal",
]
