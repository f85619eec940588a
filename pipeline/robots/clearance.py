"""Distances of bodies: exact ones by coal, for the few pairs that bounds leave.

Distances from coal's trees are wrong (3.0.3: off by decimetres against a closed form), so every pair counts. Balls and
boxes around bodies say of nearly all that they are farther apart than the nearest ones found so far.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.spatial.distance import cdist

from pipeline.robots.bodies import body_of
from pipeline.robots.contact import Contact
from pipeline.robots.placed import Placed
from pipeline.robots.scene import Scene
from pipeline.robots.shapes import BodyShape

_ROUNDING = 1e-9  # of distances [m]
_AT_ONCE = 2_000_000  # distances of ball to ball in one array


class Distances:
    """Distances of a robot's bodies to the obstacles of a scene, and to each other.

    Args:
        scene: bodies and obstacles.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._model, self._data = scene.robot.model, scene.robot.model.createData()
        self._geometry = scene.robot.geometry
        self._where = self._geometry.createData()
        self._bodies, self._obstacles = _Boxes(scene.body_shapes), _Boxes(scene.obstacle_shapes)
        self._middles = self._obstacles.middles_at(scene.rotations, scene.positions)  # (O, 3) in the world

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (B, 3, 3) and positions (B, 3) [m] of the robot's bodies at q (n,)."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._where, q)
        placed = self._where.oMg
        R, p = np.array([M.rotation for M in placed]), np.array([M.translation for M in placed])
        return R.reshape(-1, 3, 3), p.reshape(-1, 3)

    def body(self, number: int, R: np.ndarray, p: np.ndarray) -> Placed:
        """Return a body of the robot where its bodies are at R (B, 3, 3) and p (B, 3)."""
        return Placed(self.scene.body_shapes[number], R[number], p[number])

    def obstacle(self, number: int) -> Placed:
        """Return an obstacle."""
        return Placed(self.scene.obstacle_shapes[number], self.scene.rotations[number], self.scene.positions[number])

    def near(self, bodies: Sequence[int], R: np.ndarray, p: np.ndarray, bound: float) -> list[tuple[int, int]]:
        """Return the pairs (body, obstacle) that may be nearer than a bound [m]; all others are not.

        Args:
            bodies: those that are asked for.
            R: rotations of all bodies (B, 3, 3).
            p: their positions (B, 3) [m].
            bound: see above.
        """
        chosen = np.asarray(bodies, int)
        middles = self._bodies.middles_at(R[chosen], p[chosen], chosen)
        row, obstacle = np.nonzero(self._balls(middles, chosen) <= bound + _ROUNDING)
        kept = self._boxes(R[chosen][row], middles[row], chosen[row], obstacle) <= bound + _ROUNDING
        return list(zip(chosen[row[kept]].tolist(), obstacle[kept].tolist(), strict=True))

    def least(self, bodies: Sequence[int], Q: np.ndarray) -> float:
        """Return the least distance of bodies to obstacles over configurations Q (m, n) [m]; inf without any.

        Pairs that may touch are left out.
        """
        best, chosen = np.inf, np.asarray(bodies, int)
        if not len(chosen) or not len(self._middles):
            return best
        rows = max(_AT_ONCE // (len(chosen) * len(self._middles)), 1)
        for first in range(0, len(Q), rows):
            where = [self.at(q) for q in Q[first : first + rows]]
            R, p = (np.concatenate([part[chosen] for part in parts]) for parts in zip(*where, strict=True))
            best = self._least(np.tile(chosen, len(where)), R, p, best)
        return best

    def contacts(self, Q: np.ndarray) -> list[Contact]:
        """Return the contacts of pairs that may touch, each where it is deepest over configurations Q (m, n)."""
        scene, own = self.scene, list(self.scene.robot.geometry.collisionPairs)
        pairs = [(pair.first, pair.second) for pair in own]
        beside = [pair for pair, depth in zip(pairs, scene.pair_depths, strict=True) if depth > 0]
        deepest: dict[tuple[str, str], float] = {}
        for R, p in map(self.at, Q if beside or scene.touching_numbers else ()):
            held = [(i, body_of(scene.body_names[j]), self.body(j, R, p)) for i, j in beside]
            held += [(i, scene.names[number], self.obstacle(number)) for i, number in scene.touching_numbers]
            for i, second, there in held:
                pair = body_of(scene.body_names[i]), second
                deepest[pair] = max(deepest.get(pair, 0.0), -self.body(i, R, p).distance(there))
        return [Contact(*names, depth) for names, depth in deepest.items() if depth > 0]

    def _least(self, body: np.ndarray, R: np.ndarray, p: np.ndarray, best: float) -> float:
        """Return the least distance of bodies (N,) at R (N, 3, 3) and p (N, 3), or `best` where that is less [m]."""
        middles = self._bodies.middles_at(R, p, body)
        balls = self._balls(middles, body)  # (N, O)
        for one, other in self.scene.touching_numbers:
            balls[body == one, other] = np.inf

        def exact(row: int, obstacle: int, bound: float) -> float:
            here, there = Placed(self.scene.body_shapes[body[row]], R[row], p[row]), self.obstacle(obstacle)
            quick = here.shape.convex and there.shape.convex  # of others a verdict is cheaper than a distance
            if not quick and 0 <= bound < np.inf and not here.nearer(there, bound):
                return bound
            return min(bound, here.distance(there))

        first, second = divmod(int(np.argmin(balls)), balls.shape[1])
        if balls[first, second] < best:
            best = exact(first, second, best)
        row, obstacle = np.nonzero(balls < best)
        least = np.maximum(balls[row, obstacle], self._boxes(R[row], middles[row], body[row], obstacle))
        for i in np.argsort(least, kind="stable").tolist():
            if least[i] >= best:
                break
            best = exact(int(row[i]), int(obstacle[i]), best)
        return best

    def _balls(self, middles: np.ndarray, body: np.ndarray) -> np.ndarray:
        """Return the distances of the balls around bodies (N,), at `middles` (N, 3), to those of obstacles (N, O)."""
        apart: np.ndarray = cdist(middles, self._middles)
        return apart - self._bodies.radii[body, None] - self._obstacles.radii

    def _boxes(self, R: np.ndarray, middles: np.ndarray, body: np.ndarray, obstacle: np.ndarray) -> np.ndarray:
        """Return the distance of the ball around either to the box around the other (K,), the larger of the two.

        Of bodies (K,) at rotations R (K, 3, 3) and `middles` (K, 3), to obstacles (K,).
        """
        apart = self._middles[obstacle] - middles
        in_body = np.einsum("kji,kj->ki", R, apart)
        in_obstacle = np.einsum("kji,kj->ki", self.scene.rotations[obstacle], apart)
        return np.maximum(
            _beyond(in_body, self._bodies.halves[body]) - self._obstacles.radii[obstacle],
            _beyond(in_obstacle, self._obstacles.halves[obstacle]) - self._bodies.radii[body],
        )


class _Boxes:
    """Boxes and balls around shapes, as arrays."""

    def __init__(self, shapes: Sequence[BodyShape]) -> None:
        self.middles = np.array([shape.box[0] for shape in shapes]).reshape(-1, 3)
        self.halves = np.array([shape.box[1] for shape in shapes]).reshape(-1, 3)
        self.radii = np.array([shape.radius for shape in shapes], float)

    def middles_at(self, R: np.ndarray, p: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the middles (N, 3) of chosen shapes, whose frames are at R (N, 3, 3) and p (N, 3)."""
        found: np.ndarray = np.einsum("nij,nj->ni", R, self.middles[chosen]) + p
        return found


def _beyond(points: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """Return the signed distances of points (N, 3) to boxes about the origin of half extents (N, 3), as (N,)."""
    beyond = np.abs(points) - halves
    outside: np.ndarray = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)
