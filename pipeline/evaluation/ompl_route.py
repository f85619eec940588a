"""Routes through OMPL's planners, with our constraint and checker or with those that its users write."""

from dataclasses import dataclass, replace

from pipeline.evaluation.ordinary import OrdinaryConstraint, OrdinaryValidity
from pipeline.evaluation.routes import Case, Route
from pipeline.manifolds import joined
from pipeline.planners import PlanResult, Termination
from pipeline.planners.ompl_adapter import OmplPlanner


@dataclass
class Ompl(Route):
    """One of OMPL's planners; its states are joined on the manifold outside of the time."""

    planner: OmplPlanner

    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; see `Route`."""
        problem = self.manifold.problem(case)
        result = self.planner.plan(problem, termination, seed)
        return replace(result, path=joined(problem.adherence, result.path)) if result.solved else result


class OrdinaryOmpl(Ompl):
    """The same with constraint and checker as users write them."""

    uncounted = ("collision_checks",)  # ours would count, and is not asked

    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; see `Route`."""
        self.planner.stand_ins = OrdinaryConstraint(case.task), OrdinaryValidity(case.task)
        return super().plan(case, termination, seed)
