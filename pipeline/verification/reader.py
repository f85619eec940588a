"""The robot of a statement: its planning group with what it holds and its chain, read from the files anew.

The rules are those that docs/problems.md states for robots; no code is planning's.
"""

from collections.abc import Collection, Iterator

import coal
import numpy as np

from pipeline.errors import RobotError, unknown
from pipeline.robots.description import resolve
from pipeline.robots.placement import Placement
from pipeline.robots.urdf import UrdfRobot
from pipeline.spec.statement import Carried, ChainSpec, Follows, Point, Statement
from pipeline.verification.centre import centre_of_mass
from pipeline.verification.kinematics import UNIVERSE, WORLD, Body, Joint, Kinematics, Masses, Place, turns
from pipeline.verification.urdf import Urdf, UrdfJoint, of_angles, read_states, read_urdf

_BASE = "base_world"  # the root link of a robot whose base moves
# Of a base that moves, and of a region: dimensions in the order of their joints from the world on, with their axes.
_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "yaw": (0, 0, 1), "pitch": (0, 1, 0), "roll": (1, 0, 0)}
_SIX = ("x", "y", "z", "roll", "pitch", "yaw")  # dimensions as a region lists them
_TURN = 2 * np.pi
_ROOM = 0.01  # of followers beyond what leaders leave them: an equation bounds them, within a tolerance [rad or m]


def read(statement: Statement) -> Kinematics:
    """Return the robot that a statement speaks of, with the chain's variables and the bodies that it carries.

    Raises:
        RobotError: a joint or frame that does not exist, or a file that cannot be read.
        ProblemError: the mesh of a carried body that cannot be read.
    """
    robot = statement.robot
    made = _Robot()
    if isinstance(robot, Point):
        made.add_point(robot)
    else:
        made.add_group(robot)
    if statement.chain is not None:
        made.add_chain(statement.chain)
    for carried in statement.carried:
        made.add_carried(carried)
    return made.kinematics()


