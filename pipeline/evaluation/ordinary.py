"""Upright transport as a user of OMPL writes it: pinocchio and numpy for the constraint, pinocchio for collisions.

Peers of ours in the benchmark only. It shares no code with `Constraint` and `Validity`, so it checks them as well.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pipeline.robots import Obstacle, Robot


class OrdinaryUpright:
    """The tool's z axis keeps a direction of the world: two rows by numpy."""

    k = 2

    def __init__(self, robot: Robot, direction: Sequence[float], tolerance: float, max_iterations: int) -> None:
        self.n, self.tolerance, self.max_iterations = robot.dimension, tolerance, max_iterations
        self._model, self._data, self._frame = robot.model, robot.model.createData(), robot.frame_id(robot.tool)
        wanted = np.asarray(direction, float)
        self._wanted = wanted / np.linalg.norm(wanted)
        _, _, V = np.linalg.svd(self._wanted[None])
        self._across = V[1:]  # (2, 3), perpendicular to the direction

    def value(self, q: np.ndarray) -> np.ndarray:
        """Return the tilt (2,) [rad]: its length is the angle."""
        pin.forwardKinematics(self._model, self._data, q)
        axis = pin.updateFramePlacement(self._model, self._data, self._frame).rotation[:, 2]
        sines = self._across @ axis
        sine = np.linalg.norm(sines)
        return sines * (np.arctan2(sine, self._wanted @ axis) / sine if sine > 1e-12 else 1.0)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return its derivative (2, n), to first order in the tilt."""
        J = pin.computeFrameJacobian(self._model, self._data, q, self._frame, pin.LOCAL_WORLD_ALIGNED)[3:]  # (3, n)
        axis = self._data.oMf[self._frame].rotation[:, 2]
        F = self.value(q)
        sine = np.linalg.norm(self._across @ axis)
        scale = np.linalg.norm(F) / sine if sine > 1e-12 else 1.0
        return scale * self._across @ -pin.skew(axis) @ J


class OrdinaryValidity:
    """All pairs of robot and obstacles by `pinocchio.computeCollisions`."""

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle]) -> None:
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry = robot.geometry.copy()
        moving = [i for i, body in enumerate(self._geometry.geometryObjects) if body.parentJoint]
        for number, obstacle in enumerate(obstacles):
            placement = pin.SE3(obstacle.rotation, np.array(obstacle.position))
            added = self._geometry.addGeometryObject(
                pin.GeometryObject(f"obstacle {number}", 0, placement, obstacle.geometry())
            )
            for i in moving:
                self._geometry.addCollisionPair(pin.CollisionPair(i, added))
        self._placed = self._geometry.createData()

    def free(self, q: np.ndarray) -> bool:
        """True when no pair collides at q (n,)."""
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._placed, q, True)
