"""Distances of two placed forms by plain coal: how far, whether nearer than a bound, and whether one is inside."""

import coal
import numpy as np

from pipeline.verification.shapes import Form

_NONE = 1e6  # [m]: where its search for a depth fails, coal says the largest number there is

Placed = tuple[Form, np.ndarray, np.ndarray]  # a form with its rotation (3, 3) and position (3,) [m] in the world


class Asker:
    """Asks coal, with its requests made once."""

    def __init__(self) -> None:
        self._distance, self._distances = coal.DistanceRequest(), coal.DistanceResult()
        self._collision, self._collisions = coal.CollisionRequest(), coal.CollisionResult()

    def distance(self, one: Placed, other: Placed) -> float:
        """Return the distance [m]: of convex forms, less than 0 and the shortest way out where they overlap."""
        there, here = coal.Transform3s(one[1], one[2]), coal.Transform3s(other[1], other[2])
        self._distances.clear()
        found = float(coal.distance(one[0].shape, there, other[0].shape, here, self._distance, self._distances))
        return found if abs(found) < _NONE else -np.inf

    def nearer(self, one: Placed, other: Placed, bound: float) -> bool:
        """Tell whether two forms, of which meshes are surfaces, are nearer than a bound of at least 0 [m]."""
        there, here = coal.Transform3s(one[1], one[2]), coal.Transform3s(other[1], other[2])
        self._collision.security_margin = bound
        self._collisions.clear()
        return bool(coal.collide(one[0].shape, there, other[0].shape, here, self._collision, self._collisions))

    def meet(self, one: Placed, other: Placed) -> bool:
        """Tell whether two forms are in contact, or one inside the other."""
        if one[0].convex and other[0].convex:
            return self.distance(one, other) <= 0
        return self.nearer(one, other, 0.0) or enclosed(one, other)

    def depth(self, one: Placed, other: Placed) -> float:
        """Return how deep two forms are in each other [m]; of those that are not convex at most so deep."""
        if not self.meet(one, other):
            return 0.0
        parts = [
            (self.distance((a, one[1], one[1] @ p + one[2]), (b, other[1], other[1] @ r + other[2])))
            for a, p in one[0].hulls
            for b, r in other[0].hulls
        ]
        return max(0.0, -min(parts))

    def clearance(self, one: Placed, other: Placed) -> float:
        """Return the distance [m]; where one is in the other, 0 at most."""
        found = self.distance(one, other)
        if one[0].convex and other[0].convex:
            return found
        return min(found, -self.depth(one, other)) if enclosed(one, other) else found


def enclosed(one: Placed, other: Placed) -> bool:
    """Tell whether a part of one form is inside the closed mesh of the other, where their surfaces do not meet."""
    for (around, R, p), (content, turned, moved) in ((one, other), (other, one)):
        if around.inside is not None and around.inside((content.points @ turned.T + moved - p) @ R).any():
            return True
    return False
