"""What a problem file says, as the verifier takes it: nothing here is made by what planning is made by."""

from typing import Any

import numpy as np

from pipeline.errors import ConfigError
from pipeline.problems.build import robot_settings
from pipeline.problems.file import ProblemFile
from pipeline.problems.parts import (
    BalancePart,
    ClosedChainPart,
    FeetPart,
    HeightPart,
    LinePart,
    PlanePart,
    PosePart,
    PositionPart,
    RegionPart,
    UprightPart,
)
from pipeline.problems.region import Region as RegionFile
from pipeline.robots import Placement, UrdfRobot
from pipeline.verification.kinematics import Kinematics, Place
from pipeline.verification.reader import led, read, resting
from pipeline.verification.statement import (
    Balanced,
    Carried,
    ChainSaid,
    InRegion,
    Joined,
    Level,
    OnLine,
    OnPlane,
    Pinned,
    Posed,
    Region,
    Saying,
    Statement,
    Term,
)

TOLERANCE = 1e-3  # of ||F||, which problem files do not set
_LEVEL = 1e-7  # cosine of a pitch below which roll and yaw are one


def statement_of(file: ProblemFile, start: np.ndarray) -> Statement:
    """Return what a problem file says of a path.

    Args:
        file: the problem.
        start: where the path begins (n,), of which only a chain's values count, where the file leaves them out.

    Raises:
        ConfigError, RobotError, ProblemError: whatever does not fit; the message names it.
    """
    settings = robot_settings(file)
    tool = settings.tool
    chain = None
    if file.chain is not None:
        regions = tuple(_region(region) for region in file.chain.regions)
        chain = ChainSaid(regions, file.chain.frame or tool, file.chain.name)
    carried = tuple(
        Carried(g.obstacle(file.folder), g.frame or tool, g.mass, g.depths("beside"), g.depths("touches"))
        for g in file.grasps
    )
    kinematics = read(Statement(settings, (), TOLERANCE, chain=chain))
    begin: np.ndarray | None = None
    if file.start.exact:
        begin = np.array(start, float)
        given = _given(file, settings, kinematics.names)
        begin[: len(given)] = given
    said = [said for part in file.parts() for said in _said(part, tool, _Start(kinematics, begin))]
    return Statement(
        settings,
        tuple(one for one in said if not isinstance(one, Term)),
        TOLERANCE,
        tuple(body.obstacle(file.folder) for body in file.obstacles),
        carried,
        chain,
        conditions=tuple(one for one in said if isinstance(one, Term)),
    )


class _Start:
    """Where frames are at the start, from which what an entry leaves open is taken."""

    def __init__(self, kinematics: Kinematics, q: np.ndarray | None) -> None:
        self.kinematics, self.q = kinematics, q

    def __call__(self, frame: str) -> Place:
        """Return the pose of a frame in the world.

        Raises:
            ConfigError: the start says no configuration.
            RobotError: no such frame.
        """
        if self.q is None:
            raise ConfigError("what is left open is taken from the start, which must be `configuration` or `joints`")
        R, p = self.kinematics.frame_poses(self.q[None], frame)
        return Place(R[0], p[0])

    def point(self, frame: str) -> tuple[float, ...]:
        """Return where the origin of a frame is in the world (3,) [m]."""
        return _plain(self(frame).p)


def _said(part: Any, tool: str, at_start: _Start) -> list[Saying | Term]:
    """Return what an entry of the list of constraints says."""
    frame = getattr(part, "frame", "") or tool
    match part:
        case UprightPart():
            axis = np.array(part.axis, float)
            direction = part.direction
            if direction is None:
                direction = _plain(at_start(frame).R @ axis)
            return [Level(frame, part.axis, direction)]
        case PlanePart():
            normal = np.array(part.normal, float)
            point = at_start.point(frame) if part.point is None else part.point
            return [OnPlane(frame, part.normal, float(normal @ np.array(point) / np.linalg.norm(normal)))]
        case HeightPart():
            return [OnPlane(frame, (0.0, 0.0, 1.0), at_start.point(frame)[2] if part.value is None else part.value)]
        case LinePart():
            return [OnLine(frame, at_start.point(frame) if part.point is None else part.point, part.direction)]
        case PositionPart():
            return [Pinned(frame, at_start.point(frame) if part.point is None else part.point)]
        case PosePart():
            return [Posed(frame, part.placement or _placement(at_start(frame)))]
        case RegionPart():
            return [InRegion(frame, _region(part))]
        case ClosedChainPart():
            relative = part.relative or _placement(at_start(frame).inverse() @ at_start(part.other))
            return [Joined(frame, part.other, relative)]
        case FeetPart():
            return [Pinned(foot, at_start.point(foot)) for foot in part.frames]
        case BalancePart():
            return [Balanced(tuple(at_start.point(foot) for foot in part.frames), part.margin)]
    raise ConfigError(f"the verifier does not know what a {type(part).__name__} says")


def _given(file: ProblemFile, settings: UrdfRobot, names: tuple[str, ...]) -> np.ndarray:
    """Return the values that the start says (m,), those of the arm or of all variables; others rest, or follow."""
    if file.start.configuration is not None:
        return np.array(file.start.configuration, float)
    joints, rest = file.start.joints or {}, resting(settings)
    return led(np.array([joints.get(n, value) for n, value in zip(names, rest, strict=False)], float), settings, joints)


def _region(region: RegionFile) -> Region:
    made = region.region()
    return Region(made.lower, made.upper, region.origin, region.offset)


def _placement(pose: Place) -> Placement:
    """Return a pose as files write it."""
    R = pose.R
    across = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = float(np.arctan2(-R[2, 0], across))
    if across < _LEVEL:
        return Placement(_plain(pose.p), (0.0, pitch, float(np.arctan2(-R[0, 1], R[1, 1]))))
    return Placement(_plain(pose.p), (float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))))


def _plain(vector: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in vector)
