"""Constraints and checkers as a user of OMPL writes them: pinocchio and numpy, pinocchio for collisions.

Peers of ours in the benchmark only. They share no code with `Constraint` and `Validity`, so they check them as well.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pipeline.robots import Obstacle, Robot
from pipeline.spec.statement import Joined, Level, OnPlane, OnTorus, Pinned
from pipeline.tasks import Task


class OrdinaryConstraint:
    """What a task's constraint says, row by row in numpy.

    Args:
        task: whose constraint it stands in for.
    """

    def __init__(self, task: Task) -> None:
        self.n, self.tolerance = task.robot.dimension, task.constraint.tolerance
        self.max_iterations = task.constraint.max_iterations
        self._model, self._data = task.robot.model, task.robot.model.createData()
        self._parts = [_PARTS[type(saying)](task.robot, saying) for saying in task.equations]
        self.k = sum(part.k for part in self._parts)

    def value(self, q: np.ndarray) -> np.ndarray:
        """Return F(q) (k,) [m, rad]."""
        pin.forwardKinematics(self._model, self._data, q)
        return np.concatenate([part.value(self._model, self._data, q) for part in self._parts])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return dF/dq (k, n)."""
        pin.computeJointJacobians(self._model, self._data, q)
        return np.concatenate([part.jacobian(self._model, self._data, q) for part in self._parts])


class _Level:
    """The tilt of an axis: its length is the angle [rad]; the derivative is right to first order in the tilt."""

    k = 2

    def __init__(self, robot: Robot, says: Level) -> None:
        self._frame, self._held = robot.frame_id(says.frame), np.array(says.axis)
        wanted = np.array(says.direction)
        self._wanted = wanted / np.linalg.norm(wanted)
        self._across = np.linalg.svd(self._wanted[None])[2][1:]  # (2, 3), perpendicular to the direction

    def value(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        axis = pin.updateFramePlacement(model, data, self._frame).rotation @ self._held
        sines = self._across @ axis
        sine = np.linalg.norm(sines)
        return sines * (np.arctan2(sine, self._wanted @ axis) / sine if sine > 1e-12 else 1.0)

    def jacobian(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        J = pin.getFrameJacobian(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)[3:]  # (3, n)
        axis = pin.updateFramePlacement(model, data, self._frame).rotation @ self._held
        sine = np.linalg.norm(self._across @ axis)
        scale = np.linalg.norm(self.value(model, data, q)) / sine if sine > 1e-12 else 1.0
        return scale * self._across @ -pin.skew(axis) @ J


class _Joined:
    """The logarithm of the error of a relative pose."""

    k = 6

    def __init__(self, robot: Robot, says: Joined) -> None:
        self._frame, self._other = robot.frame_id(says.frame), robot.frame_id(says.other)
        self._relative = says.relative.se3()

    def _error(self, model: pin.Model, data: pin.Data) -> pin.SE3:
        first = pin.SE3(pin.updateFramePlacement(model, data, self._frame))
        return (first * self._relative).actInv(pin.updateFramePlacement(model, data, self._other))

    def value(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        return np.array(pin.log6(self._error(model, data)).vector)

    def jacobian(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        E = self._error(model, data)
        J_frame = pin.getFrameJacobian(model, data, self._frame, pin.LOCAL)
        J_other = pin.getFrameJacobian(model, data, self._other, pin.LOCAL)
        return pin.Jlog6(E) @ (J_other - (self._relative * E).inverse().action @ J_frame)


class _Pinned:
    """Where a frame is, less where it shall be [m]."""

    k = 3

    def __init__(self, robot: Robot, says: Pinned) -> None:
        self._frame, self._point = robot.frame_id(says.frame), np.array(says.point)

    def value(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        return pin.updateFramePlacement(model, data, self._frame).translation - self._point

    def jacobian(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        return np.array(pin.getFrameJacobian(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)[:3])


class _OnPlane:
    """How far a frame is along a vector, less how far it shall be [m]."""

    k = 1

    def __init__(self, robot: Robot, says: OnPlane) -> None:
        self._frame, self._normal, self._distance = robot.frame_id(says.frame), np.array(says.normal), says.distance

    def value(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        at = pin.updateFramePlacement(model, data, self._frame).translation
        return np.array([self._normal @ at - self._distance])

    def jacobian(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        return self._normal[None] @ pin.getFrameJacobian(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)[:3]


class _OnTorus:
    """The distance from a circle less the tube's radius [m]; q is the point."""

    k = 1

    def __init__(self, robot: Robot, says: OnTorus) -> None:
        self._major, self._minor = says.major, says.minor

    def value(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        return np.array([np.hypot(np.hypot(q[0], q[1]) - self._major, q[2]) - self._minor])

    def jacobian(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        around = np.hypot(q[0], q[1])
        ring = around - self._major
        return np.array([[q[0] / around * ring, q[1] / around * ring, q[2]]]) / np.hypot(ring, q[2])


_PARTS: dict[type, Any] = {Level: _Level, Joined: _Joined, Pinned: _Pinned, OnPlane: _OnPlane, OnTorus: _OnTorus}


class OrdinaryValidity:
    """All pairs of robot and obstacles by `pinocchio.computeCollisions`; other conditions are asked as they are.

    Who may touch whom, and how deep, is the task's.
    """

    def __init__(self, task: Task) -> None:
        robot, validity = task.robot, task.validity()
        self._conditions = validity.conditions
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry = robot.geometry.copy()
        _furnish(self._geometry, task.obstacles)
        self._placed = self._geometry.createData()
        depths = {frozenset((pair.first, pair.second)): pair.depth for pair in validity.pairs() if pair.depth}
        names = [*robot.body_names, *(obstacle.name for obstacle in task.obstacles)]
        for pair, request in zip(self._geometry.collisionPairs, self._placed.collisionRequests, strict=True):
            request.security_margin = -depths.get(frozenset((names[pair.first], names[pair.second])), 0.0)

    def free(self, q: np.ndarray) -> bool:
        """True when no pair collides at q (n,) and the conditions hold."""
        if not all(condition.holds(q) for condition in self._conditions):
            return False
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._placed, q, True)


def _furnish(geometry: pin.GeometryModel, obstacles: Sequence[Obstacle]) -> None:
    """Add obstacles, and their pairs with the bodies that move."""
    moving = [i for i, body in enumerate(geometry.geometryObjects) if body.parentJoint]
    for number, obstacle in enumerate(obstacles):
        placement = pin.SE3(obstacle.rotation, np.array(obstacle.position))
        added = geometry.addGeometryObject(pin.GeometryObject(f"obstacle {number}", 0, placement, obstacle.geometry()))
        for i in moving:
            geometry.addCollisionPair(pin.CollisionPair(i, added))
