"""Implicit constraints F(q) = 0, each one CasADi expression, conditions g(q) >= 0, and target sets."""

from pipeline.constraints.balance import balanced, feet_on_ground
from pipeline.constraints.base import Constraint, Projection
from pipeline.constraints.compiled import Compiled
from pipeline.constraints.conditions import Condition
from pipeline.constraints.cone import cone
from pipeline.constraints.couplings import following
from pipeline.constraints.feasibility import feasible
from pipeline.constraints.free import Unconstrained
from pipeline.constraints.poses import closed_chain, height, intersection, line, plane, pose, position, upright
from pipeline.constraints.regions import Chain, TaskSpaceRegion, chain
from pipeline.constraints.sphere import sphere_constraint
from pipeline.constraints.structure import Expressions, Structure, structure_of
from pipeline.constraints.turns import turns_on

__all__ = [
    "Chain",
    "Compiled",
    "Condition",
    "Constraint",
    "Expressions",
    "Projection",
    "Structure",
    "TaskSpaceRegion",
    "Unconstrained",
    "balanced",
    "chain",
    "closed_chain",
    "cone",
    "feasible",
    "feet_on_ground",
    "following",
    "height",
    "intersection",
    "line",
    "plane",
    "pose",
    "position",
    "sphere_constraint",
    "structure_of",
    "turns_on",
    "upright",
]
