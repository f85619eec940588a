"""Several configurations of a robot asked at once against a tree of obstacles.

One query costs coal less than Python the calling of it. Copies of the moving bodies, placed together and held in one
tree, make it one call for many configurations (`reports/performance.md` has what that saves).
"""

import coal
import numpy as np
import pinocchio as pin

from pipeline.robots.order import place_variables


class Flock:
    """Copies of a robot's moving bodies, one for each configuration that is asked.

    Args:
        model: kinematics; every joint has one degree of freedom.
        bodies: those that move.
        copies: how many. Many answer no faster, and what pinocchio keeps of a model grows with the cube of its joints.
    """

    def __init__(self, model: pin.Model, bodies: pin.GeometryModel, copies: int) -> None:
        self._model, self._bodies = pin.Model(), pin.GeometryModel()
        for copy in range(copies):
            joints = {0: 0}
            for joint in range(1, model.njoints):
                parent, place = joints[model.parents[joint]], model.jointPlacements[joint]
                joints[joint] = self._model.addJoint(parent, model.joints[joint], place, f"{model.names[joint]} {copy}")
            for body in bodies.geometryObjects:
                parent = joints[body.parentJoint]
                copied = pin.GeometryObject(f"{body.name} {copy}", parent, body.placement, body.geometry)
                self._bodies.addGeometryObject(copied)
        places = list(model.idx_qs)[1:]
        place_variables(self._model, [copy * model.nq + place for copy in range(copies) for place in places])
        self._data, self._placed = self._model.createData(), self._bodies.createData()
        self._manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(self._model, self._bodies, self._placed)
        self._tree = self._manager.getManager()

    def meet(
        self,
        Q: np.ndarray,
        obstacles: coal.DynamicAABBTreeCollisionManager,
        callback: coal.CollisionCallBackDefault,
    ) -> np.ndarray:
        """Tell of sets of as many configurations as there are copies (e, m, n) whether one meets an obstacle (e,)."""
        place, update, collide = pin.updateGeometryPlacements, self._manager.update, self._tree.collide
        model, data, bodies, placed = self._model, self._data, self._bodies, self._placed
        struck = callback.data.result.isCollision
        met = []
        for flat in Q.reshape(len(Q), model.nq):
            place(model, data, bodies, placed, flat)
            update(False)
            collide(obstacles, callback)  # forgets what it met before
            met.append(struck())
        return np.array(met, bool)
