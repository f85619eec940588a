"""Inverse kinematics on a manifold: configurations that meet a constraint and put a frame or joints somewhere."""

import time
from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints.base import Constraint
from pipeline.constraints.regions import TaskSpaceRegion
from pipeline.constraints.structure import Expressions, structure_of
from pipeline.constraints.turns import turns_on
from pipeline.robots import Numbers, Robot
from pipeline.robots.symbolic import rotation_vector

_ITERATIONS = 60  # from a random start; what has not converged by then has met a limit
_DAMPING = 1e-6  # of J J^T: rows of target and constraint may say the same thing twice
_LONGEST = 0.5  # of a step [rad or m]: the linearisation holds no farther
_TARGET_TOLERANCE = 1e-3  # of the target's rows [m and rad]
_NOISE = 0.2  # of the first starts near a known configuration; grows with the tries [rad or m]


# Rows that are 0 where a target is met, as an expression of q (n,) that takes numbers as arguments.
Target = Callable[[ca.SX, Numbers], ca.SX]


def at_pose(robot: Robot, frame: str, wanted: pin.SE3) -> Target:
    """The frame is at a pose in the world."""

    def rows(q: ca.SX, p: Numbers) -> ca.SX:
        E = p.pose(wanted.inverse()) @ robot.symbolic_pose(q, frame, p)
        return ca.vertcat(E.position, rotation_vector(E.rotation))

    return rows


def in_region(robot: Robot, frame: str, region: TaskSpaceRegion) -> Target:
    """The frame is within the region's bounds: rows are how far outside it is, and 0 all over the inside."""

    def rows(q: ca.SX, p: Numbers) -> ca.SX:
        # A little inside, so that what is met within the tolerance is within the bounds.
        return region.symbolic_outside(robot.symbolic_pose(q, frame, p), p, inset=_TARGET_TOLERANCE)

    return rows


def with_values(values: Sequence[tuple[int, float]]) -> Target:
    """Joints, given by their index, have values [rad or m]."""
    return lambda q, p: ca.vertcat(*(q[i] - p(value) for i, value in values))


class InverseKinematics:
    """Finds configurations within limits that meet a constraint and a target.

    Damped Gauss-Newton from random starts, with joints held at their limits. Constraint and target may overlap (an
    upright hand at an upright pose).
    """

    def __init__(self, robot: Robot, constraint: Constraint, target: Target) -> None:
        q, p = ca.SX.sym("q", robot.dimension), Numbers()
        rows = ca.vertcat(constraint.rows(q, p), target(q, p))
        structure = structure_of(q, rows, p.symbols, "the target")

        def make() -> Expressions:
            F, J = structure.rows_and_jacobian(q)
            return Expressions([q], [F, J.T])

        self._rows = structure.compiled(("rows",), make, p.values)
        self.robot, self.constraint, self.turns = robot, constraint, turns_on(constraint, robot)
        self.tried = 0  # by `solutions`
        self.nearest: tuple[float, float] | None = None  # of all tries: ||rows|| of the target, and of the constraint

    def solve(self, start: np.ndarray) -> np.ndarray | None:
        """Return a configuration (n,) on the manifold, found from `start`; None without convergence."""
        robot, k = self.robot, self.constraint.k
        q = np.clip(start, robot.lower, robot.upper)
        for _ in range(_ITERATIONS):
            F, JT = self._rows(q)
            J = JT.reshape(len(F), -1)
            if np.linalg.norm(F[:k]) < self.constraint.tolerance / 2 and np.linalg.norm(F[k:]) < _TARGET_TOLERANCE:
                return q
            self._remember(float(np.linalg.norm(F[k:])), float(np.linalg.norm(F[:k])))
            try:
                step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(len(F)), F)
            except np.linalg.LinAlgError:
                return None
            size = float(np.linalg.norm(step))
            q = np.clip(q + step * min(1.0, _LONGEST / max(size, 1e-12)), robot.lower, robot.upper)
        return None

    def _remember(self, target: float, constraint: float) -> None:
        """Keep how near a try came, for messages: to the target, among configurations about on the manifold."""
        if self.nearest is None or max(target, constraint) < max(self.nearest):
            self.nearest = target, constraint

    def solutions(
        self,
        rng: np.random.Generator,
        tries: int,
        near: np.ndarray | None = None,
        patience: int | None = None,
        until: float = np.inf,
    ) -> Iterator[np.ndarray]:
        """Yield configurations (n,); every other try starts near `near`, at first exactly there, the rest anywhere.

        Ends after `tries` tries, `patience` in a row that arrive nowhere, or, from the second try on, at a time `until`
        by time.perf_counter() [s]; `tried` counts them.
        """
        self.tried = failed = 0
        for i in range(tries):
            if failed == patience or (i and time.perf_counter() >= until):
                return
            self.tried = i + 1
            start = rng.uniform(*self.robot.box)
            if near is not None and i % 2 == 0:
                start = near + _NOISE * min(i / 10, 3.0) * rng.normal(size=len(near))
            found = self.solve(start)
            failed = failed + 1 if found is None else 0
            if found is not None:
                yield found if self.turns is None else self.turns.canonical(found)
