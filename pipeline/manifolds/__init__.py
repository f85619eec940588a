"""Constraint adherence: projection, atlas and tangent bundle."""

from typing import Any

from pipeline.constraints import Constraint
from pipeline.manifolds.atlas import Atlas, AtlasParameters, Chart
from pipeline.manifolds.base import Adherence, AdherenceParameters, Counters, Refined, Stop, Traversal
from pipeline.manifolds.continuation import AtlasAdherence, TangentBundleAdherence
from pipeline.manifolds.deadline import Deadline, OutOfTime
from pipeline.manifolds.polyline import subdivided
from pipeline.manifolds.projection import ProjectionAdherence
from pipeline.manifolds.waypoints import dense, joined
from pipeline.robots import Validity
from pipeline.schema import Choice

ADHERENCES: dict[str, Any] = {  # their parameters by kind
    "projection": AdherenceParameters,
    "atlas": AtlasParameters,
    "tangent_bundle": AtlasParameters,
}
_CLASSES: dict[str, Any] = {
    "projection": ProjectionAdherence,
    "atlas": AtlasAdherence,
    "tangent_bundle": TangentBundleAdherence,
}


def make_adherence(choice: Choice, constraint: Constraint, validity: Validity) -> Adherence:
    """Return the adherence method of a choice.

    Raises:
        ConfigError: an unknown kind or parameters that do not fit it.
    """
    parameters = choice.make(ADHERENCES, "adherence")
    adherence: Adherence = _CLASSES[choice.kind](constraint, validity, parameters)
    return adherence


__all__ = [
    "ADHERENCES",
    "Adherence",
    "AdherenceParameters",
    "Atlas",
    "AtlasAdherence",
    "AtlasParameters",
    "Chart",
    "Counters",
    "Deadline",
    "OutOfTime",
    "ProjectionAdherence",
    "Refined",
    "Stop",
    "TangentBundleAdherence",
    "Traversal",
    "dense",
    "joined",
    "make_adherence",
    "subdivided",
]
