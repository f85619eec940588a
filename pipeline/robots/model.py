"""A robot: a pinocchio model of the planning group, its collision geometry and its symbolic kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError, unknown
from pipeline.robots import travel
from pipeline.robots.bodies import body_of
from pipeline.robots.mimic import Follower
from pipeline.robots.numbers import Numbers
from pipeline.robots.shapes import BodyShape
from pipeline.robots.symbolic import Pose, constant, joint_pose
from pipeline.robots.turning import Turning


@dataclass(frozen=True, eq=False)
class Robot:
    """Joints, limits and geometry of a planning group.

    Attributes:
        name: how reports and recordings call it.
        model: pinocchio model; every joint has one degree of freedom. Joints are in the order of the kinematic tree,
            variables need not be: that of a joint is q[model.idx_qs[joint]].
        geometry: collision geometry, with the self-collision pairs to check.
        lower, upper: joint limits (n,) [rad or m]; infinite for joints that turn. To draw from: see `box`.
        velocity: joint velocity limits (n,) [rad/s or m/s]; None where they are not known.
        rest: a configuration to begin with and to draw (n,); None where there is none.
        tool: the frame that constraints and goals speak of unless they name another; empty without one.
        base: names of the bodies that stand with the root link; they may touch what they stand on.
        touching: pairs of bodies by name that may touch, and how deep [m]; None for the usual depth (see `Validity`).
        turning: which variables turn without end, a turn later being the same place (n,); none unless given.
        placed: names of joints and frames that a task has put somewhere; all others are the description's.
        loaded: joints that carry masses of a task, by pinocchio's numbers.
        files: that it was read from.
    """

    name: str
    model: pin.Model
    geometry: pin.GeometryModel
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray | None = None
    rest: np.ndarray | None = None
    tool: str = ""
    base: frozenset[str] = frozenset()
    touching: Mapping[tuple[str, str], float | None] = field(default_factory=dict)
    followers: Mapping[str, Follower] = field(default_factory=dict)
    turning: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    placed: frozenset[str] = frozenset()
    loaded: frozenset[int] = frozenset()
    files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.turning):
            object.__setattr__(self, "turning", np.zeros(len(self.lower), bool))
        limited = self.turning & (np.isfinite(self.lower) | np.isfinite(self.upper))
        if limited.any():
            name = self.joint_names[int(np.argmax(limited))]
            raise RobotError(f"joint {name!r} of {self.name!r} has limits and turns without end; it can do one of both")

    @cached_property
    def turns(self) -> Turning | None:
        """How to measure where joints turn; None where none does."""
        return Turning(self.turning) if self.turning.any() else None

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (n,) and (n,) to draw configurations from [rad or m]: the limits, and one turn of joints that turn."""
        if not self.turning.any():
            return self.lower, self.upper
        return np.where(self.turning, -np.pi, self.lower), np.where(self.turning, np.pi, self.upper)

    @property
    def dimension(self) -> int:
        """Number of configuration variables n."""
        return int(self.model.nq)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in configuration order."""
        placed = zip(list(self.model.idx_qs)[1:], list(self.model.names)[1:], strict=True)
        return tuple(name for _, name in sorted(placed))

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the collision bodies."""
        return tuple(body.name for body in self.geometry.geometryObjects)

    def pieces_of(self, body: str) -> tuple[str, ...]:
        """Return the names of the collision bodies that a body is: its own or its pieces'; none where it is unknown."""
        return tuple(name for name in self.body_names if body in (name, body_of(name)))

    @cached_property
    def shapes(self) -> tuple[BodyShape, ...]:
        """The shapes of the collision bodies as checks take them."""
        return tuple(BodyShape(body.geometry) for body in self.geometry.geometryObjects)

    @cached_property
    def travel(self) -> float | None:
        """No point of a body moves farther than this times the joint distance, nor away from one of another body.

        None where a joint turns a body: bounds for arms are too wide for one check to stand for several.
        """
        return travel.sliding_bound(self)

    @cached_property
    def lever_arms(self) -> tuple[np.ndarray, np.ndarray]:
        """Lever arms of bodies (B, n) and of self-collision pairs (P, n), see `pipeline.robots.travel`."""
        arms = travel.lever_arms(self)
        return arms, travel.pair_arms(self, arms)

    def frame_id(self, frame: str) -> int:
        """Return pinocchio's number of a frame.

        Raises:
            RobotError: no such frame; names those there are.
        """
        if not self.model.existFrame(frame):
            raise RobotError(unknown(f"robot {self.name!r} has no frame", frame, [f.name for f in self.model.frames]))
        if self.model.existFrame(frame, pin.FrameType.BODY):  # a joint may have the name of its link
            return int(self.model.getFrameId(frame, pin.FrameType.BODY))
        return next(i for i, known in enumerate(self.model.frames) if known.name == frame)

    def pose(self, q: np.ndarray, frame: str) -> pin.SE3:
        """Return the pose of `frame` in the world at q (n,). Makes its own data: for use outside of planning.

        Raises:
            RobotError: no such frame.
        """
        number, data = self.frame_id(frame), self.model.createData()
        pin.forwardKinematics(self.model, data, np.asarray(q, float))
        return pin.SE3(pin.updateFramePlacement(self.model, data, number))

    def symbolic_pose(self, q: ca.SX, frame: str, numbers: Numbers | None = None) -> Pose:
        """Return rotation (3, 3) and position (3,) [m] of `frame` in the world as expressions of q (n,).

        Args:
            q: the configuration's symbol.
            frame: name.
            numbers: takes the places of what is in `placed`; without it they are constants of the expression.

        Raises:
            RobotError: no such frame, or a joint that is neither revolute nor prismatic.
        """
        target = self.model.frames[self.frame_id(frame)]
        place = self._place(target.name, target.placement, numbers)
        return self._joint(q, target.parentJoint, {}, numbers) @ place

    def symbolic_joint_poses(self, q: ca.SX, joints: Sequence[int], numbers: Numbers | None = None) -> list[Pose]:
        """Return the poses of joints' frames in the world as expressions of q (n,); joint 0 is the world itself."""
        known: dict[int, Pose] = {}
        return [self._joint(q, joint, known, numbers) for joint in joints]

    def symbolic_centre_of_mass(self, q: ca.SX, numbers: Numbers | None = None) -> ca.SX:
        """Return the centre of mass in the world (3,) [m] as an expression of q (n,).

        Of the bodies that move: what stands on the ground by itself needs no balance, and pinocchio leaves it out too.

        Args:
            q: the configuration's symbol.
            numbers: takes the masses of what `loaded` carries; without it they are constants of the expression.

        Raises:
            RobotError: the model has no mass.
        """
        inertias = {joint: inertia for joint, inertia in enumerate(self.model.inertias) if joint}
        total = sum(inertia.mass for inertia in inertias.values())
        if not total > 0:
            raise RobotError(f"robot {self.name!r} has no mass; its description needs <inertial> elements")
        known: dict[int, Pose] = {}
        moments = ca.SX.zeros(3)
        for joint, inertia in inertias.items():
            if inertia.mass > 0:
                number = ca.SX if numbers is None or joint not in self.loaded else numbers
                lever = self._joint(q, joint, known, numbers).apply(number(inertia.lever))
                moments += number(inertia.mass) * lever
        return moments / (total if numbers is None or not self.loaded else numbers(total))

    def _joint(self, q: ca.SX, joint: int, known: dict[int, Pose], numbers: Numbers | None = None) -> Pose:
        """Return the pose of a joint's frame in the world; `known` keeps those of the joints before it."""
        if joint not in known:
            if joint == 0:
                known[joint] = constant(pin.SE3.Identity())
            else:
                parent = self._joint(q, self.model.parents[joint], known, numbers)
                moved = joint_pose(self.name, self.model, joint, q[self.model.idx_qs[joint]])
                place = self._place(self.model.names[joint], self.model.jointPlacements[joint], numbers)
                known[joint] = parent @ place @ moved
        return known[joint]

    def _place(self, name: str, placement: pin.SE3, numbers: Numbers | None) -> Pose:
        return numbers.pose(placement) if numbers is not None and name in self.placed else constant(placement)


def point_robot(radius: float, lower: Sequence[float], upper: Sequence[float]) -> Robot:
    """Return a small ball on three prismatic joints: the point mass of the sphere environment.

    Args:
        radius: of the ball [m]; a point mass needs a positive radius for collision checking.
        lower: limits of x, y, z [m].
        upper: likewise.
    """
    if not radius > 0:
        raise RobotError(f"radius is {radius} m; a point robot needs a radius above 0 m")
    if not all(low < high for low, high in zip(lower, upper, strict=True)):
        raise RobotError(f"limits are {list(lower)} to {list(upper)} m; each lower one must be below its upper one")
    model = pin.Model()
    model.name = "point"
    joint = 0
    for name, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("z", pin.JointModelPZ())):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name)
    model.addFrame(pin.Frame("point", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    geometry = pin.GeometryModel()
    ball = pin.GeometryObject("point", joint, pin.SE3.Identity(), pin.hppfcl.Sphere(radius))
    geometry.addGeometryObject(ball)
    return Robot("point", model, geometry, np.asarray(lower, float), np.asarray(upper, float), tool="point")
