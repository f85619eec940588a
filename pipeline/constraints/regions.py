"""Task space regions and chains of them (Berenson et al. 2011; compnetx.txt, section III)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from pipeline.constraints.base import Constraint
from pipeline.constraints.orientation import AngleBounds, finite_turn
from pipeline.constraints.poses import closed_chain
from pipeline.constraints.within import Within
from pipeline.errors import ConstraintError
from pipeline.robots import IDENTITY, Numbers, Placement, Robot
from pipeline.robots.symbolic import Pose
from pipeline.robots.virtual import DIRECTIONS, VirtualFrame, VirtualJoint, with_virtual_chain

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_UNITS = ("m", "m", "m", "rad", "rad", "rad")
_OF_AXES = tuple(AXES.index(direction) for direction in DIRECTIONS)


@dataclass(frozen=True)
class TaskSpaceRegion:
    """Poses of a frame e within bounds, seen from a frame w (Berenson et al. 2011, section 4).

    A dimension with equal bounds is fixed, one without finite bounds is free, any other is an interval.

    Attributes:
        lower, upper: bounds B_w of x, y, z [m], roll, pitch, yaw [rad] of e, less its offset, in w (6,).
        origin: T_0_w, where w is in the world (or, in a chain, in the end of the region before).
        offset: T_w_e, where e is in w when all displacements are 0.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    origin: Placement = IDENTITY
    offset: Placement = IDENTITY

    def __post_init__(self) -> None:
        for name, bounds in (("lower", self.lower), ("upper", self.upper)):
            if len(bounds) != 6 or np.isnan(bounds).any():
                raise ConstraintError(f"{name} bounds of a region are {list(bounds)}; they must be six numbers")
        for axis, low, high in zip(AXES, self.lower, self.upper, strict=True):
            if low > high or low == np.inf or high == -np.inf:
                raise ConstraintError(f"{axis} of a region has bounds {low} and {high}; they must not cross")

    @property
    def fixed(self) -> tuple[bool, ...]:
        """Which dimensions have equal bounds (6,)."""
        return tuple(low == high for low, high in zip(self.lower, self.upper, strict=True))

    @property
    def free(self) -> tuple[bool, ...]:
        """Which dimensions have no bound at all, or, for an angle, bounds a full turn apart (6,)."""
        return tuple(
            high - low >= 2 * np.pi if i >= 3 else low == -np.inf and high == np.inf
            for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True))
        )

    def displacement(self, T: pin.SE3) -> np.ndarray:
        """Return how far a pose is outside of the bounds, per dimension (6,) [m, rad]; 0 within.

        Of all angles that say the same orientation those count that are least outside.
        """
        d = self.coordinates(T)
        return np.where(self.free, 0.0, d - np.clip(d, self.lower, self.upper))

    def distance(self, T: pin.SE3) -> float:
        """Return ||displacement|| of a pose of e in the world (Berenson et al. 2011, eq. 6)."""
        return float(np.linalg.norm(self.displacement(T)))

    def coordinates(self, T: pin.SE3) -> np.ndarray:
        """Return x, y, z, roll, pitch, yaw (6,) of a pose of e in the world, less its offset, in w.

        Of all angles that say the same orientation those are returned that are least outside of the bounds.
        """
        T_w = self.origin.se3().actInv(T) * self.offset.se3().inverse()
        return np.concatenate([T_w.translation, self._angles.nearest(T_w.rotation)])

    def pose(self, coordinates: np.ndarray) -> pin.SE3:
        """Return the pose of e in the world at coordinates (6,) [m, rad]."""
        moved = pin.SE3(pin.rpy.rpyToMatrix(*coordinates[3:]), np.asarray(coordinates[:3], float))
        return self.origin.se3() * moved * self.offset.se3()

    def sample(self, rng: np.random.Generator) -> pin.SE3:
        """Return a random pose of e within the bounds; free angles are drawn from whole turns.

        Raises:
            ConstraintError: a position without finite bounds.
        """
        low, high = np.array(self.lower), np.array(self.upper)
        for i in range(3, 6):
            if self.free[i]:
                low[i], high[i] = finite_turn(low[i], high[i])
        if not np.isfinite([low, high]).all():
            raise ConstraintError("poses can only be drawn from a region whose positions have finite bounds")
        return self.pose(rng.uniform(low, high))

    def constraint(self, robot: Robot, frame: str = "", **settings: Any) -> Constraint:
        """Return the constraint that keeps a frame (the tool by default) in the region's fixed dimensions.

        F is how far the position is off, and the smallest turn by which the orientation is (see `AngleBounds`).
        Every fixed dimension is a row; a pitch that is fixed alone, at a quarter turn, is a direction and so two.

        Raises:
            ConstraintError: a dimension with an interval (it needs a chain, whose variables have limits), or nothing
                fixed.
        """
        frame = frame or robot.tool
        intervals = [a for a, f, free in zip(AXES, self.fixed, self.free, strict=True) if not f and not free]
        if intervals:
            raise ConstraintError(
                f"the region of {frame!r} bounds {', '.join(intervals)} by intervals, which are no equations: use a "
                "chain, whose variables have them as joint limits"
            )
        if not any(self.fixed):
            raise ConstraintError(f"the region of {frame!r} fixes no dimension: there is no constraint")
        q, p = ca.SX.sym("q", robot.dimension), Numbers()
        T = self._inside(robot.symbolic_pose(q, frame, p), p)
        places = [i for i in range(3) if self.fixed[i]]
        values = [T.position[i] - p(self.lower[i]) for i in places]
        if any(self.fixed[3:]):
            turn, angles = self._angles.symbolic_turn(T.rotation, p)
            values, places = [*values, turn], [*places, *(3 + angle for angle in angles)]
        labels = [f"{AXES[i]} of {frame} in the region [{_UNITS[i]}]" for i in places]
        return Constraint(f"region of {frame}", q, ca.vertcat(*values), labels=labels, numbers=p, **settings)

    def within(self, T: Pose, numbers: Numbers) -> Within:
        """Return what bounds say of a pose of e in the world, with places and angles as numbers [m, rad]."""
        T_w, places = self._inside(T, numbers), [i for i in range(3) if not self.free[i]]
        values = ca.vertcat(ca.SX(0, 1), *(T_w.position[i] for i in places))
        positions = Within(values, np.array(self.lower)[places], np.array(self.upper)[places])
        return Within.together(positions, self._angles.within(T_w.rotation, numbers))

    @cached_property
    def _angles(self) -> AngleBounds:
        return AngleBounds(self.lower[3:], self.upper[3:])

    def _inside(self, T: Pose, numbers: Numbers) -> Pose:
        """Return a pose of e in the world, less its offset, in w."""
        return numbers.pose(self.origin.se3().inverse()) @ T @ numbers.pose(self.offset.se3().inverse())


