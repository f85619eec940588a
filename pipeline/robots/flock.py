"""Several configurations of a robot asked at once against a tree of obstacles.

One query costs coal less than Python the calling of it. Copies of the moving bodies, placed together and held in one
tree, make it one call for sixteen configurations (`reports/performance.md` has what that saves).
"""

import coal
import numpy as np
import pinocchio as pin

_COPIES = 16


class Flock:
    """Copies of a robot's moving bodies, one for each configuration that is asked.

    Args:
        model: kinematics; every joint has one degree of freedom.
        bodies: those that move.
    """

    def __init__(self, model: pin.Model, bodies: pin.GeometryModel) -> None:
        self._model, self._bodies = pin.Model(), pin.GeometryModel()
        for copy in range(_COPIES):
            joints = {0: 0}
            for joint in range(1, model.njoints):
                parent, place = joints[model.parents[joint]], model.jointPlacements[joint]
                joints[joint] = self._model.addJoint(parent, model.joints[joint], place, f"{model.names[joint]} {copy}")
            for body in bodies.geometryObjects:
                parent = joints[body.parentJoint]
                copied = pin.GeometryObject(f"{body.name} {copy}", parent, body.placement, body.geometry)
                self._bodies.addGeometryObject(copied)
        self._data, self._placed = self._model.createData(), self._bodies.createData()
        self._manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(self._model, self._bodies, self._placed)
        self._tree = self._manager.getManager()
        self._q = np.empty((_COPIES, model.nq))
        self._flat = self._q.reshape(-1)  # the same memory

    def collide(
        self,
        Q: np.ndarray,
        obstacles: coal.DynamicAABBTreeCollisionManager,
        callback: coal.CollisionCallBackDefault,
    ) -> bool:
        """Tell whether the robot meets one of the obstacles at a row of Q (m, n); the callback must be fresh."""
        for first in range(0, len(Q), _COPIES):
            rows = Q[first : first + _COPIES]
            self._q[: len(rows)], self._q[len(rows) :] = rows, rows[-1]
            pin.updateGeometryPlacements(self._model, self._data, self._bodies, self._placed, self._flat)
            self._manager.update(False)
            self._tree.collide(obstacles, callback)
            if callback.data.result.isCollision():
                return True
        return False
