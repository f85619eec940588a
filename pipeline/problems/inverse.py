"""Inverse kinematics on a manifold: configurations that meet a constraint and bring a frame to a pose."""

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints import Compiled, Constraint
from pipeline.robots import Robot
from pipeline.robots.symbolic import Pose, rotation_vector

_ITERATIONS = 60  # from a random start; what has not converged by then has met a limit
_DAMPING = 1e-6  # of J J^T: rows of pose and constraint may say the same thing twice
_LONGEST = 0.5  # of a step [rad or m]: the linearisation holds no farther
_POSE_TOLERANCE = 1e-3  # of the frame's pose [m and rad]


class InverseKinematics:
    """Finds configurations within limits at which a frame is at a pose and a constraint holds.

    Damped Gauss-Newton from random starts, with joints held at their limits. Constraint and pose may overlap (an
    upright hand at an upright pose).

    Args:
        robot: with the constraint's variables.
        constraint: to be met.
        frame: to be brought to poses.
    """

    def __init__(self, robot: Robot, constraint: Constraint, frame: str) -> None:
        q, R, p = ca.SX.sym("q", robot.dimension), ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)
        E = Pose(R, p).inverse() @ robot.symbolic_pose(q, frame)
        rows = ca.vertcat(constraint.function(q), E.position, rotation_vector(E.rotation))
        jacobian = ca.densify(ca.jacobian(rows, q))
        self._rows = Compiled(ca.Function("rows", [q, R, p], [ca.densify(rows), jacobian.T]))
        self.robot, self.constraint, self.k = robot, constraint, constraint.k

    def solve(self, target: pin.SE3, start: np.ndarray) -> np.ndarray | None:
        """Return a configuration (n,) from `start`, exactly on the manifold; None without convergence."""
        robot, q = self.robot, np.array(start, float)
        for _ in range(_ITERATIONS):
            F, J = self._evaluate(q, target)
            if (
                np.linalg.norm(F[: self.k]) < self.constraint.tolerance
                and np.linalg.norm(F[self.k :]) < _POSE_TOLERANCE
            ):
                return q
            step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(len(F)), F)
            size = float(np.linalg.norm(step))
            q = np.clip(q + step * min(1.0, _LONGEST / max(size, 1e-12)), robot.lower, robot.upper)
        return None

    def _evaluate(self, q: np.ndarray, target: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        # A matrix argument's array has its columns as rows: see `Compiled`.
        F, J = self._rows(q, target.rotation.T, target.translation)
        return F, J.reshape(len(F), -1)

    def solutions(
        self, draw: Callable[[], pin.SE3], rng: np.random.Generator, tries: int, near: np.ndarray | None = None
    ) -> Iterator[np.ndarray]:
        """Yield configurations (n,) for poses drawn anew at every try, the first from `near` when it is given."""
        for i in range(tries):
            start = near if i == 0 and near is not None else rng.uniform(self.robot.lower, self.robot.upper)
            found = self.solve(draw(), start)
            if found is not None:
                yield found
