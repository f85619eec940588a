"""What goes into a recording, checked before any file is touched."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from pipeline.errors import ProblemError, RobotError
from pipeline.robots import Obstacle, Robot, Shape

WORLD = "world"  # root of every pose; the viewers' default name
JSON = ".json"  # ends the names of attachments that are read back as what they say, not as bytes
SHORTEST_STEP = 1e-6  # [s] given to a repeated state: far below a display frame, far above the 1 ns of the log clock


@dataclass(frozen=True)
class Recording:
    """A solved problem on its time axis.

    Attributes:
        robot: that moves.
        obstacles: of the scene, in the world frame; may be empty. Their order gives their ids.
        states: path (T, n) [rad or m], T >= 1.
        times: of the states (T,) [s], from 0, strictly increasing by at least 1 ns.
        tool: frame whose path is drawn.
        start, goal: configurations (n,), drawn as small balls at the tool's position.
        counters: planner counters and results; numbers keep their type. Measured times do not belong here: with them
            the same path would give other bytes each time.
        metadata: planner, sampler, adherence, scene, problem, seed, commit and the like.
        versions: of the packages that the path may depend on, by name.
        attachments: name -> JSON-able content, such as the configuration and the problem.
        files: name -> content of further attachments as they are, such as the robot's description. Names that end in
            `.json` are those of `attachments`.
        manifold_sphere_radius: of a sphere manifold about the world's origin [m]; None draws none.
    """

    robot: Robot
    obstacles: tuple[Obstacle, ...]
    states: np.ndarray
    times: np.ndarray
    tool: str
    start: np.ndarray
    goal: np.ndarray
    counters: Mapping[str, float | int | str] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    manifold_sphere_radius: float | None = None

    def check(self) -> None:
        """Refuse what no viewer could show or no reader could give back.

        Raises:
            ProblemError: a shape, a number, a time or a name is wrong; the message names the value and the bound.
            RobotError: the robot has no such tool frame, or bodies that share a name.
        """
        check_path(self.states, self.robot.dimension)
        for name, q in (("start", self.start), ("goal", self.goal)):
            if np.shape(q) != (self.robot.dimension,) or not np.isfinite(q).all():
                raise ProblemError(f"{name} is {q}; expected {self.robot.dimension} finite joint values")
        if np.shape(self.times) != (len(self.states),):
            raise ProblemError(f"times have shape {np.shape(self.times)}, the path has {len(self.states)} states")
        if not np.isfinite(self.times).all() or self.times[0] != 0 or self.times[-1] >= 2**63 / 1e9:
            raise ProblemError(
                f"times go from {self.times[0]} s to {self.times[-1]} s; it must be 0 s to a finite time"
            )
        clock = nanoseconds(self.times)
        for k in range(1, len(clock)):
            if clock[k] <= clock[k - 1]:
                raise ProblemError(
                    f"times[{k}] = {self.times[k]:.9f} s must come at least 1 ns after times[{k - 1}] = "
                    f"{self.times[k - 1]:.9f} s"
                )
        frames = moving_frames(self.robot)
        if self.tool not in frames:
            raise RobotError(f"robot {self.robot.name!r} has no frame {self.tool!r}; it has: {', '.join(frames)}")
        bodies = self.robot.body_names
        twice = sorted({name for name in bodies if bodies.count(name) > 1})
        if twice:
            raise RobotError(
                f"robot {self.robot.name!r} has bodies of the same name, of which viewers show one: {twice}"
            )
        for k, obstacle in enumerate(self.obstacles):
            numbers = np.array([*obstacle.position, *obstacle.quaternion, *obstacle.size], float)
            # A mesh's sizes are scales, of which negative ones mirror it.
            smallest = min(np.abs(obstacle.size) if obstacle.shape is Shape.MESH else obstacle.size)
            if not np.isfinite(numbers).all() or smallest <= 0 or not np.any(obstacle.quaternion):
                raise ProblemError(f"obstacle {k} is {obstacle}; it needs a finite pose and sizes above 0 m")
        radius = self.manifold_sphere_radius
        if radius is not None and not 0 < radius < np.inf:
            raise ProblemError(f"manifold_sphere_radius is {radius} m; it must be finite and above 0 m, or None")
        for name, kind, content in (
            ("counters", (str, int, float, np.integer, np.floating, np.bool_), self.counters),
            ("metadata", str, self.metadata),
            ("versions", str, self.versions),
            ("attachments", object, self.attachments),
            ("files", bytes, self.files),
        ):
            for key, value in content.items():
                if not all(map(isinstance, (key, value), (str, kind))):
                    raise ProblemError(f"{name} hold {key!r}: {value!r}, a {type(value).__name__}; see `Recording`")
        for key, value in self.attachments.items():
            attachment_text(key, value)
        for key in self.files:
            if key.endswith(JSON):
                raise ProblemError(f"files hold {key!r}; what ends in {JSON} belongs to the attachments")


def nanoseconds(times: np.ndarray) -> list[int]:
    """Return times (T,) [s] on the integer clock of MCAP [ns]."""
    return [round(1e9 * t) for t in np.asarray(times, float).tolist()]


def attachment_text(name: str, content: Any) -> str:
    """Return `content` as JSON whose text depends on the content only.

    Raises:
        ProblemError: it holds something JSON has no word for.
    """
    try:
        return json.dumps(content, indent=2, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"attachment {name!r} is not JSON-able: {error}") from None


def moving_frames(robot: Robot) -> dict[str, pin.Frame]:
    """Return name -> frame of all frames that a recording gives poses of; every body's joint has one among them.

    Where a joint and a link share a name, the link has it. A joint that has bodies and no frame gets one.
    """
    found: dict[str, pin.Frame] = {}
    for frame in robot.model.frames:
        # The root carries pinocchio's name or, in many URDFs, the very name of our parent frame.
        if frame.name not in ("universe", WORLD) and (frame.name not in found or frame.type == pin.FrameType.BODY):
            found[frame.name] = frame
    known = {frame.parentJoint for frame in found.values()}
    for joint in sorted({body.parentJoint for body in robot.geometry.geometryObjects} - known - {0}):
        name = f"joint/{robot.model.names[joint]}"
        found[name] = pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.JOINT)
    return found


def carrier(body: pin.GeometryObject, robot: Robot, frames: Mapping[str, pin.Frame]) -> tuple[str, pin.SE3]:
    """Return the name of the frame that a body is fixed in, and the body's pose there.

    Args:
        body: of the robot.
        robot: whose body it is.
        frames: its `moving_frames`.
    """
    if not body.parentJoint:
        return WORLD, body.placement
    beside = [name for name, frame in frames.items() if frame.parentJoint == body.parentJoint]
    own = robot.model.frames[body.parentFrame].name if body.parentFrame < robot.model.nframes else ""
    name = own if own in beside else beside[0]
    return name, frames[name].placement.actInv(body.placement)


def time_parameterise(path: np.ndarray, velocity: float) -> np.ndarray:
    """Return times (T,) [s] from 0 that walk a path (T, n) at uniform speed in the configuration space.

    Repeated states are `SHORTEST_STEP` apart, so that times always increase.

    Args:
        path: (T, n) [rad or m], T >= 1.
        velocity: Euclidean norm of the joint velocities [rad/s or m/s].

    Raises:
        ProblemError: the velocity is not finite and positive, or the path is empty or not finite.
    """
    check_path(path, None)
    if not 0 < velocity < np.inf:
        raise ProblemError(f"velocity is {velocity} rad/s; it must be finite and above 0")
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1) / velocity  # (T - 1,)
    return np.concatenate([[0.0], np.cumsum(np.maximum(steps, SHORTEST_STEP))])


def check_path(path: np.ndarray, dimension: int | None) -> None:
    """Refuse a path that is not (T, n) with T >= 1 finite states; any n when `dimension` is None."""
    shape = np.shape(path)
    if len(shape) != 2 or shape[0] < 1 or shape[1] != (shape[1] if dimension is None else dimension):
        columns = "n" if dimension is None else dimension
        raise ProblemError(f"the path has shape {shape}; expected (T, {columns}) with at least one state")
    if not np.isfinite(path).all():
        raise ProblemError(f"state {int(np.argmin(np.isfinite(path).all(axis=1)))} of the path is not finite")
