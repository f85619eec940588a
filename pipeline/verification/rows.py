"""What a statement's equations ask, as rows F(q): 0 where they are met, in metres and radians, far from them too.

||F|| is how far a position is off and the smallest turn by which an orientation is, which is what tolerances are of.
"""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import ConfigError
from pipeline.robots.urdf import UrdfRobot
from pipeline.spec.statement import (
    Equation,
    Follows,
    InRegion,
    Joined,
    Level,
    OnLine,
    OnPlane,
    OnSphere,
    OnTorus,
    Pinned,
    Posed,
    Region,
    Statement,
)
from pipeline.verification.kinematics import UNIVERSE, WORLD, Kinematics, Place
from pipeline.verification.reader import follows, place
from pipeline.verification.urdf import of_angles

_QUARTER = 1e-3  # cosine of a fixed pitch below which it is a quarter turn, where roll and yaw are one: 1.57 is one
_NEARLY_HALF = 1e-4  # sine of turns beyond a quarter of which R - R^T does not tell the axis well
Poses = tuple[np.ndarray, np.ndarray]  # of a frame: (T, 3, 3), (T, 3)
Where = Callable[[str], Poses]


class Rows:
    """The equations of a statement.

    Args:
        statement: the task; the rows of its chain come first, those of joints that follow others last.
        kinematics: its robot.

    Raises:
        RobotError: a frame that does not exist.
        ConfigError: a region with intervals, or one that fixes nothing.
    """

    def __init__(self, statement: Statement, kinematics: Kinematics) -> None:
        said: list[Equation] = list(statement.equations)
        if statement.chain is not None:
            said.insert(0, Joined(statement.chain.end, statement.chain.frame))
        if isinstance(statement.robot, UrdfRobot):
            said += follows(statement.robot)
        self._sayings, self._kinematics = said, kinematics
        self.values(np.zeros((1, len(kinematics.names))))  # what does not fit is refused here

    def values(self, Q: np.ndarray) -> np.ndarray:
        """Return F at the rows of Q (T, n) as (T, k)."""
        kinematics = self._kinematics
        R, p = kinematics.joint_poses(Q)
        known: dict[str, Poses] = {UNIVERSE: kinematics.placed(R, p, WORLD, Place())}

        def where(frame: str) -> Poses:
            if frame not in known:
                known[frame] = kinematics.placed(R, p, *kinematics.frame(frame))
            return known[frame]

        def value(joint: str) -> np.ndarray:
            return Q[:, kinematics.names.index(joint)]

        parts = [np.zeros((len(Q), 0)), *(_rows(saying, where, value) for saying in self._sayings)]
        return np.concatenate(parts, axis=1)


def _rows(saying: Equation, where: Where, value: Callable[[str], np.ndarray]) -> np.ndarray:
    """Return the rows of a saying (T, k), given where frames are and the values of joints (T,)."""
    match saying:
        case Follows(joint, leader, multiplier, offset):
            return (value(joint) - (multiplier * value(leader) + offset))[:, None]
        case Level(frame, axis, direction):
            return _between(where(frame)[0] @ _unit(axis), _unit(direction))
        case OnPlane(frame, normal, distance):
            return (where(frame)[1] @ _unit(normal) - distance)[:, None]
        case OnLine(frame, point, direction):
            return (where(frame)[1] - np.array(point)) @ _across(_unit(direction)).T
        case Pinned(frame, point):
            return where(frame)[1] - np.array(point)
        case Posed(frame, wanted):
            return _pose(where(UNIVERSE), where(frame), place(wanted))
        case Joined(frame, other, relative):
            return _pose(where(frame), where(other), place(relative))
        case InRegion(frame, region):
            return _region(region, where(frame))
        case OnSphere(frame, radius):
            return (np.linalg.norm(where(frame)[1], axis=1) - radius)[:, None]
        case OnTorus(major, minor, frame):
            x, y, z = where(frame)[1].T
            return (np.hypot(np.hypot(x, y) - major, z) - minor)[:, None]


def _pose(one: Poses, other: Poses, relative: Place) -> np.ndarray:
    """Return position and rotation vector (T, 6) of the other frame, seen from where it belongs in the first."""
    R = one[0] @ relative.R  # (T, 3, 3), and its transpose turns into it
    apart = other[1] - one[1] - one[0] @ relative.p
    return np.concatenate([_seen(R, apart), rotation_vectors(np.swapaxes(R, 1, 2) @ other[0])], axis=1)


