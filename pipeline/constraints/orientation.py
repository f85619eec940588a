"""Orientations within bounds of roll, pitch and yaw, R = Rz(yaw) Ry(pitch) Rx(roll).

The same orientation has many triples of angles: (roll, pitch, yaw) and (roll + pi, pi - pitch, yaw + pi), whole turns
of each, and, where the pitch is a quarter turn, every roll with a yaw that goes with it (Berenson et al. 2011, section
4.1). Bounds hold where any of these triples is within them.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints.within import Within
from pipeline.robots import Numbers
from pipeline.robots.symbolic import direction_error, roll_pitch_yaw, rotation_vector

ROLL, PITCH, YAW = range(3)
_ONE = 1e-6  # cosine of a pitch below which roll and yaw are one: beyond it they are known to 1e-10 rad
_FIXED_ONE = 1e-3  # the same for a fixed pitch: the usual tolerance of constraints, so that 1.57 is a quarter turn
_SMALL = 1e-24  # under a square root: derivatives exist at 0

_EQUAL = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]), np.array([[0.0, 0.0, 0.0], [np.pi, np.pi, np.pi]])


class AngleBounds:
    """Bounds of roll, pitch and yaw.

    Args:
        lower, upper: bounds (3,) [rad]; an angle whose bounds are a whole turn or more apart is free.
    """

    def __init__(self, lower: Sequence[float], upper: Sequence[float]) -> None:
        low, high = np.array(lower, float), np.array(upper, float)
        self.fixed, self.free = low == high, high - low >= 2 * np.pi
        ends = np.array(
            [finite_turn(*pair) if free else pair for *pair, free in zip(low, high, self.free, strict=True)]
        )
        self.middle, self.half = ends.mean(axis=1), np.minimum(np.ptp(ends, axis=1) / 2, np.pi)

    def nearest(self, R: np.ndarray) -> np.ndarray:
        """Return, of all equal angles of an orientation (3, 3), those least outside of the bounds (3,) [rad]."""
        across = float(np.hypot(R[0, 0], R[1, 0]))  # the cosine of the pitch
        angles = np.array([np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], across), np.arctan2(R[1, 0], R[0, 0])])
        if across < _ONE:
            return self.middle + self._at_a_quarter_turn(R, float(angles[PITCH]))
        apart = _wrapped(_EQUAL[0] * angles + _EQUAL[1] - self.middle)  # (2, 3)
        beyond = np.linalg.norm(np.maximum(np.abs(apart) - self.half, 0.0), axis=1)
        return np.asarray(self.middle + apart[1 if beyond[1] < beyond[0] else 0])

    def symbolic_nearest(self, R: ca.SX, numbers: Numbers) -> ca.SX:
        """Return `nearest` as an expression (3,) with the bounds as numbers; singular at a quarter turn of pitch."""
        found, half = [], numbers(self.half)
        for sign, turn in zip(*_EQUAL, strict=True):
            apart = ca.DM(sign) * roll_pitch_yaw(R) + numbers(turn - self.middle)
            apart = ca.atan2(ca.sin(apart), ca.cos(apart))
            found.append((apart, ca.sumsqr(ca.fmax(ca.fabs(apart) - half, 0))))
        (first, beyond), (second, beyond_second) = found
        return numbers(self.middle) + ca.if_else(beyond_second < beyond, second, first)

    def symbolic_turn(self, R: ca.SX, numbers: Numbers) -> tuple[ca.SX, list[int]]:
        """Return rows that are 0 where the fixed angles are met, whatever the free ones are, and the angle of each row.

        Their length is the smallest angle by which the orientation must be turned to meet them [rad]. So they are
        smooth all around where they are 0, at a quarter turn of pitch too, where differences of angles are not. A row
        is the difference of its angle where the pitch is 0. Only for bounds without intervals.
        """
        roll, pitch, yaw = self.middle
        which = [angle for angle in (ROLL, PITCH, YAW) if self.fixed[angle]]
        down, ahead = R[2, :].T, R[:, 0]  # the region's z axis seen from the frame, the frame's x axis from the region
        if which == [ROLL, PITCH, YAW]:
            E = numbers(_rotation("z", -yaw)) @ R @ numbers(_rotation("x", -roll) @ _rotation("y", -pitch))
            return rotation_vector(E), which
        if which == [ROLL, YAW]:  # what is left is a turn about y
            E = numbers(_rotation("z", -yaw)) @ R @ numbers(_rotation("x", -roll))
            across = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
            return direction_error(E[:, 1], np.eye(3)[1], across, numbers), which
        if which == [ROLL, PITCH]:
            held = _rotation("y", pitch) @ _rotation("x", roll)
            sideways = np.array([0.0, np.cos(roll), -np.sin(roll)])
            return direction_error(down, held[2], np.stack([sideways, np.cross(held[2], sideways)]), numbers), which
        if which == [PITCH, YAW]:
            held = _rotation("z", yaw) @ _rotation("y", pitch)
            sideways = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
            across = np.stack([np.cross(sideways, held[:, 0]), sideways])
            return direction_error(ahead, held[:, 0], across, numbers), which
        if which == [ROLL]:
            return _elevation(down, numbers(np.array([0.0, np.cos(roll), -np.sin(roll)]))), which
        if which == [YAW]:
            return _elevation(ahead, numbers(np.array([-np.sin(yaw), np.cos(yaw), 0.0]))), which
        if self.at_quarter_turn:  # roll and yaw are one, and free: an axis has a direction, which is two rows
            return direction_error(down, np.array([-np.sign(np.sin(pitch)), 0.0, 0.0]), None, numbers), [PITCH, PITCH]
        side = np.sign(np.cos(pitch))
        return side * (roll_pitch_yaw(R)[PITCH] - numbers(np.arcsin(np.sin(pitch)))), which

    @property
    def at_quarter_turn(self) -> bool:
        """Whether the pitch is fixed at a quarter turn, where roll and yaw are one."""
        return bool(self.fixed[PITCH] and abs(np.cos(self.middle[PITCH])) < _FIXED_ONE)

    def within(self, R: ca.SX, numbers: Numbers) -> Within:
        """Return what the bounds say of an orientation (3, 3) [rad]; the angles in them are numbers."""
        if all(self.fixed | self.free):
            return Within.zero(self.symbolic_turn(R, numbers)[0] if any(self.fixed) else ca.SX(0, 1))
        if self.at_quarter_turn:
            side = np.sign(np.sin(self.middle[PITCH]))
            rows = Within.zero(direction_error(R[2, :].T, np.array([-side, 0.0, 0.0]), None, numbers))
            if self.free[ROLL] or self.free[YAW]:
                return rows
            turn = ca.atan2(side * R[1, 2] - R[0, 1], R[1, 1] + side * R[0, 2])  # yaw less, or plus, roll
            turn -= numbers(self.middle[YAW] - side * self.middle[ROLL])
            half = self.half[[ROLL]] + self.half[[YAW]]
            return Within.together(rows, Within(ca.atan2(ca.sin(turn), ca.cos(turn)), -half, half))
        apart, bound = self.symbolic_nearest(R, numbers) - numbers(self.middle), np.flatnonzero(~self.free)
        return Within(apart[bound.tolist()], -self.half[bound], self.half[bound])

    def _at_a_quarter_turn(self, R: np.ndarray, pitch: float) -> np.ndarray:
        """Return roll, pitch and yaw (3,) from the middle of the bounds where only yaw -/+ roll is known."""
        side = np.sign(pitch)
        turn = np.arctan2(side * R[1, 2] - R[0, 1], R[1, 1] + side * R[0, 2])
        apart = float(_wrapped(turn - self.middle[YAW] + side * self.middle[ROLL]))
        width = self.half[ROLL] + self.half[YAW]
        beyond = max(abs(apart) - width, 0.0) / 2  # shared, so that it is least together
        shares = [half * min(abs(apart) / width, 1.0) if width else 0.0 for half in self.half[[ROLL, YAW]]]
        roll, yaw = (np.sign(apart) * (share + beyond) for share in shares)
        return np.array([-side * roll, _wrapped(pitch - self.middle[PITCH]), yaw])


def finite_turn(low: float, high: float) -> tuple[float, float]:
    """Return the bounds of a free angle: a whole turn where one or both are missing [rad]."""
    if np.isfinite([low, high]).all():
        return low, high
    if np.isfinite(low):
        return low, low + 2 * np.pi
    return (high - 2 * np.pi, high) if np.isfinite(high) else (-np.pi, np.pi)


def _elevation(direction: ca.SX, normal: ca.SX) -> ca.SX:
    """The angle between a unit vector and the plane across a normal."""
    sine = ca.dot(normal, direction)
    return ca.atan2(sine, ca.sqrt(ca.fmax(1 - sine**2, 0) + _SMALL))


def _rotation(axis: str, angle: float) -> np.ndarray:
    return np.asarray(pin.utils.rotate(axis, float(angle)))


def _wrapped(angle: np.ndarray | float) -> np.ndarray:
    """Angles less whole turns, in [-pi, pi]."""
    return np.arctan2(np.sin(angle), np.cos(angle))
