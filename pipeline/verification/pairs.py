"""Which bodies are held against each other and how deep they may be in each other, read anew from the files."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import coal
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError, RobotError, unknown
from pipeline.robots.bodies import Geometry
from pipeline.robots.description import resolve
from pipeline.robots.obstacles import Obstacle
from pipeline.robots.urdf import UrdfRobot
from pipeline.spec.statement import Statement
from pipeline.verification.kinematics import WORLD, Body, Kinematics, Place
from pipeline.verification.shapes import Form, form_of, forms_of_body

_USUAL = 0.002  # depth of bodies that may touch [m], and
_SHARE = 0.1  # of the thinner one's least extent, at most
_HALF = 0.5  # of it, at most where another depth is said


@dataclass(frozen=True)
class Item:
    """A convex piece, or a mesh, that moves with a joint or stands.

    Attributes:
        name: of the body or obstacle.
        joint: number of the joint that moves it; WORLD where it stands.
        place: of its frame in the joint's (or the world's).
        form: its shape.
        body: number of the body of the robot; -1 for obstacles.
        base: whether it stands with the robot's root link.
    """

    name: str
    joint: int
    place: Place
    form: Form
    body: int
    base: bool = False


@dataclass(frozen=True)
class Pair:
    """Two items, by number, of which the first moves, and how deep they may be in each other [m]."""

    first: int
    second: int
    depth: float


def items_of_robot(kinematics: Kinematics, kind: Geometry) -> list[Item]:
    """Return the items of all bodies of a robot, and of what it carries."""
    found = []
    for number, body in enumerate(kinematics.bodies):
        if isinstance(body.geometry, Obstacle):
            forms = [(form_of(body.geometry), Place())]
        else:
            forms = forms_of_body(body.name, body.geometry, kind)
        found += [Item(body.name, body.joint, body.placement @ at, form, number, body.base) for form, at in forms]
    return found


def items_of_obstacles(obstacles: Sequence[Obstacle]) -> list[Item]:
    """Return the items of obstacles.

    Raises:
        ProblemError: a pose that is not finite, or a shape that cannot be.
    """
    found = []
    for number, obstacle in enumerate(obstacles):
        name = obstacle.name or f"obstacle {number}"
        if not np.isfinite([*obstacle.position, *obstacle.quaternion]).all():
            raise ProblemError(f"obstacle {name!r} is at {obstacle.position}, {obstacle.quaternion}: not finite")
        R = Rotation.from_quat(obstacle.quaternion).as_matrix()
        found.append(Item(name, WORLD, Place(R, np.array(obstacle.position, float)), form_of(obstacle), -1))
    return found


def pairs_of_bodies(statement: Statement, kinematics: Kinematics) -> list[tuple[int, int]]:
    """Return the pairs of bodies of a robot, by number, that are held against each other.

    All but: bodies of one joint, pairs of links that the SRDF disables or the robot's settings ignore, and, where the
    SRDF disables none, bodies of neighbouring joints. What is carried is held against all bodies of other joints.
    """
    apart, neighbours = set(), False
    if isinstance(statement.robot, UrdfRobot):
        disabled = disabled_pairs(statement.robot)
        apart = {frozenset(pair) for pair in (*disabled, *statement.robot.ignored)}
        neighbours = bool(disabled)
    parent = [joint.parent for joint in kinematics.joints]

    def next_to(one: Body, other: Body) -> bool:
        return any(a.joint != WORLD and parent[a.joint] == b.joint for a, b in ((one, other), (other, one)))

    found = []
    for i, one in enumerate(kinematics.bodies):
        for j, other in enumerate(kinematics.bodies[:i]):
            carried = isinstance(one.geometry, Obstacle) or isinstance(other.geometry, Obstacle)
            if one.joint == other.joint or (not carried and frozenset((one.link, other.link)) in apart):
                continue
            if carried or neighbours or not next_to(one, other):
                found.append((j, i))
    return found


def disabled_pairs(robot: UrdfRobot) -> list[tuple[str, str]]:
    """Return the pairs of links that the robot's SRDF disables; none without one."""
    if not robot.srdf:
        return []
    path = resolve(robot.srdf, robot.package_dirs)
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, OSError) as error:
        raise RobotError(f"{path} cannot be read: {error}") from None
    return [(str(found.get("link1")), str(found.get("link2"))) for found in root.iter("disable_collisions")]


