"""A crowd of obstacles in a tree of coal's, and a robot's moving bodies in another one."""

from collections.abc import Sequence
from copy import copy

import coal
import numpy as np
import pinocchio as pin

from pipeline.robots.flock import Flock
from pipeline.robots.scene import Scene

FLOCK = 16  # most configurations that one query answers for


class Crowd:
    """Asks whether moving bodies come nearer than a margin to one of many obstacles.

    Args:
        scene: bodies and obstacles.
        obstacles: numbers of those in the crowd.
        margin: least distance [m].
    """

    def __init__(self, scene: Scene, obstacles: Sequence[int], margin: float) -> None:
        self._scene, self._obstacles = scene, list(obstacles)
        self._model, self._data = scene.robot.model, scene.robot.model.createData()
        self._moving = pin.GeometryModel()
        for body in scene.geometry().geometryObjects:
            if body.parentJoint:
                self._moving.addGeometryObject(body)
        self._moving_data = self._moving.createData()
        # Tree against tree: coal cannot query its naive manager against a tree (it crashes).
        self._manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._moving, self._moving_data
        )
        self._bodies = self._manager.getManager()
        self._flocks: dict[int, Flock] = {}  # by the number of copies
        self._fill(margin)

    def widened(self, margin: float) -> "Crowd":
        """Return the same with another margin [m]. Both move the same bodies: they are asked one after the other."""
        other = copy(self)
        other._fill(margin)
        return other

    def _fill(self, margin: float) -> None:
        scene = self._scene
        self._objects = []
        for number in self._obstacles:
            shape, R, p = scene.obstacle_shapes[number].shape, scene.rotations[number], scene.positions[number]
            self._objects.append(coal.CollisionObject(shape, R, p))
            self._objects[-1].computeAABB()
            self._objects[-1].getAABB().expand(margin)  # coal applies a margin to shapes only, not to its trees' boxes
        self._tree = coal.DynamicAABBTreeCollisionManager()
        self._tree.registerObjects(self._objects)  # together: one after the other the tree gets worse
        self._tree.setup()
        self._callback = coal.CollisionCallBackDefault()
        self._callback.data.request.security_margin = margin
        # Of the last query; reaching it through the callback costs 0.35 us.
        self._met = self._callback.data.result.isCollision

    def strikes(self, q: np.ndarray) -> bool:
        """Tell whether a body meets the crowd at q (n,)."""
        pin.updateGeometryPlacements(self._model, self._data, self._moving, self._moving_data, q)
        self._manager.update(False)
        self._bodies.collide(self._tree, self._callback)  # forgets what it met before
        return self._met()

    def struck_rows(self, Q: np.ndarray) -> np.ndarray:
        """Tell for rows of Q (m, n) whether a body meets the crowd (m,); nothing is looked up twice."""
        place, update, collide = pin.updateGeometryPlacements, self._manager.update, self._bodies.collide
        model, data, bodies, placed = self._model, self._data, self._moving, self._moving_data
        tree, callback, met = self._tree, self._callback, self._met
        found = []
        for q in Q:
            place(model, data, bodies, placed, q)
            update(False)
            collide(tree, callback)
            found.append(met())
        return np.array(found, bool)

    def struck_sets(self, Q: np.ndarray) -> np.ndarray:
        """Tell for sets of at most FLOCK configurations (e, m, n) whether one meets the crowd (e,)."""
        return self.flock(Q.shape[1]).meet(Q, self._tree, self._callback)

    def flock(self, copies: int) -> Flock:
        """Return the copies of the bodies that are asked at once; made once and kept."""
        if copies not in self._flocks:
            self._flocks[copies] = Flock(self._model, self._moving, copies)
        return self._flocks[copies]
