"""Lower bounds of the distances of a robot's bodies as CasADi expressions, from capsules that hold the bodies.

coal's distances are no expressions and have no derivatives. These are distances of capsules: never more than those of
the bodies, and less by what capsules stand out. Where the axis of a capsule passes through an obstacle, the bound is at
most minus its radius, but no depth. Whether a configuration is free is asked of coal, whose answer costs less.
"""

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from pipeline.errors import ProblemError
from pipeline.robots.capsules import capsules
from pipeline.robots.model import Robot
from pipeline.robots.numbers import Numbers
from pipeline.robots.obstacles import Obstacle, Shape

_SMALL = 1e-24  # under a square root: 1e-12 m, so that derivatives exist at 0
_TINY = 1e-30  # least divisor: segments without a length, lengths that do not change
_HALVINGS = 6  # of the part of a segment in which its nearest point is, and as many steps along secants
_STEP = 1e-12  # of what is taken off where nearest points are not met, at least one [m]


class ClearanceBounds:
    """Lower bounds of distances between bodies that a robot checks, and to obstacles.

    A row is the least over the capsules of its bodies, with kinks where another pair becomes the nearest. Bodies that
    nearly touch wherever the robot is, as links beside each other do, may have bounds that are never above 0.

    Args:
        robot: whose bodies they are; capsules around them are made here, at some hundredths of a second per body.

    Attributes:
        pairs: numbers of the bodies of each self-collision pair (P, 2), in the order of the robot's.
        moving: numbers of the bodies that joints move (M,).
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        bodies = list(robot.geometry.geometryObjects)
        self.pairs = np.array([(pair.first, pair.second) for pair in robot.geometry.collisionPairs], int).reshape(-1, 2)
        self.moving = np.array([i for i, body in enumerate(bodies) if body.parentJoint], int)
        self._joints = [int(body.parentJoint) for body in bodies]
        self._held = [
            [np.append([body.placement.act(end) for end in held.ends], held.radius) for held in capsules(body.geometry)]
            for body in bodies
        ]

    def between(self, q: ca.SX, numbers: Numbers | None = None) -> ca.SX:
        """Return bounds of the distances of the self-collision pairs (P, 1) [m] as expressions of q (n,).

        Args:
            q: the configuration's symbol.
            numbers: takes the capsules, and the places of what is in `robot.placed`; without it they are constants.
        """
        placed, segments = self._placed(q, numbers), _segments()
        bounds = [
            ca.mmin(ca.vertcat(*(segments(*a, *b) - r - s for *a, r in placed[i] for *b, s in placed[j])))
            for i, j in self.pairs.tolist()
        ]
        return ca.vertcat(ca.SX(0, 1), *bounds)

    def to_obstacle(self, q: ca.SX, obstacle: ca.SX, shape: Shape, numbers: Numbers | None = None) -> ca.SX:
        """Return bounds of the distances of the moving bodies to an obstacle (M, 1) [m] as expressions.

        Args:
            q: the configuration's symbol (n,).
            obstacle: symbol of its numbers (15, 1), see `obstacle_numbers`.
            shape: one of PRIMITIVES.
            numbers: as of `between`.
        """
        R, p, half = ca.reshape(obstacle[:9], 3, 3), obstacle[9:12], obstacle[12:] / 2
        placed, segment = self._placed(q, numbers), _to_solid(shape)
        bounds = [
            ca.mmin(ca.vertcat(*(segment(R.T @ (a - p), R.T @ (b - p), half) - r for a, b, r in placed[i])))
            for i in self.moving.tolist()
        ]
        return ca.vertcat(ca.SX(0, 1), *bounds)

    def _placed(self, q: ca.SX, numbers: Numbers | None) -> list[list[tuple[ca.SX, ca.SX, ca.SX]]]:
        """Return the capsules of each body in the world: both ends (3, 1) and the radius."""
        made = ca.SX if numbers is None else numbers.arguments
        found = []
        for pose, held in zip(self._robot.symbolic_joint_poses(q, self._joints, numbers), self._held, strict=True):
            values = [made(capsule) for capsule in held]
            found.append([(pose.apply(x[:3]), pose.apply(x[3:6]), x[6]) for x in values])
        return found


def obstacle_numbers(obstacle: Obstacle) -> np.ndarray:
    """Return what `to_obstacle` takes of an obstacle (15,): its rotation by columns, position [m] and size [m]."""
    return np.concatenate([obstacle.rotation.T.ravel(), obstacle.position, obstacle.size])


@cache
def _segments() -> ca.Function:
    """Return the function that bounds the distance of two segments, of their four ends (3, 1).

    The nearest point of either follows from that of the other, clipped to its ends, in turn: first, second, first
    (Ericson, Real-Time Collision Detection, 5.1.9). Parallel segments may begin anywhere. Of nearly parallel ones the
    points are not quite the nearest: what counts is the distance of the planes that part the segments there.
    """
    a, b, c, d = (ca.SX.sym(name, 3) for name in "abcd")
    u, v, w = b - a, d - c, a - c
    uu, vv, uv, uw, vw = ca.dot(u, u), ca.dot(v, v), ca.dot(u, v), ca.dot(u, w), ca.dot(v, w)
    s = _clipped((uv * vw - uw * vv) / ca.fmax(uu * vv - uv**2, _TINY))
    t = _clipped((uv * s + vw) / ca.fmax(vv, _TINY))
    s = _clipped((uv * t - uw) / ca.fmax(uu, _TINY))
    away = w + s * u - t * v
    distance = _length(away)
    first, second = ca.dot(away, u) / distance, ca.dot(away, v) / distance
    nearer = ca.fmax(s * first, (s - 1) * first) + ca.fmax(-t * second, (1 - t) * second)
    return ca.Function("segments", [a, b, c, d], [_less(distance, nearer)])


@cache
def _to_solid(shape: Shape) -> ca.Function:
    """Return the function that bounds the distance of a segment to a solid about the origin.

    Of both ends of the segment and half the solid's size, (3, 1) each. Half the squared distance is convex along the
    segment: where its slope is 0 is found by halving and by secants. Whatever point that gives, no point of the segment
    is nearer to the solid than to the plane that touches it there, which is what counts.

    Raises:
        ProblemError: no primitive.
    """
    if shape not in _SOLIDS:
        raise ProblemError(f"distances to a {shape.value} have no bound; those to {[s.value for s in _SOLIDS]} have")
    a, b, half = (ca.SX.sym(name, 3) for name in ("a", "b", "half"))
    nearest, depth = _SOLIDS[shape]
    u = b - a

    def slope(t: ca.SX) -> ca.SX:
        x = a + t * u
        return ca.dot(u, x - nearest(x, half))

    low, high = ca.SX(0), ca.SX(1)
    below, above = slope(low), slope(high)

    def secant() -> ca.SX:
        return ca.fmin(ca.fmax(low - below * (high - low) / ca.fmax(above - below, _TINY), low), high)

    for step in range(2 * _HALVINGS):
        t = secant() if step % 2 else (low + high) / 2
        here = slope(t)
        falls = here < 0
        low, below = ca.if_else(falls, t, low), ca.if_else(falls, here, below)
        high, above = ca.if_else(falls, high, t), ca.if_else(falls, above, here)
    x = a + secant() * u
    away = x - nearest(x, half)
    distance = _length(away)
    nearer = ca.fmax(ca.fmax(ca.dot(away, x - a), ca.dot(away, x - b)), 0) / distance
    middle = _clipped(-ca.dot(a / half, u / half) / ca.fmax(ca.sumsqr(u / half), _TINY))
    bound = _less(distance, nearer) + ca.fmin(depth(a + middle * u, half), 0)
    return ca.Function(f"to_{shape.value}", [a, b, half], [bound])


def _less(distance: ca.SX, nearer: ca.SX) -> ca.SX:
    """Return a distance less how much nearer than its points others may be; both are at least 0 [m].

    In steps, which have no derivative: at the nearest points that of the distance is all.
    """
    return ca.fmax(distance - _STEP * (1 + ca.floor(nearer / _STEP)), 0)


def _clipped(share: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(share, 0), 1)


def _within(x: ca.SX, most: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(x, -most), most)


def _length(x: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(x) + _SMALL)


def _shortened(x: ca.SX, most: ca.SX) -> ca.SX:
    return x * ca.fmin(1, most / _length(x))


# Of points x (3, 1) and half sizes: the nearest point of the solid, and how far a point inside is beyond the surface.
_Of = Callable[[ca.SX, ca.SX], ca.SX]
_SOLIDS: dict[Shape, tuple[_Of, _Of]] = {
    Shape.BOX: (_within, lambda x, half: ca.mmax(ca.fabs(x) - half)),
    Shape.SPHERE: (lambda x, half: _shortened(x, half[0]), lambda x, half: _length(x) - half[0]),
    Shape.CYLINDER: (
        lambda x, half: ca.vertcat(_shortened(x[:2], half[0]), _within(x[2], half[2])),
        lambda x, half: ca.fmax(_length(x[:2]) - half[0], ca.fabs(x[2]) - half[2]),
    ),
}
