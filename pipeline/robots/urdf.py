"""A robot from any URDF and SRDF: which joints are planned for, where the others stand, and which geometry counts."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

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
from pipeline.robots.model import Robot

_SLACK = 1e-6  # a named state may be rounded a little past a limit [rad or m]


@dataclass(frozen=True)
class UrdfRobot:
    """How a planning group is made of a URDF.

    Attributes:
        urdf: path, or `package://name/rest` (see `description.resolve`).
        joints: of the planning group. Configurations list them in the order of the kinematic tree.
        tool: frame that constraints and goals speak of.
        name: how reports call it.
        srdf: path or `package://`; empty without one.
        package_dirs: folders with packages that `package://` may name.
        rest: value of joints in the group at rest; joints it does not name are at 0, or at the middle of limits
            that leave out 0 [rad or m].
        fixed: where joints outside the group stand; those it does not name, as for `rest` [rad or m].
        state: a named state of the SRDF that `rest` and `fixed` fall back on; empty for none.
        geometry: what meshes become.
        ignored: further pairs of links that are not checked against each other.
        movable: fixed joints of the file that move after all, by name.
        floating: limits of a floating base's six virtual joints (`description.VIRTUAL`) [m, rad]; empty for a base
            that stands still.
        continuous: limit given to joints without limits, in both directions [rad].
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
    continuous: float = 2 * np.pi

    def __post_init__(self) -> None:
        require("robot.continuous", self.continuous, above=0, unit=" rad")

    def robot(self) -> Robot:
        """Read the files and return the planning group.

        Raises:
            RobotError: a file that is missing or malformed; a joint, frame, link or state that does not exist (the
                message names those there are); a value outside its joint's limits; limits that are not finite.
        """
        path = resolve(self.urdf, self.package_dirs)
        root = read_urdf(path, self.package_dirs)
        semantics = read_srdf(resolve(self.srdf, self.package_dirs)) if self.srdf else Semantics()
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
        followers = self._followers(root)
        bound_continuous(root, self.continuous)
        if self.floating:
            float_base(root, self.floating)
        text = ET.tostring(root, encoding="unicode")
        try:
            model = pin.buildModelFromXML(text)
            geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
        except Exception as error:  # what pinocchio's and assimp's C++ throw has no common class
            raise RobotError(f"{path} cannot be loaded: {str(error).strip()}") from None
        geometry = simplified(geometry, self.geometry)
        standing = self._standing(model, semantics, followers)
        locked = [model.getJointId(name) for name in list(model.names)[1:] if name not in self.joints]
        if locked:
            try:
                model, (geometry,) = pin.buildReducedModel(model, [geometry], locked, _configuration(model, standing))
            except ValueError as error:  # pinocchio takes no moving joint with the name of a link there
                raise RobotError(f"{path}: joints cannot be fixed: {error}; rename the joint or the link") from None
        model.name = self.name
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for name, low, high in zip(list(model.names)[1:], lower, upper, strict=True):
            if not np.isfinite([low, high]).all():
                raise RobotError(f"joint {name!r} of {self.name!r} has limits {low} and {high}; they must be finite")
        _add_pairs(model, geometry, (*semantics.disabled, *self.ignored), neighbours=bool(semantics.disabled))
        robot = Robot(
            self.name,
            model,
            geometry,
            lower,
            upper,
            velocity=np.where(model.velocityLimit > 0, model.velocityLimit, 1.0),  # exporters write 0 for none
            rest=np.array([standing[name] for name in list(model.names)[1:]]),
            tool=self.tool,
        )
        robot.frame_id(self.tool)
        return robot

    def _followers(self, root: ET.Element) -> dict[str, tuple[str, float, float]]:
        """Return joints that mimic others: the other's name, multiplier and offset."""
        found = {}
        for joint in root.findall("joint"):
            mimic = joint.find("mimic")
            if mimic is None:
                continue
            name, leader = str(joint.get("name")), str(mimic.get("joint"))
            if name in self.joints or leader in self.joints:
                raise RobotError(
                    f"joint {name!r} mimics {leader!r}: neither can be in the planning group of {self.name!r}, whose "
                    "joints move by themselves"
                )
            found[name] = leader, float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
        return found

    def _standing(
        self, model: pin.Model, semantics: Semantics, followers: Mapping[str, tuple[str, float, float]]
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
        for name, (leader, multiplier, offset) in followers.items():
            if name not in given and leader in given:
                given[name] = multiplier * given[leader] + offset
        standing = {}
        for name in names:
            joint = model.joints[model.getJointId(name)]
            if joint.nq != 1:
                continue
            low, high = (bounds[joint.idx_q] for bounds in (model.lowerPositionLimit, model.upperPositionLimit))
            middle = 0.0 if low <= 0 <= high else (low + high) / 2
            standing[name] = float(given.get(name, middle))
            if not low - _SLACK <= standing[name] <= high + _SLACK:
                raise RobotError(
                    f"joint {name!r} of {self.name!r} rests at {standing[name]}; its limits are {low} and {high}"
                )
        return standing


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