def _region(region: Region, pose: Poses) -> np.ndarray:
    """Return the rows (T, k) of the fixed dimensions of a region."""
    lower, upper = np.array(region.lower), np.array(region.upper)
    fixed = lower == upper
    free = np.where(np.arange(6) < 3, (lower == -np.inf) & (upper == np.inf), upper - lower >= 2 * np.pi)
    if not (fixed | free).all() or not fixed.any():
        raise ConfigError(
            f"a region that is an equation has bounds {region.lower} and {region.upper}; some must be equal, and the "
            "others free: intervals need a chain"
        )
    origin, end = place(region.place).inverse(), place(region.end).inverse()
    R = origin.R @ pose[0]  # (T, 3, 3)
    p = pose[1] @ origin.R.T + origin.p + R @ end.p
    turned = list(_orientation(R @ end.R, fixed[3:], lower[3:]))
    return np.concatenate([(p - np.where(fixed[:3], lower[:3], 0.0))[:, fixed[:3]], *turned], axis=1)


def _orientation(R: np.ndarray, fixed: np.ndarray, angles: np.ndarray) -> Iterator[np.ndarray]:
    """Give rows (T, k) whose length is the smallest turn from R (T, 3, 3) to where fixed angles (3,) are met.

    R = Rz(yaw) Ry(pitch) Rx(roll). Where an angle is free all its values count, so that (roll + pi, pi - pitch,
    yaw + pi), which is the same orientation, makes no difference (Berenson et al. 2011, section 4.1).
    """
    roll, pitch, yaw = np.where(fixed, angles, 0.0)
    held = of_angles(roll, pitch, yaw)
    match tuple(fixed.tolist()):
        case (True, True, True):
            yield rotation_vectors(held.T @ R)
        case (True, False, True):  # a turn about y is left between those about z and x
            yield _between(of_angles(0, 0, yaw).T @ R @ of_angles(roll, 0, 0).T[:, 1], np.array([0.0, 1.0, 0.0]))
        case (True, True, False):  # the vertical, seen from the frame
            yield _between(R[:, 2], held[2])
        case (False, True, True):  # the frame's x axis
            yield _between(R[:, :, 0], held[:, 0])
        case (True, False, False):  # an axis that stays level
            yield _elevation(R[:, 2] @ of_angles(roll, 0, 0).T[:, 1])
        case (False, False, True):  # the frame's x axis stays in a vertical plane
            yield _elevation(R[:, :, 0] @ held[:, 1])
        case (False, True, False):
            if abs(np.cos(pitch)) < _QUARTER:
                yield _between(R[:, 2], np.array([-np.sign(np.sin(pitch)), 0.0, 0.0]))
            else:
                yield _elevation(-R[:, 2, 0]) - np.arcsin(np.sin(pitch))


def _elevation(sine: np.ndarray) -> np.ndarray:
    """Return the angle (T, 1) between unit vectors and a plane, given how far they stand out of it (T,)."""
    return np.arcsin(np.clip(sine, -1.0, 1.0))[:, None]


def _between(directions: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return rows (T, 2), as long as the angle between unit vectors (T, 3) and a wanted one (3,)."""
    off = directions @ _across(wanted).T  # (T, 2)
    sine, cosine = np.linalg.norm(off, axis=1), directions @ wanted
    angle = np.arctan2(sine, cosine)
    stretch = np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)
    rows = np.asarray(off * stretch[:, None])
    rows[(sine == 0) & (cosine < 0)] = [np.pi, 0.0]
    return rows


def rotation_vectors(R: np.ndarray) -> np.ndarray:
    """Return axis times angle (T, 3) of rotations (T, 3, 3)."""
    turn = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine, cosine = np.linalg.norm(turn, axis=1), (np.trace(R, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    found = turn * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)[:, None]
    half = (sine < _NEARLY_HALF) & (cosine < 0)
    if half.any():
        found[half] = Rotation.from_matrix(R[half]).as_rotvec()
    return np.asarray(found)


def _seen(R: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (T, 3) in frames of orientation R (T, 3, 3)."""
    return np.asarray(np.einsum("tba,tb->ta", R, vectors))


def _unit(vector: tuple[float, ...]) -> np.ndarray:
    found = np.asarray(vector, float)
    found = found / np.abs(found).max()  # squares of very large or small numbers are none
    return np.asarray(found / np.linalg.norm(found))


def _across(direction: np.ndarray) -> np.ndarray:
    """Return two unit vectors across a direction and each other (2, 3)."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])
