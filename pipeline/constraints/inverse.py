"""Inverse kinematics on a manifold: configurations that meet a constraint and put a frame or joints somewhere."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from pipeline.constraints.base import Constraint
from pipeline.constraints.conditions import Condition
from pipeline.constraints.structure import Expressions, structure_of
from pipeline.constraints.targets import TARGET_TOLERANCE, Target, TargetSet
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot

_ITERATIONS = 60  # from a random start; what has not converged by then has met a limit
_DAMPING = 1e-6  # of J J^T: rows of target and constraint may say the same thing twice
_LONGEST = 0.5  # of a step [rad or m]: the linearisation holds no farther


class InverseKinematics(TargetSet):
    """Finds configurations of a target set by damped Gauss-Newton steps, with joints held at their limits.

    Any configuration of the set will do; `NonlinearProgram` finds the best one near by. See `TargetSet`.

    Raises:
        ConstraintError: also where nothing is asked.
    """

    inset = TARGET_TOLERANCE

    def __init__(
        self,
        robot: Robot,
        constraints: Constraint | Sequence[Constraint],
        target: Target | None = None,
        conditions: Sequence[Condition] = (),
    ) -> None:
        super().__init__(robot, constraints, target, conditions)
        q, p = ca.SX.sym("q", robot.dimension), Numbers()
        rows = self._within(q, p).outside(p)
        if not rows.numel():
            raise ConstraintError(f"nothing is asked of {robot.name!r}: all of its configurations will do")
        structure = structure_of(q, rows, p.symbols, "the target")

        def make() -> Expressions:
            F, J = structure.rows_and_jacobian(q)
            return Expressions([q], [F, J.T])

        self._rows = structure.compiled(("rows",), make, p.values)

    def solve(self, guess: np.ndarray, until: float = np.inf) -> np.ndarray | None:
        """See `TargetSet`; None without convergence. Takes milliseconds, and does not look at the time."""
        del until
        robot, q = self.robot, self._begun(guess)
        for _ in range(_ITERATIONS):
            F, JT = self._rows(q)
            J = JT.reshape(len(F), -1)
            if self._met(F):
                return q
            try:
                step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(len(F)), F)
            except np.linalg.LinAlgError:
                return None
            size = float(np.linalg.norm(step))
            q = np.clip(q + step * min(1.0, _LONGEST / max(size, 1e-12)), robot.lower, robot.upper)
        return None
