"""Planners over any adherence method and any sampler."""

from pipeline.planners.base import Clock, Planner, PlanResult, PlanStatus, Problem, Termination, path_length

__all__ = ["Clock", "PlanResult", "PlanStatus", "Planner", "Problem", "Termination", "path_length"]
