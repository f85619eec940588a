"""Inverse kinematics on a manifold: configurations that meet a constraint and put a frame or joints somewhere."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints import Compiled, Constraint, TaskSpaceRegion
from pipeline.robots import Robot
from pipeline.robots.symbolic import constant, rotation_vector

_ITERATIONS = 60  # from a random start; what has not converged by then has met a limit
_DAMPING = 1e-6  # of J J^T: rows of target and constraint may say the same thing twice
_LONGEST = 0.5  # of a step [rad or m]: the linearisation holds no farther
_TARGET_TOLERANCE = 1e-3  # of the target's rows [m and rad]
_NOISE = 0.2  # of the first starts near a known configuration; grows with the tries [rad or m]


@dataclass(frozen=True)
class Target:
    """Rows that are 0 where a target is met.

    Attributes:
        rows: as an expression of q (n,) and parameters (m,).
        parameters: how many there are.
        draw: returns parameters (m,), anew at every try.
    """

    rows: Callable[[ca.SX, ca.SX], ca.SX]
    parameters: int
    draw: Callable[[np.random.Generator], np.ndarray]


def at_pose(robot: Robot, frame: str, wanted: pin.SE3) -> Target:
    """The frame is at a pose in the world."""

    def rows(q: ca.SX, _: ca.SX) -> ca.SX:
        E = constant(wanted.inverse()) @ robot.symbolic_pose(q, frame)
        return ca.vertcat(E.position, rotation_vector(E.rotation))

    return Target(rows, 0, lambda rng: np.empty(0))


def in_region(robot: Robot, frame: str, region: TaskSpaceRegion) -> Target:
    """The frame is at random coordinates within the region's bounds; free dimensions ask for nothing."""
    asked = [i for i, free in enumerate(region.free) if not free]
    # A position that is bounded on one side only is drawn from the metre or radian within the bound.
    low = [
        max(region.lower[i], region.upper[i] - 1.0) if region.lower[i] == -np.inf else region.lower[i] for i in asked
    ]
    high = [begin + 1.0 if region.upper[i] == np.inf else region.upper[i] for i, begin in zip(asked, low, strict=True)]

    def rows(q: ca.SX, wanted: ca.SX) -> ca.SX:
        d = region.symbolic_coordinates(robot.symbolic_pose(q, frame))
        off = [d[i] - wanted[k] for k, i in enumerate(asked)]
        return ca.vertcat(*(ca.atan2(ca.sin(o), ca.cos(o)) if i >= 3 else o for i, o in zip(asked, off, strict=True)))

    return Target(rows, len(asked), lambda rng: rng.uniform(low, high))


def with_values(robot: Robot, values: Sequence[tuple[int, float]]) -> Target:
    """Joints, given by their index, have values [rad or m]."""
    return Target(lambda q, _: ca.vertcat(*(q[i] - value for i, value in values)), 0, lambda rng: np.empty(0))


class InverseKinematics:
    """Finds configurations within limits that meet a constraint and a target.

    Damped Gauss-Newton from random starts, with joints held at their limits. Constraint and target may overlap (an
    upright hand at an upright pose).
    """

    def __init__(self, robot: Robot, constraint: Constraint, target: Target) -> None:
        q, t = ca.SX.sym("q", robot.dimension), ca.SX.sym("t", target.parameters)
        rows = ca.vertcat(constraint.function(q), target.rows(q, t))
        jacobian = ca.densify(ca.jacobian(rows, q))
        self._rows = Compiled(ca.Function("rows", [q, t], [ca.densify(rows), jacobian.T]))
        self.robot, self.constraint, self.target = robot, constraint, target

    def solve(self, start: np.ndarray, parameters: np.ndarray) -> np.ndarray | None:
        """Return a configuration (n,) on the manifold, found from `start`; None without convergence."""
        robot, k, q = self.robot, self.constraint.k, np.array(start, float)
        for _ in range(_ITERATIONS):
            F, JT = self._rows(q, parameters)
            J = JT.reshape(len(F), -1)
            if np.linalg.norm(F[:k]) < self.constraint.tolerance / 2 and np.linalg.norm(F[k:]) < _TARGET_TOLERANCE:
                return q
            step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(len(F)), F)
            size = float(np.linalg.norm(step))
            q = np.clip(q + step * min(1.0, _LONGEST / max(size, 1e-12)), robot.lower, robot.upper)
        return None

    def solutions(self, rng: np.random.Generator, tries: int, near: np.ndarray | None = None) -> Iterator[np.ndarray]:
        """Yield configurations (n,); every other try starts near `near`, at first exactly there, the rest anywhere."""
        for i in range(tries):
            start = rng.uniform(self.robot.lower, self.robot.upper)
            if near is not None and i % 2 == 0:
                start = near + _NOISE * min(i / 10, 3.0) * rng.normal(size=len(near))
            found = self.solve(start, self.target.draw(rng))
            if found is not None:
                yield found
