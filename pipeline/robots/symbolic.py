"""Kinematics as CasADi expressions: poses, what a joint does, and how poses differ."""

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
DECIMALS = 14  # Fixed poses are rounded to so many, as rotation matrices and metres.
_OPPOSITE = 1e-6  # squared sine of an angle 0.001 rad from half a turn
_SMALL = 1e-24  # under a square root: an angle of 1e-12 rad, so that derivatives exist at 0


class Pose(NamedTuple):
    """A rotation (3, 3) and a position (3,) [m]."""

    rotation: ca.SX
    position: ca.SX

    def __matmul__(self, other: "Pose") -> "Pose":
        """Return the product of the poses: `other` is given in the frame of this one."""
        return Pose(self.rotation @ other.rotation, self.position + self.rotation @ other.position)

    def apply(self, point: ca.DM | ca.SX) -> ca.SX:
        """Return a point (3,) given in this frame in the frame this pose is given in."""
        return self.position + self.rotation @ point

    def inverse(self) -> "Pose":
        """Return the inverse pose."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)


def constant(placement: pin.SE3) -> Pose:
    """Return a fixed pose as an expression.

    Rounded: what is 6e-17 because of a cosine would otherwise be multiplied through all that follows.
    """
    rotation, position = (np.round(part, DECIMALS) for part in (placement.rotation, placement.translation))
    return Pose(ca.SX(ca.sparsify(ca.DM(rotation))), ca.SX(ca.DM(position)))


def joint_pose(robot: str, model: pin.Model, joint: int, value: ca.SX) -> Pose:
    """Return the pose of a joint's frame, moved to `value` [rad or m], in its own frame at 0.

    Raises:
        RobotError: the joint is neither revolute nor prismatic.
    """
    kind = model.joints[joint].shortname().removeprefix("JointModel")
    if kind in ("RX", "RY", "RZ"):
        return Pose(_rotation(np.array(_AXES[kind[1]]), value), ca.SX.zeros(3))
    if kind in ("PX", "PY", "PZ"):
        return Pose(ca.SX.eye(3), ca.SX(np.array(_AXES[kind[1]])) * value)
    if kind == "RevoluteUnaligned":
        return Pose(_rotation(_axis(model, joint, slice(3, 6)), value), ca.SX.zeros(3))
    if kind == "PrismaticUnaligned":
        return Pose(ca.SX.eye(3), ca.SX(_axis(model, joint, slice(0, 3))) * value)
    raise RobotError(
        f"joint {model.names[joint]!r} of {robot!r} is a {kind}; only revolute and prismatic joints with limits are "
        "planned for"
    )


def rotation_vector(R: ca.SX) -> ca.SX:
    """Return axis times angle of a rotation (3, 3) as an expression (3,) [rad]; smooth at the identity.

    Within 0.001 rad of half a turn, where the axis is hardly defined, it is half a turn about x: far from 0.
    """
    sines = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    sine = ca.sqrt(ca.sumsqr(sines) + _SMALL)
    cosine = (ca.trace(R) - 1) / 2
    return _unless_opposite(sines, cosine, sines * (ca.atan2(sine, cosine) / sine))


def direction_error(
    direction: ca.SX,
    wanted: np.ndarray,
    across: np.ndarray | None = None,
    numbers: Callable[[np.ndarray], ca.SX] = ca.SX,
) -> ca.SX:
    """Return the turn that brings a unit vector (3,) onto `wanted`, as two expressions (2,) [rad].

    Its length is the angle between the two; so opposite directions are far apart, not equal as by the cross product.

    Args:
        direction: the unit vector.
        wanted: unit vector (3,).
        across: the two unit vectors (2, 3) the turn is given along; any that are perpendicular to `wanted` by default.
        numbers: makes expressions of numbers (see `Numbers`).
    """
    sines = numbers(perpendicular(wanted) if across is None else across) @ direction
    sine = ca.sqrt(ca.sumsqr(sines) + _SMALL)
    cosine = ca.dot(numbers(wanted), direction)
    return _unless_opposite(sines, cosine, sines * (ca.atan2(sine, cosine) / sine))


def _unless_opposite(sines: ca.SX, cosine: ca.SX, value: ca.SX) -> ca.SX:
    """Return a turn (m,), or half a turn along the first row where the sines are too small to tell its direction."""
    half = ca.vertcat(np.pi, *([0] * (sines.numel() - 1)))
    opposite = ca.logic_and(cosine < 0, ca.sumsqr(sines) < _OPPOSITE)
    return ca.if_else(opposite, half, value)


def perpendicular(direction: np.ndarray) -> np.ndarray:
    """Return two unit vectors perpendicular to a unit vector and to each other (2, 3)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def roll_pitch_yaw(R: ca.SX) -> ca.SX:
    """Return the angles (3,) [rad] with R = Rz(yaw) Ry(pitch) Rx(roll); singular where the pitch is a quarter turn."""
    return ca.vertcat(
        ca.atan2(R[2, 1], R[2, 2]),
        ca.atan2(-R[2, 0], ca.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2 + _SMALL)),
        ca.atan2(R[1, 0], R[0, 0]),
    )


def _rotation(axis: np.ndarray, angle: ca.SX) -> ca.SX:
    """Rodrigues' formula for a unit axis (3,)."""
    K = ca.SX(ca.skew(ca.DM(axis)))
    return ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)


def _axis(model: pin.Model, joint: int, rows: slice) -> np.ndarray:
    """The motion subspace of a one-DOF joint holds its axis in the rows of its kind (linear first)."""
    single = model.joints[joint]
    data = single.createData()
    single.calc(data, np.zeros(model.nq), np.zeros(model.nv))
    return np.asarray(data.S).reshape(6)[rows]
