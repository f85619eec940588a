"""A robot from any URDF and SRDF: which joints are planned for, where the others stand, and which geometry counts."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError, require, unknown
from pipeline.robots.bodies import Geometry, simplified
from pipeline.robots.description import (
    Movable,
    Semantics,
    bound_continuous,
    float_base,
    make_movable,
    read_srdf,
    read_urdf,
    resolve,
)
from pipeline.robots.mimic import Follower, followed, leaders, take_followers, through
from pipeline.robots.model import Robot
from pipeline.robots.order import in_order
from pipeline.robots.semantics import check_semantics

_ROOM = 0.01  # of a follower beyond what its leader leaves it: its equation is met within a tolerance [rad or m]
_SLACK = 1e-6  # a named state may be rounded a little past a limit [rad or m]


@dataclass(frozen=True)
class UrdfRobot:
    """How a planning group is made of a URDF.

    Attributes:
        urdf: path, or `package://name/rest` (see `description.resolve`).
        joints: of the planning group, in the order of configurations. One that mimics another follows it by an equation
            of its own, whatever its own limits are; the joint it follows must be in the group as well, and so must all
            that follow a joint of the group.
        tool: frame that constraints and goals speak of.
        name: how reports call it.
        srdf: path or `package://`; empty without one.
        package_dirs: folders with packages that `package://` may name.
        rest: value of joints in the group at rest; joints it does not name are at 0, or at the middle of limits
            that leave out 0 [rad or m].
        fixed: where joints outside the group stand; those it does not name, as for `rest` [rad or m]. A joint that
            mimics another follows it: it need not be named, nor have limits, and must not be named with another value.
        state: a named state of the SRDF that `rest` and `fixed` fall back on; empty for none. Joints that mimic others
            follow them, whatever it says of them.
        geometry: what meshes become.
        ignored: further pairs of links that are not checked against each other.
        movable: fixed joints of the file that move after all, by name.
        floating: limits of a floating base's six virtual joints (`description.VIRTUAL`) [m, rad]; empty for a base
            that stands still. Angles whose limits are a turn or more apart turn without end.
        continuous: limit given to continuous joints, in both directions [rad], for what must not wind up (cables). None
            lets them turn without end: an angle and the same angle a turn later are one place.
    """

    urdf: str
    joints: tuple[str, ...]
    tool: str
    name: str
    srdf: str = ""
    package_dirs: tuple[str, ...] = ()
    rest: dict[str, float] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)
    state: str = ""
    geometry: Geometry = Geometry.PRIMITIVES
    ignored: tuple[tuple[str, ...], ...] = ()
    movable: dict[str, Movable] = field(default_factory=dict)
    floating: dict[str, tuple[float, ...]] = field(default_factory=dict)
    continuous: float | None = None

    def __post_init__(self) -> None:
        if self.continuous is not None:
            require("robot.continuous", self.continuous, above=0, unit=" rad")

    def robot(self) -> Robot:
        """Read the files and return the planning group.

        Raises:
            RobotError: a file that is missing or malformed; a joint, frame, link or state that does not exist (the
                message names those there are); a value outside its joint's limits; limits that are not finite or leave
                a joint of the group no range; a joint in the group whose leader is not in it, or a leader in the group
                whose followers are not.
        """
        path = resolve(self.urdf, self.package_dirs)
        root = read_urdf(path, self.package_dirs)
        semantics = Semantics()
        if self.srdf:
            srdf = resolve(self.srdf, self.package_dirs)
            semantics = read_srdf(srdf)
            check_semantics(semantics, srdf, root, self.state)
        for joint, movable in self.movable.items():
            make_movable(root, joint, movable)
        links = [str(link.get("name")) for link in root.findall("link")]
        for pair in self.ignored:
            if len(pair) != 2:
                raise RobotError(f"ignored of robot {self.name!r} has {list(pair)}; it must be pairs of links")
            for link in pair:
                if link not in links:
                    raise RobotError(
                        unknown(f"ignored of robot {self.name!r} names a link that does not exist:", link, links)
                    )
        followers = take_followers(root, path)
        continuous = bound_continuous(root, np.pi if self.continuous is None else self.continuous)
        endless = set(continuous if self.continuous is None else ())
        if self.floating:
            endless.update(float_base(root, self.floating))
        text = ET.tostring(root, encoding="unicode")
        try:
            model = pin.buildModelFromXML(text)
            geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
        except Exception as error:  # what pinocchio's and assimp's C++ throw has no common class
            raise RobotError(f"{path} cannot be loaded: {str(error).strip()}") from None
        coupled = {name: through(name, followers) for name in self.joints if name in followers}
        self._follow(model, coupled, endless)
        _unbound(model, endless)
        read = [str(path), *([str(resolve(self.srdf, self.package_dirs))] if self.srdf else [])]
        read += sorted({body.meshPath for body in geometry.geometryObjects if Path(body.meshPath).is_file()})
        geometry = simplified(geometry, self.geometry)
        base = frozenset(body.name for body in geometry.geometryObjects if not body.parentJoint)
        fastened = [str(joint.get("name")) for joint in root.findall("joint") if joint.get("type") == "fixed"]
        standing = self._standing(model, semantics, followers, fastened)
        locked = [model.getJointId(name) for name in list(model.names)[1:] if name not in self.joints]
        if locked:
            try:
                model, (geometry,) = pin.buildReducedModel(model, [geometry], locked, _configuration(model, standing))
            except ValueError as error:  # pinocchio takes no moving joint with the name of a link there
                raise RobotError(f"{path}: joints cannot be fixed: {error}; rename the joint or the link") from None
        model.name = self.name
        model = in_order(model, self.joints)
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for name, low, high in zip(self.joints, lower, upper, strict=True):
            if name not in endless and not np.isfinite([low, high]).all():
                raise RobotError(f"joint {name!r} of {self.name!r} has limits {low} and {high}; they must be finite")
            if low == high:
                raise RobotError(
                    f"joint {name!r} of {self.name!r} has limits {low} and {high}, which leave it no range: give its "
                    "<limit> a lower and an upper one (0 where left out), or leave the joint out of `joints`"
                )
        _add_pairs(model, geometry, (*semantics.disabled, *self.ignored), neighbours=bool(semantics.disabled))
        robot = Robot(
            self.name,
            model,
            geometry,
            lower,
            upper,
            velocity=np.where(model.velocityLimit > 0, model.velocityLimit, 1.0),  # exporters write 0 for none
            rest=np.clip([standing[name] for name in self.joints], lower, upper),
            tool=self.tool,
            base=base,
            followers=coupled,
            turning=np.array([name in endless for name in self.joints], bool),
            files=tuple(read),
        )
        robot.frame_id(self.tool)
        return robot

    def _follow(self, model: pin.Model, coupled: Mapping[str, Follower], endless: Collection[str]) -> None:
        """Give followers in the group the limits that their leaders leave them, and a little more: an equation holds.

        Raises:
            RobotError: a follower of a joint that turns without end.
        """
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for name, follower in coupled.items():
            if follower.leader not in self.joints:
                continue  # refused below, with a way out
            if follower.leader in endless or name in endless:
                raise RobotError(
                    f"joint {name!r} of {self.name!r} mimics {follower.leader!r}, one of which turns without end: set "
                    "`continuous`, the limit of such joints [rad]"
                )
            at, led = (model.joints[model.getJointId(joint)].idx_q for joint in (follower.leader, name))
            reached = sorted(follower.multiplier * bound + follower.offset for bound in (lower[at], upper[at]))
            lower[led], upper[led] = reached[0] - _ROOM, reached[1] + _ROOM
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper

    def _standing(
        self, model: pin.Model, semantics: Semantics, followers: Mapping[str, Follower], fastened: Collection[str]
    ) -> dict[str, float]:
        """Return where every joint with one degree of freedom stands at rest [rad or m]."""
        names = list(model.names)[1:]
        for what, asked in (("joints", self.joints), ("rest", self.rest), ("fixed", self.fixed)):
            for name in asked:
                if name not in names:
                    raise RobotError(
                        unknown(f"{what} of robot {self.name!r} names a joint that does not exist:", name, names)
                    )
        repeated = sorted({name for name in self.joints if self.joints.count(name) > 1})
        if repeated or not self.joints:
            raise RobotError(f"joints of robot {self.name!r} must be one or more, each once; repeated: {repeated}")
        for name in self.joints:
            joint = model.joints[model.getJointId(name)]
            if joint.nq != 1:
                raise RobotError(
                    f"joint {name!r} of {self.name!r} is a {joint.shortname()}; a planning group has revolute and "
                    "prismatic joints (a floating base: see `floating`)"
                )
        for here, there, name in (("rest", "fixed", n) for n in self.rest if n not in self.joints):
            raise RobotError(f"{here} names joint {name!r}, which is not in the planning group: name it in {there}")
        for here, there, name in (("fixed", "rest", n) for n in self.fixed if n in self.joints):
            raise RobotError(f"{here} names joint {name!r}, which is in the planning group: name it in {there}")
        states = semantics.states or {}
        if self.state and self.state not in states:
            raise RobotError(unknown(f"the SRDF of robot {self.name!r} has no state", self.state, states))
        given = {**states.get(self.state, {}), **self.fixed, **self.rest}
        standing: dict[str, float] = {}
        for name in names:
            joint = model.joints[model.getJointId(name)]
            if joint.nq != 1 or name in followers:
                continue
            low, high = (bounds[joint.idx_q] for bounds in (model.lowerPositionLimit, model.upperPositionLimit))
            middle = 0.0 if low <= 0 <= high else (low + high) / 2
            standing[name] = float(given.get(name, middle))
            if not low - _SLACK <= standing[name] <= high + _SLACK:
                raise RobotError(
                    f"joint {name!r} of {self.name!r} rests at {standing[name]}; its limits are {low} and {high}"
                )
        return standing | {name: self._following(name, followers, standing, fastened) for name in followers}

    def _following(
        self, name: str, followers: Mapping[str, Follower], standing: Mapping[str, float], fastened: Collection[str]
    ) -> float:
        """Return where a joint that mimics others stands [rad or m].

        Args:
            name: of the joint.
            followers: all that mimic others.
            standing: where the others stand.
            fastened: joints of the file that do not move; they are at 0.
        """
        led_by = leaders(name, followers)
        if name in self.joints and led_by[-1] not in self.joints:
            raise RobotError(
                f"joint {name!r} of {self.name!r} mimics {led_by[0]!r} and does not move by itself: leave it out of "
                f"`joints` and say where {led_by[-1]!r} stands in `fixed`"
            )
        if led_by[-1] in self.joints and name not in self.joints:
            raise RobotError(
                f"joint {name!r} mimics {led_by[0]!r}, but a variable of {self.name!r} moves one joint only: name "
                f"{name!r} in `joints` too, where it follows by an equation, or leave {led_by[-1]!r} out and say where "
                f"it stands in `fixed`; {name!r} follows it there"
            )
        if led_by[-1] not in standing and led_by[-1] not in fastened:
            if name in self.fixed:
                return self.fixed[name]
            raise RobotError(
                unknown(
                    f"joint {name!r} of {self.name!r} mimics a joint that does not exist (mend it, or say where "
                    f"{name!r} stands in `fixed`):",
                    led_by[-1],
                    [*standing, *fastened],
                )
            )
        value = followed(name, followers, standing)
        if abs(self.fixed.get(name, value) - value) > _SLACK:
            raise RobotError(
                f"fixed puts joint {name!r} of {self.name!r} at {self.fixed[name]}, but it mimics {led_by[0]!r} and "
                f"stands at {value}: leave it out, or say where {led_by[-1]!r} stands"
            )
        return value


def _unbound(model: pin.Model, names: Iterable[str]) -> None:
    """Take the limits from joints of a model."""
    for bounds, infinity in (("lowerPositionLimit", -np.inf), ("upperPositionLimit", np.inf)):
        values = np.array(getattr(model, bounds))
        values[[model.joints[model.getJointId(name)].idx_q for name in names]] = infinity
        setattr(model, bounds, values)


def _configuration(model: pin.Model, standing: Mapping[str, float]) -> np.ndarray:
    q = pin.neutral(model)
    for name, value in standing.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    return q


def _add_pairs(
    model: pin.Model, geometry: pin.GeometryModel, disabled: Iterable[tuple[str, ...]], neighbours: bool
) -> None:
    """Check all bodies against each other but those of one joint, disabled ones, and, unless asked, neighbours."""
    apart = {frozenset(pair) for pair in disabled}
    geometry.addAllCollisionPairs()
    links = [model.frames[body.parentFrame].name for body in geometry.geometryObjects]
    joints = [body.parentJoint for body in geometry.geometryObjects]
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    geometry.removeAllCollisionPairs()
    for i, j in pairs:
        next_to = model.parents[joints[i]] == joints[j] or model.parents[joints[j]] == joints[i]
        if (neighbours or not next_to) and frozenset((links[i], links[j])) not in apart:
            geometry.addCollisionPair(pin.CollisionPair(i, j))