@dataclass(frozen=True)
class Chain:
    """A chain of regions as a virtual-link manipulator, and the robot that holds its end.

    Configurations of `robot` are those of the arm followed by the values of all dimensions that are not fixed, which
    have the regions' bounds as joint limits, or turn without end where an angle is free. F has 6 rows: the hand is
    where the chain ends.

    Attributes:
        robot: the arm with the chain's virtual joints.
        arm: number of the arm's variables.
        constraint: 6 rows on all variables.
        end: frame at the end of the chain; those after each region are `<name>_<i>`, for bodies that move with them.
    """

    robot: Robot
    arm: int
    constraint: Constraint
    end: str

    def values(self, q_arm: np.ndarray, guess: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """Return the chain's values (m,) nearest to where the arm at q_arm (n,) holds its end, and ||F|| there.

        Least squares within the bounds, from `guess` or the middle of the bounds.
        """
        n, constraint = self.arm, self.constraint
        low, high = self.robot.lower[n:], self.robot.upper[n:]
        middle = np.zeros(len(low)) if self.robot.rest is None else self.robot.rest[n:]
        begin = np.clip(middle if guess is None else guess, low, high)

        def whole(x: np.ndarray) -> np.ndarray:
            return np.concatenate([q_arm, x])

        found = least_squares(
            lambda x: constraint.value(whole(x)),
            begin,
            jac=lambda x: constraint.jacobian(whole(x))[:, n:],
            bounds=(low, high),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        return found.x, constraint.distance(whole(found.x))


def chain(
    robot: Robot, regions: Sequence[TaskSpaceRegion], frame: str = "", name: str = "chain", **settings: Any
) -> Chain:
    """Join a frame of the robot (its tool by default) to the end of a chain of regions.

    Two regions make a hinged door: the first turns about the hinge, the second about the handle.

    Raises:
        ConstraintError: no region, or no dimension that is not fixed.
        RobotError: a free position (the chain's joints need finite limits), or a name that exists.
    """
    if not regions:
        raise ConstraintError("a chain needs at least one region")
    links: list[VirtualJoint | VirtualFrame] = []
    before, end = pin.SE3.Identity(), ""  # where the next link stands after the joint before it
    for i, region in enumerate(regions):
        before, end = before * region.origin.se3(), f"{name}_{i}"
        for direction, axis in enumerate(_OF_AXES):
            low, high = region.lower[axis], region.upper[axis]
            if low == high:
                before = before * _step(axis, low)
                continue
            turns = axis >= 3 and region.free[axis]
            if turns:
                low, high = finite_turn(low, high)
            links.append(VirtualJoint(direction, before, low, high, f"{end}_{AXES[axis]}", turns))
            before = pin.SE3.Identity()
        before = before * region.offset.se3()
        links.append(VirtualFrame(before, end))
    if not any(isinstance(link, VirtualJoint) for link in links):
        raise ConstraintError("all dimensions of the chain are fixed: use a pose instead")
    larger = with_virtual_chain(robot, links)
    constraint = closed_chain(larger, end, frame or robot.tool, pin.SE3.Identity(), **settings)
    return Chain(larger, robot.dimension, constraint, end)


def _step(axis: int, value: float) -> pin.SE3:
    coordinates = np.zeros(6)
    coordinates[axis] = value
    return pin.SE3(pin.rpy.rpyToMatrix(*coordinates[3:]), coordinates[:3])
