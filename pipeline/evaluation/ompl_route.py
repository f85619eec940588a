"""Routes through OMPL's planners."""

from dataclasses import dataclass, replace

from pipeline.evaluation.ordinary import OrdinaryConstraint, OrdinaryValidity
from pipeline.evaluation.routes import Case, Route
from pipeline.manifolds import joined
from pipeline.planners import PlanResult, Termination
from pipeline.planners.ompl_adapter import OmplPlanner


@dataclass
class Ompl(Route):
    """One of OMPL's planners; its states are joined on the manifold outside of the time.

    Attributes:
        planner: OMPL's.
        ordinary: whether constraint and checker are as users write them; collision checks are ours, not asked then.
    """

    planner: OmplPlanner
    ordinary: bool = False

    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; see `Route`."""
        if self.ordinary:
            self.planner.stand_ins = OrdinaryConstraint(case.task), OrdinaryValidity(case.task)
            self.uncounted = ("collision_checks",)
        problem = self.manifold.problem(case)
        result = self.planner.plan(problem, termination, seed)
        return replace(result, path=joined(problem.adherence, result.path)) if result.solved else result
