"""Planners over any adherence method and any sampler."""

from pipeline.planners.base import Clock, Planner, PlanResult, PlanStatus, Problem, Termination, path_length
from pipeline.planners.fmt import FmtStar
from pipeline.planners.rrt import Rrt
from pipeline.planners.rrtconnect import RrtConnect
from pipeline.planners.shortcut import shortcut

PLANNERS = {"fmt": FmtStar, "rrt": Rrt, "rrtconnect": RrtConnect}

__all__ = [
    "PLANNERS",
    "Clock",
    "FmtStar",
    "PlanResult",
    "PlanStatus",
    "Planner",
    "Problem",
    "Rrt",
    "RrtConnect",
    "Termination",
    "path_length",
    "shortcut",
]