def pairs_of_items(
    statement: Statement, kinematics: Kinematics, items: Sequence[Item], bodies: Sequence[tuple[int, int]]
) -> list[Pair]:
    """Return the pairs of items in which one moves: those of the robot's bodies, and its bodies against obstacles.

    Args:
        statement: the task.
        kinematics: of its robot.
        items: of robot and obstacles.
        bodies: pairs of bodies that are held against each other.

    Raises:
        ProblemError: a body or obstacle that does not exist, or a depth that is out of bounds or cannot be known.
    """
    of_body: dict[int, list[int]] = {}
    for number, item in enumerate(items):
        of_body.setdefault(item.body, []).append(number)
    obstacles = of_body.pop(-1, [])
    beside, touching = _may_touch(statement, kinematics, [items[i].name for i in obstacles])
    found = []
    for one, other in bodies:
        names = kinematics.bodies[one].name, kinematics.bodies[other].name
        asked = beside.get(names, beside.get(names[::-1], _NOT))
        for i in of_body[one]:
            for j in of_body[other]:
                first, second = (i, j) if items[i].joint != WORLD else (j, i)
                found.append(Pair(first, second, _depth(items[first], items[second], asked)))
    for i, item in enumerate(items):
        if item.body < 0 or item.joint == WORLD:
            continue
        for j in obstacles:
            found.append(Pair(i, j, _depth(item, items[j], touching.get((item.name, items[j].name), _NOT))))
    return found


_NOT = -1.0  # depth that stands for pairs that may not touch
_Depths = Mapping[tuple[str, str], float | None]


def touched(statement: Statement) -> _Depths:
    """Return which obstacles bodies may touch, and how deep [m]; None for the usual depth."""
    found = dict(statement.touching)
    for carried in statement.carried:
        found |= {(carried.body.name, other): depth for other, depth in carried.touches.items()}
    return found


def _may_touch(statement: Statement, kinematics: Kinematics, obstacles: Sequence[str]) -> tuple[_Depths, _Depths]:
    """Return the depths of pairs of bodies, and of bodies and obstacles, that may touch."""
    bodies = [body.name for body in kinematics.bodies]
    beside: dict[tuple[str, str], float | None] = {}
    touching = touched(statement)
    for carried in statement.carried:
        beside |= {(carried.body.name, other): depth for other, depth in carried.beside.items()}
    for names, there in (
        ([name for pair in beside for name in pair] + [body for body, _ in touching], bodies),
        ([obstacle for _, obstacle in touching], obstacles),
    ):
        for name in names:
            if name not in there:
                raise ProblemError(unknown("what may touch names", name, there))
    return beside, touching


def usual_depth(one: Form, other: Form) -> float:
    """Return how deep two bodies that may touch may be in each other unless a depth is said [m]."""
    return min(_USUAL, _SHARE * min(one.thickness, other.thickness))


def _depth(first: Item, second: Item, asked: float | None) -> float:
    if isinstance(first.form.shape, coal.OcTree) and isinstance(second.form.shape, coal.OcTree):
        raise ProblemError(f"{first.name!r} and {second.name!r} are both octrees, which coal always takes to meet")
    if asked == _NOT:
        return 0.0
    for item in (first, second):
        if not item.form.convex:
            raise ProblemError(
                f"{first.name!r} may touch {second.name!r}, but {item.name!r} is not convex: no depth of it is known"
            )
    if asked is None:
        return usual_depth(first.form, second.form)
    most = _HALF * min(first.form.thickness, second.form.thickness)
    if not 0 < asked <= most:
        raise ProblemError(
            f"{first.name!r} may touch {second.name!r} {asked} m deep; it must be above 0 m and at most {most:.4g} m"
        )
    return float(asked)
