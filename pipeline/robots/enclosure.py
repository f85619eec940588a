"""Bodies that are wholly inside closed meshes, where surfaces alone say that nothing is in contact."""

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin

from pipeline.robots.broadphase import BroadPhase
from pipeline.robots.scene import Scene
from pipeline.robots.shapes import BodyShape
from pipeline.robots.solids import Solid

_FLAT = 1e-9  # half extent of a box around what is flat [m]


class Enclosures:
    """The pairs of a scene in which one body can be wholly inside the other's mesh.

    Asked where surfaces do not meet: then each connected part of a body is inside a mesh, or outside, as any point of
    it is. Boxes around the bodies are asked first, by coal.

    Args:
        scene: bodies and obstacles.
        pairs: (container, content), as numbers of bodies and then of obstacles; see `enclosing_pairs`.
    """

    def __init__(self, scene: Scene, pairs: Sequence[tuple[int, int]]) -> None:
        shapes = [*scene.body_shapes, *scene.obstacle_shapes]
        used = sorted({body for pair in pairs for body in pair})
        place = {body: row for row, body in enumerate(used)}
        container, self._content = np.array([[place[body] for body in pair] for pair in pairs]).T
        self._container = container
        self._model, self._data = scene.robot.model, scene.robot.model.createData()
        whole = scene.geometry(range(len(scene.obstacle_shapes)))
        self._bodies, boxes = pin.GeometryModel(), pin.GeometryModel()
        for body in used:
            given, (middle, half) = whole.geometryObjects[body], shapes[body].box
            self._bodies.addGeometryObject(given)
            around, box = given.placement * pin.SE3(np.eye(3), middle), coal.Box(*(2 * np.maximum(half, _FLAT)))
            boxes.addGeometryObject(pin.GeometryObject(given.name, given.parentJoint, around, box))
        for first, second in sorted({tuple(sorted((place[a], place[b]))) for a, b in pairs}):
            boxes.addCollisionPair(pin.CollisionPair(first, second))
        self._placed = self._bodies.createData()
        self._boxes = BroadPhase(self._model, boxes, [0.0] * len(boxes.collisionPairs))
        self._solids: dict[int, Solid] = {}
        for row in set(container.tolist()):
            inside = shapes[used[row]].inside
            if inside is not None:
                self._solids[row] = inside
        self._points = [shapes[body].points for body in used]
        self._kernel = np.array([shapes[body].kernel[0] for body in used])
        boxes_of = [shapes[used[row]].box for row in container]
        inner = np.array([shapes[used[row]].kernel[1] for row in self._content])
        # Of a shape in several parts each may be inside: the ball in the first says nothing of the others.
        inner[[len(self._points[row]) > 1 for row in self._content]] = -np.inf
        self._middle = np.array([middle for middle, _ in boxes_of])  # (P, 3)
        self._room = np.array([half for _, half in boxes_of]) - inner[:, None]  # for the middle of that ball (P, 3)

    def any(self, q: np.ndarray) -> bool:
        """Tell whether a body is wholly inside a mesh at q (n,), of those whose surfaces do not meet."""
        if not self._boxes.collides(q):
            return False
        pin.updateGeometryPlacements(self._model, self._data, self._bodies, self._placed, q)
        R = np.array([M.rotation for M in self._placed.oMg])  # (B, 3, 3)
        p = np.array([M.translation for M in self._placed.oMg])
        a, b = self._container, self._content
        kernel = np.einsum("bij,bj->bi", R, self._kernel) + p
        local = np.einsum("pji,pj->pi", R[a], kernel[b] - p[a])  # (P, 3) in the frame of the container
        near = (np.abs(local - self._middle) <= self._room).all(axis=1)
        for row in np.unique(a[near]).tolist():
            points = np.concatenate([self._points[body] @ R[body].T + p[body] for body in b[near & (a == row)]])
            if self._solids[row].contains((points - p[row]) @ R[row]).any():
                return True
        return False


def enclosing_pairs(scene: Scene) -> list[tuple[int, int]]:
    """Return the pairs (container, content) of what is held against each other in which the content may be inside.

    As numbers of bodies and then of obstacles; none where coal takes all shapes for what they are.
    """
    shapes = [*scene.body_shapes, *scene.obstacle_shapes]
    if all(shape.inside is None for shape in shapes):
        return []
    found, count = [], len(scene.bodies)
    for pair in scene.pairs():
        first, second = pair.body, pair.other + (count if pair.obstacle else 0)
        found += [(a, b) for a, b in ((first, second), (second, first)) if _fits(shapes[b], shapes[a])]
    return found


def _fits(content: BodyShape, container: BodyShape) -> bool:
    """Tell whether a part of a shape may be inside another one, by their sizes."""
    if container.inside is None:
        return False
    return len(content.points) > 1 or bool(content.kernel[1] <= container.box[1].min())
