"""The robot's moving bodies against each other and against what stands, by pinocchio's broad phase and coal.

pinocchio's own call updates every body and obstacle at every configuration and tries all with all. What stands need not
be moved: the bodies that joints move have a manager of their own, everything else one that is filled once. Pairs that
are switched off, margins and verdicts are pinocchio's (`reports/performance.md` has what a check costs).
"""

from collections.abc import Sequence
from copy import copy

import coal
import numpy as np
import pinocchio as pin

_place = pin.updateGeometryPlacements
_ASKEW = pin.rpy.rpyToMatrix(0.5, 0.6, 0.7)  # no axis of a file is along one of a frame turned by it


class BroadPhase:
    """Asks the collision pairs of a geometry model in which at least one body moves.

    Args:
        model: kinematics.
        geometry: bodies, those that stand included, and the pairs to ask.
        margins: least distance of each pair (P,) [m]; below 0, how deep two primitives or hulls may be in each other.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, margins: Sequence[float]) -> None:
        bodies = [_with_volume(body) for body in geometry.geometryObjects]
        order = sorted(range(len(bodies)), key=lambda i: not bodies[i].parentJoint)  # those that move first
        place = {body: i for i, body in enumerate(order)}
        self._moving = sum(1 for body in bodies if body.parentJoint)
        pairs = [sorted((place[pair.first], place[pair.second])) for pair in geometry.collisionPairs]
        # Pairs that both models have come first, with the same numbers.
        self._order = sorted(range(len(pairs)), key=lambda pair: pairs[pair][1] >= self._moving)
        self._asked = [pairs[pair] for pair in self._order]
        self._own = sum(second < self._moving for _, second in self._asked)  # pairs of which both bodies move
        self._still = [i for i, (first, _) in enumerate(self._asked) if first >= self._moving]  # of which none does
        self._model = model
        self._all, self._mobile = pin.GeometryModel(), pin.GeometryModel()
        for i, body in enumerate(order):
            self._all.addGeometryObject(bodies[body])
            if i < self._moving:
                self._mobile.addGeometryObject(bodies[body])
        for first, second in self._asked:
            self._all.addCollisionPair(pin.CollisionPair(first, second))
            if second < self._moving:
                self._mobile.addCollisionPair(pin.CollisionPair(first, second))
        self._watch(margins)

    def widened(self, margins: Sequence[float]) -> "BroadPhase":
        """Return the same pairs with other margins (P,) [m]."""
        other = copy(self)
        other._watch(margins)
        return other

    def _watch(self, margins: Sequence[float]) -> None:
        """Make placements and managers for margins (P,) [m]."""
        model, moving = self._model, self._moving
        sorted_margins = [float(margins[pair]) for pair in self._order]
        self._data, self._placed = model.createData(), self._all.createData()
        for request, margin in zip(self._placed.collisionRequests, sorted_margins, strict=True):
            request.security_margin = margin
        pin.updateGeometryPlacements(model, self._data, self._all, self._placed, pin.neutral(model))
        # Both managers take placements and requests from the same data: what moves has the same numbers in both models.
        self._standing = pin.BroadPhaseManager_NaiveCollisionManager(model, self._all, self._placed)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(model, self._mobile, self._placed)
        for manager in (self._standing, self._manager):
            manager.update(True)
        self._objects = self._standing.getManager().getObjects()
        self._others = coal.NaiveCollisionManager()
        # Bodies that may touch have a margin below 0: their boxes stay as they are.
        reach = max([0.0, *sorted_margins[self._own :]])
        for i in range(moving, len(self._objects)):
            self._objects[i].getAABB().expand(reach)  # a box must meet what its shape keeps a margin from
            self._others.registerObject(self._objects[i])
        # Bound once: looking them up costs a tenth of a query.
        self._update, self._collide = self._manager.update, self._manager.getManager().collide
        self._callback = pin.CollisionCallBackDefault(self._all, self._placed, True)
        self._stuck = any(map(self._touch, self._still))

    def collides(self, q: np.ndarray) -> bool:
        """True when a pair is nearer than its margin at q (n,)."""
        if self._stuck:
            return True
        _place(self._model, self._data, self._all, self._placed, q)
        self._update(False)
        callback = self._callback
        self._collide(self._others, callback)  # forgets what it met before
        if callback.collision:
            return True
        self._collide(callback)
        return bool(callback.collision)

    def _touch(self, pair: int) -> bool:
        """Tell whether a pair of bodies that both stand is nearer than its margin."""
        return bool(pin.computeCollision(self._all, self._placed, pair))


def _with_volume(body: pin.GeometryObject) -> pin.GeometryObject:
    """Return a body, or the same one in a frame of its own that is turned: pinocchio's managers leave out flat boxes.

    A mesh that is flat along an axis of its frame (a sheet, a wall of two triangles) has a box without volume there.
    """
    mesh = body.geometry
    mesh.computeLocalAABB()
    if mesh.aabb_local.volume() > 0 or not isinstance(mesh, coal.BVHModelBase):
        return body
    vertices = np.array(mesh.vertices()).reshape(-1, 3) @ _ASKEW  # rows: turned by the inverse
    turned = coal.BVHModelOBBRSS()
    turned.beginModel(mesh.num_tris, len(vertices))
    for i in range(mesh.num_tris):
        corners = mesh.tri_indices(i)
        turned.addTriangle(*(vertices[corners[k]] for k in range(3)))
    turned.endModel()
    placement = body.placement * pin.SE3(_ASKEW, np.zeros(3))
    return pin.GeometryObject(body.name, body.parentJoint, body.parentFrame, placement, turned)
