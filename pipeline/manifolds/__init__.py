"""Constraint adherence: projection, atlas and tangent bundle; and free space, where there is no constraint."""

from typing import Any

from pipeline.constraints import Constraint, Unconstrained
from pipeline.manifolds.atlas import Atlas, AtlasParameters, Chart
from pipeline.manifolds.base import Adherence, AdherenceParameters, Counters, Refined, Stop, Traversal
from pipeline.manifolds.continuation import AtlasAdherence, TangentBundleAdherence
from pipeline.manifolds.deadline import Deadline, OutOfTime
from pipeline.manifolds.free import FreeSpace
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
    """Return the adherence method of a choice; free space, with its parameters, where there is no constraint.

    Raises:
        ConfigError: an unknown kind or parameters that do not fit it.
    """
    parameters = choice.make(ADHERENCES, "adherence")
    made = FreeSpace if isinstance(constraint, Unconstrained) else _CLASSES[choice.kind]
    adherence: Adherence = made(constraint, validity, parameters)
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
    "FreeSpace",
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
