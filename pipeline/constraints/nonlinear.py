"""The best configuration of a target set: a nonlinear program, solved by IPOPT."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from pipeline.constraints.base import Constraint
from pipeline.constraints.conditions import Condition
from pipeline.constraints.ipopt import Ipopt
from pipeline.constraints.structure import structure_of
from pipeline.constraints.targets import TARGET_TOLERANCE, Target, TargetSet
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot

_SLACK = 0.98  # an equation may use this share of its tolerance: IPOPT meets rows to some 1e-8 only

# What is to be least: an expression of q (n,), of the guess (n,) that a solve begins with, and of numbers.
Objective = Callable[[ca.SX, ca.SX, Numbers], ca.SX]


def nearness(q: ca.SX, guess: ca.SX, numbers: Numbers) -> ca.SX:
    """The squared joint distance from the guess."""
    del numbers
    return ca.sumsqr(q - guess)


class NonlinearProgram(TargetSet):
    """Finds the configuration of a target set at which an objective is least, among those around a guess.

    Joint limits, intervals and conditions are bounds, which it may lie on. Equations have slack within the tolerance,
    the square of which is added to the objective, 1 for all of it. A solve takes 5 to 25 ms for an arm, ten times as
    long as one of `InverseKinematics`; of a robot with 41 joints it arrives from nearly anywhere, which that does not.

    Args:
        robot, constraints, target, conditions: see `TargetSet`.
        objective: what is to be least. Joints that turn are measured as they stand, without wrapping around.

    Raises:
        ConstraintError: also for an objective that is no single number, or depends on other symbols.
    """

    inset = 1e-6  # a condition on its bound holds, though IPOPT meets rows to some 1e-8 [m and rad]

    def __init__(
        self,
        robot: Robot,
        constraints: Constraint | Sequence[Constraint],
        target: Target | None = None,
        conditions: Sequence[Condition] = (),
        objective: Objective = nearness,
    ) -> None:
        super().__init__(robot, constraints, target, conditions)
        n, p = robot.dimension, Numbers()
        q, guess = ca.SX.sym("q", n), ca.SX.sym("guess", n)
        within, least = self._within(q, p), ca.SX(objective(q, guess, p))
        if least.numel() != 1:
            raise ConstraintError(f"an objective has {least.numel()} values; it must be a single number")
        structure = structure_of(q, ca.vertcat(least, within.values), ca.vertcat(guess, p.symbols), "the program")
        self._ipopt = structure.kept("ipopt", lambda: Ipopt(structure))
        self._numbers, self._lower, self._upper = p.values, within.lower, within.upper
        counts = np.array([*(constraint.k for constraint in self.constraints), len(self._lower) - self._ends[-1]])
        most = np.repeat([*(constraint.tolerance / 2 for constraint in self.constraints), TARGET_TOLERANCE], counts)
        slack = _SLACK * most * (self._lower == self._upper)  # (m,), 0 for intervals
        # Where an objective outweighs slack, each row takes all it gets: the second time all may do so together.
        self._slack = slack, slack / np.sqrt(np.repeat(counts, counts))

    def solve(self, guess: np.ndarray, until: float = np.inf) -> np.ndarray | None:
        """See `TargetSet`; None where IPOPT does not arrive at a local minimum that is in the set.

        What is returned is within the limits to the bit, and all that is asked is judged there.
        """
        limits, bounds = (self.robot.lower, self.robot.upper), (self._lower, self._upper)
        begin, numbers = self._begun(guess), np.concatenate([guess, self._numbers])
        for slack in self._slack:
            found = self._ipopt(begin, numbers, limits, bounds, slack, until)
            met = self._met(found.rows - np.clip(found.rows, *bounds))
            if not found.optimal:
                return None
            if met:
                return found.q if all(condition.holds(found.q) for condition in self.conditions) else None
        return None