class _Robot:
    """A robot in the making: joints in the order of the tree, variables in that of the path."""

    def __init__(self) -> None:
        self.joints: list[Joint] = []
        self.limits: dict[str, tuple[float, float]] = {}  # by the name of the variable, in the path's order
        self.bodies: list[Body] = []
        self.frames: dict[str, tuple[int, Place]] = {UNIVERSE: (WORLD, Place())}
        self.loads: list[tuple[int, float, np.ndarray]] = []  # joint, mass, centre in its frame

    def kinematics(self) -> Kinematics:
        mass, moment = np.zeros(len(self.joints)), np.zeros((len(self.joints), 3))
        for joint, load, centre in self.loads:
            if joint != WORLD:
                mass[joint] += load
                moment[joint] += load * centre
        lever = moment / np.where(mass > 0, mass, 1.0)[:, None]
        lower, upper = np.array(list(self.limits.values()), float).reshape(-1, 2).T
        turning = np.ones(len(self.limits), bool)
        turning[[joint.variable for joint in self.joints if joint.slides]] = False
        bodies, frames = tuple(self.bodies), dict(self.frames)
        masses = Masses(mass, lever)
        return Kinematics(tuple(self.limits), lower, upper, turning, tuple(self.joints), bodies, masses, frames)

    def add_joint(self, name: str, parent: int, placement: Place, axis: np.ndarray, slides: bool) -> int:
        self.joints.append(Joint(name, parent, placement, axis, slides, list(self.limits).index(name)))
        return len(self.joints) - 1

    def add_point(self, point: Point) -> None:
        self.limits.update(zip("xyz", zip(point.lower, point.upper, strict=True), strict=True))
        joint = WORLD
        for name in "xyz":
            joint = self.add_joint(name, joint, Place(), np.array(_AXES[name], float), slides=True)
        self.frames["point"] = (joint, Place())
        self.bodies.append(Body("point", "point", joint, Place(), coal.Sphere(point.radius)))

    def add_group(self, settings: UrdfRobot) -> None:
        urdf = read_urdf(resolve(settings.urdf, settings.package_dirs), settings.package_dirs).movable(settings.movable)
        based = {f"base_{name}": _endless(name, low, high) for name, (low, high) in settings.floating.items()}
        for name in settings.joints:
            if name not in urdf.joints and name not in based:
                raise RobotError(unknown("joints names a joint that does not exist:", name, [*urdf.joints, *based]))
            self.limits[name] = based[name] if name in based else _range(name, urdf, settings)
        standing = _standing(urdf, settings)
        parent, placement = WORLD, Place()
        if settings.floating:
            self.frames[_BASE] = (WORLD, Place())
            for direction, axis in _AXES.items():
                name = f"base_{direction}"
                slides = direction in "xyz"
                if name in self.limits:
                    parent = self.add_joint(name, parent, placement, np.array(axis, float), slides)
                    placement = Place()
                else:
                    placement = placement @ _moved(np.array(axis, float), slides, _middle(based[name], settings, name))
                self.frames[name] = (parent, placement)
                if direction != "roll":
                    self.frames[f"base_after_{direction}"] = (parent, placement)
        children: dict[str, list[UrdfJoint]] = {}
        for joint in urdf.joints.values():
            children.setdefault(joint.parent, []).append(joint)
        links = [(urdf.root, parent, placement, not settings.floating)]
        names: dict[str, tuple[int, Place]] = {}
        while links:
            link, parent, placement, base = links.pop()
            self._add_link(urdf, link, parent, placement, base)
            for joint in children.get(link, ()):
                at, number = placement @ joint.origin, parent
                if joint.name in self.limits:
                    number = self.add_joint(joint.name, parent, at, joint.axis, joint.kind == "prismatic")
                    at = Place()
                elif joint.moves:
                    at = at @ _moved(joint.axis, joint.kind == "prismatic", standing[joint.name])
                names[joint.name] = (number, at)
                links.append((joint.child, number, at, base and joint.kind == "fixed"))
        self.frames = {**names, **self.frames}  # a joint may have the name of a link, whose frame is meant then

    def _add_link(self, urdf: Urdf, link: str, joint: int, placement: Place, base: bool) -> None:
        self.frames[link] = (joint, placement)
        read = urdf.links[link]
        for name, origin, shape in read.bodies:
            self.bodies.append(Body(name, link, joint, placement @ origin, shape, base))
        self.loads.append((joint, read.mass, placement.R @ read.centre + placement.p))

    def add_chain(self, chain: ChainSpec) -> None:
        for name, bounds, *_ in _variables(chain):
            self.limits[name] = bounds
        parent, placement = WORLD, Place()
        for i, region in enumerate(chain.regions):
            placement = placement @ place(region.place)
            for direction, axis in _AXES.items():
                low, high = (bounds[_SIX.index(direction)] for bounds in (region.lower, region.upper))
                along, slides = np.array(axis, float), direction in "xyz"
                if low == high:
                    placement = placement @ _moved(along, slides, low)
                    continue
                parent = self.add_joint(f"{chain.name}_{i}_{direction}", parent, placement, along, slides)
                placement = Place()
            placement = placement @ place(region.end)
            self.frames[f"{chain.name}_{i}"] = (parent, placement)

    def add_carried(self, carried: Carried) -> None:
        if carried.frame not in self.frames:
            raise RobotError(unknown(f"{carried.body.name!r} is carried by a frame that does not exist:",
                                     carried.frame, self.frames))  # fmt: skip
        joint, at = self.frames[carried.frame]
        body = carried.body
        placement = at @ Place(body.rotation, np.array(body.position, float))
        self.bodies.append(Body(body.name, carried.frame, joint, placement, body))
        if carried.mass > 0:
            self.loads.append((joint, carried.mass, placement.R @ centre_of_mass(body) + placement.p))


def resting(settings: UrdfRobot) -> np.ndarray:
    """Return where the joints of a planning group rest (n,) [rad or m]."""
    urdf = read_urdf(resolve(settings.urdf, settings.package_dirs), settings.package_dirs).movable(settings.movable)
    given, found = _given(settings), []
    for name in settings.joints:
        base = settings.floating.get(name.removeprefix("base_")) if name not in urdf.joints else None
        low, high = base if base is not None else _range(name, urdf, settings)
        found.append(float(np.clip(given.get(name, _zero(low, high)), low, high)))
    return led(np.array(found), settings)


def follows(settings: UrdfRobot) -> tuple[Follows, ...]:
    """Return what the joints of a planning group follow that mimic another one of it."""
    urdf = read_urdf(resolve(settings.urdf, settings.package_dirs), settings.package_dirs)
    mimics = {name: urdf.joints[name].mimic for name in settings.joints if name in urdf.joints}
    return tuple(
        Follows(name, mimic.leader, mimic.multiplier, mimic.offset)
        for name, mimic in mimics.items()
        if mimic is not None
    )


