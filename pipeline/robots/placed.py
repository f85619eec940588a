"""Two shapes in the world: how far they are from each other, and whether one is inside the other."""

from dataclasses import dataclass

import coal
import numpy as np

from pipeline.robots.shapes import BodyShape

_POINT = 1e-9  # radius of a ball that stands for a point [m]


@dataclass(frozen=True)
class Placed:
    """A shape in the world, its frame at a rotation R (3, 3) and position p (3,) [m]."""

    shape: BodyShape
    R: np.ndarray
    p: np.ndarray

    def distance(self, other: "Placed") -> float:
        """Return the distance to another one [m]; negative where one is in the other.

        Then it is the shortest way out, of primitives and hulls. Of a mesh that is not convex, and of an octree, it is
        that of a triangle or leaf, or of a ball in the other shape: the way out is as long or longer.
        """
        found = self._apart(other.shape.shape, other.R, other.p)
        for mesh, ball in ((self, other), (other, self)):
            if mesh.shape.mesh is None or mesh.shape.convex:
                continue
            point, (middle, radius) = mesh.holds(ball), ball.shape.kernel
            if point is not None:
                found = min(found, -mesh._apart(coal.Sphere(_POINT), np.eye(3), point) - radius)
            elif found <= 0:
                found = min(found, mesh._apart(coal.Sphere(_POINT), np.eye(3), ball.R @ middle + ball.p) - radius)
        return found

    def nearer(self, other: "Placed", bound: float) -> bool:
        """Tell whether another one is nearer than a bound [m], or inside: cheaper than how far it is.

        Of primitives and hulls the bound may be negative: a depth.
        """
        request = coal.CollisionRequest()
        request.security_margin = bound
        shapes = self.shape.shape, self._transform, other.shape.shape, other._transform
        meets = coal.collide(*shapes, request, coal.CollisionResult()) > 0
        return meets or self.holds(other) is not None or other.holds(self) is not None

    def holds(self, other: "Placed") -> np.ndarray | None:
        """Return a point of another one (3,) [m] that is inside this one, a closed mesh; None without one."""
        if self.shape.inside is None:
            return None
        points = other.shape.points @ other.R.T + other.p
        inside = self.shape.inside.contains((points - self.p) @ self.R)
        return points[int(np.argmax(inside))] if inside.any() else None

    @property
    def _transform(self) -> coal.Transform3s:
        return coal.Transform3s(self.R, self.p)

    def _apart(self, shape: coal.CollisionGeometry, R: np.ndarray, p: np.ndarray) -> float:
        """Return coal's distance, for which meshes are surfaces [m]."""
        there, request = coal.Transform3s(R, p), coal.DistanceRequest()
        return float(coal.distance(self.shape.shape, self._transform, shape, there, request, coal.DistanceResult()))
