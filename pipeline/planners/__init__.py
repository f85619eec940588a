"""Planners over any adherence method and any sampler."""

from pipeline.planners.base import Clock, Planner, PlanResult, PlanStatus, Query, Termination, path_length
from pipeline.planners.dynamic_domain import DynamicDomainRrtConnect
from pipeline.planners.fmt import FmtStar
from pipeline.planners.rrt import Rrt
from pipeline.planners.rrtconnect import RrtConnect
from pipeline.planners.shortcut import shortcut

PLANNERS = {
    "fmt": FmtStar,
    "rrt": Rrt,
    "rrtconnect": RrtConnect,
    "rrtconnect_dynamic_domain": DynamicDomainRrtConnect,
}

__all__ = [
    "PLANNERS",
    "Clock",
    "DynamicDomainRrtConnect",
    "FmtStar",
    "PlanResult",
    "PlanStatus",
    "Planner",
    "Query",
    "Rrt",
    "RrtConnect",
    "Termination",
    "path_length",
    "shortcut",
]