def led(q: np.ndarray, settings: UrdfRobot, but: Collection[str] = ()) -> np.ndarray:
    """Return a configuration (n,) with followers where their leaders put them; those named in `but` stay."""
    q, at, said = q.copy(), settings.joints.index, follows(settings)
    for _ in said:  # followers of followers come right one after the other
        for one in said:
            if one.joint not in but:
                q[at(one.joint)] = one.multiplier * q[at(one.leader)] + one.offset
    return q


def place(placement: Placement) -> Place:
    """Return a pose of a file as this room has it."""
    return Place(of_angles(*placement.rpy), np.array(placement.xyz, float))


def _variables(chain: ChainSpec) -> Iterator[tuple[str, tuple[float, float]]]:
    """Give name and limits of a chain's variables: a free angle has none, and turns without end."""
    for i, region in enumerate(chain.regions):
        for direction in _AXES:
            low, high = (bounds[_SIX.index(direction)] for bounds in (region.lower, region.upper))
            if low == high:
                continue
            yield f"{chain.name}_{i}_{direction}", _endless(direction, low, high)


def _endless(direction: str, low: float, high: float) -> tuple[float, float]:
    """Return the limits of a direction; none of an angle that has a whole turn."""
    return (low, high) if direction in "xyz" or high - low < _TURN else (-np.inf, np.inf)


def _range(name: str, urdf: Urdf, settings: UrdfRobot) -> tuple[float, float]:
    """Return the limits of a joint of the group; of a follower those that its leader leaves it, and a little more."""
    joint = urdf.joints[name]
    if joint.mimic is None or joint.mimic.leader not in settings.joints:
        return _limits(joint, settings.continuous)
    bounds = (joint.mimic.multiplier * b + joint.mimic.offset for b in _range(joint.mimic.leader, urdf, settings))
    low, high = sorted(bounds)
    return low - _ROOM, high + _ROOM


def _limits(joint: UrdfJoint, continuous: float | None) -> tuple[float, float]:
    if not joint.moves:
        raise RobotError(f"joint {joint.name!r} is {joint.kind}; joints of a planning group turn or slide")
    most = np.inf if continuous is None else continuous
    return (-most, most) if joint.kind == "continuous" else (joint.lower, joint.upper)


def _standing(urdf: Urdf, settings: UrdfRobot) -> dict[str, float]:
    """Return where the joints stand that no variable moves [rad or m]: a leader puts its followers, whatever else."""
    given = _given(settings)
    found: dict[str, float] = {}

    def stand(name: str, on_the_way: tuple[str, ...] = ()) -> float:
        joint = urdf.joints.get(name)
        if name in settings.joints:
            raise RobotError(f"joint {on_the_way[-1]!r} mimics {name!r}, which is in `joints`: fix it")
        if name in on_the_way:
            raise RobotError(f"joints mimic each other in a loop: {', '.join((*on_the_way, name))}")
        if joint is None or not joint.moves:
            return 0.0
        if joint.mimic is None:
            return float(given.get(name, _zero(joint.lower, joint.upper)))
        if joint.mimic.leader not in urdf.joints and name in settings.fixed:
            return settings.fixed[name]
        return joint.mimic.multiplier * stand(joint.mimic.leader, (*on_the_way, name)) + joint.mimic.offset

    for joint in urdf.joints.values():
        if joint.moves and joint.name not in settings.joints:
            found[joint.name] = stand(joint.name)
    return found


def _given(settings: UrdfRobot) -> dict[str, float]:
    """Return the values that settings and SRDF put joints to [rad or m]."""
    states = read_states(resolve(settings.srdf, settings.package_dirs)) if settings.srdf and settings.state else {}
    return {**states.get(settings.state, {}), **settings.fixed, **settings.rest}


def _zero(low: float, high: float) -> float:
    """Return 0, or the middle of limits that leave it out."""
    return 0.0 if low <= 0 <= high else (low + high) / 2


def _middle(bounds: tuple[float, float], settings: UrdfRobot, name: str) -> float:
    return float(_given(settings).get(name, _zero(*bounds)))


def _moved(axis: np.ndarray, slides: bool, value: float) -> Place:
    """Return the pose that a joint at a value puts what comes after it in."""
    if slides:
        return Place(np.eye(3), axis * value)
    return Place(turns(axis, np.array([value]))[0], np.zeros(3))
