"""From a problem file to what planners take: robot, constraint, checker, start and goals."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.constraints import Constraint, feasible, turns_on
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.targets import Target, at_pose, in_region, with_values
from pipeline.errors import ProblemError, RobotError, told_apart, unknown
from pipeline.problems.file import ProblemFile, Where, choice
from pipeline.robots import ROBOTS, Obstacle, Robot, UrdfRobot, Validity
from pipeline.robots.description import is_file, resolve
from pipeline.robots.order import revolute
from pipeline.robots.turning import TURN, Turning, turns_within
from pipeline.spec.statement import Carried, ChainSpec, Inequality, Statement
from pipeline.tasks import Held, Setup, hold, set_up
from pipeline.verification.judge import Judge

_TRIES = 100  # of inverse kinematics per wanted configuration
_FROM_LIMITS = 1e-3  # a way that begins on a joint limit bends beyond it: only for want of anything else [rad or m]
_BARREN = 100  # tries in a row that arrive nowhere, or where others did, after which there is nothing more to find
_ROUNDED = 1e-6  # a given value so far beyond a limit is a rounded one, and taken at the limit [rad or m]
_SEARCHED = 10.0  # for a start or a goal, unless planning has more: most take a tenth of it [s]
_OFFERED = 100  # goals at most, turns included: each is a tree to be searched from
_LARGE = 10.0  # no arm's hand is so far away [m]: a pose there is in another unit
_MILLIMETRES = "; lengths are metres: are these millimetres?"
_DEGREES = "; angles are radians: are these degrees?"
_APART = 0.1  # goals nearer than this to each other count as one [rad or m]


@dataclass(frozen=True)
class Built:
    """A problem, ready to be planned.

    Attributes:
        setup: what is asked, with robot, constraint and scene.
        validity: the checker for planning, with margins.
        exact: the checker without margins.
        starts: configurations (S, n), any of which will do; one, where the file says it exactly.
        goals: configurations (G, n), the nearest to the first start first.
        asked: what the file says of the goal's joints (n,), NaN where it says nothing.
        notes: what was not taken exactly as the file says it.
    """

    setup: Setup
    validity: Validity
    exact: Validity
    starts: np.ndarray
    goals: np.ndarray
    asked: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def robot(self) -> Robot:
        """With the chain's virtual joints and what it holds."""
        return self.setup.robot

    @property
    def constraint(self) -> Constraint:
        """All equations."""
        return self.setup.constraint

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Of the scene."""
        return self.setup.obstacles

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the bodies that the robot holds."""
        return tuple(carried.body.name for carried in self.setup.statement.carried)


def build(file: ProblemFile) -> Built:
    """Make what the file describes.

    Raises:
        ConfigError, RobotError, ConstraintError, ProblemError: whatever does not fit; the message names it.
    """
    setup = set_up(statement_of(file))
    validity, exact = setup.validity(file.margin, file.self_margin), setup.validity()
    finder = _Finder(setup, validity, np.random.default_rng([file.seed, 1]), file.time_limit)
    starts = finder.find(file.start, "start", 1 if file.start.exact else file.goals, setup.robot.rest)
    start = starts[0]
    setup.constraint.frame(start)  # rows that depend on each other are named
    goals = finder.goals(file.goal, file.goals, start)
    return Built(setup, validity, exact, starts, goals, finder.asked, tuple(finder.notes))


def statement_of(file: ProblemFile) -> Statement:
    """Return what a problem file asks of every point of a path.

    Raises:
        ConfigError, RobotError, ConstraintError, ProblemError: whatever does not fit; the message names it.
    """
    settings, chain = robot_settings(file), None
    if file.chain is not None:
        regions = tuple(region.said() for region in file.chain.regions)
        chain = ChainSpec(regions, file.chain.frame or settings.tool, file.chain.name)
    carried = tuple(
        Carried(g.obstacle(file.folder), g.frame or settings.tool, g.mass, g.depths("beside"), g.depths("touches"))
        for g in file.grasps
    )
    obstacles = tuple(body.obstacle(file.folder) for body in file.obstacles)
    bare = Statement(settings, (), obstacles=obstacles, carried=carried, chain=chain)
    held = hold(bare)
    begin = _exact(file.start, held, "start") if file.start.exact else None
    said = [one for part in file.parts() for one in part(held.robot, begin)]
    equations = tuple(one for one in said if not isinstance(one, Inequality))
    return replace(bare, equations=equations, conditions=tuple(one for one in said if isinstance(one, Inequality)))


def robot_settings(file: ProblemFile) -> UrdfRobot:
    """Return the robot of a problem as settings whose files are found from anywhere.

    Raises:
        ConfigError: no such robot, or settings that are misspelt.
        RobotError: the problem's own robot names a file that is missing.
    """
    settings: UrdfRobot = choice(file.robot, "robot").make(ROBOTS, "robot")
    if isinstance(file.robot, str):
        return settings
    # The content is the problem file's own: what it names is beside it.
    urdf, srdf = (_beside(address, file.folder) for address in (settings.urdf, settings.srdf))
    folders = tuple(str(file.folder / folder) for folder in settings.package_dirs)  # an absolute one stays as it is
    return replace(settings, urdf=urdf, srdf=srdf, package_dirs=(*folders, *settings.package_dirs))


def sound(judge: Judge, ends: np.ndarray, name: str) -> np.ndarray:
    """Return those of several starts or goals (S, n) that the verifier passes: no search can mend the others.

    Raises:
        ProblemError: it passes none; the message says why it refuses the first.
    """
    verdicts = [judge.verify(q[None], q, q) for q in ends]
    passed = [verdict.passed for verdict in verdicts]
    if not any(passed):
        raise ProblemError(f"{name}: the verifier refuses it: {verdicts[0].message}")
    return ends[passed]


class _Finder:
    """Turns what a file says of a start or goal into configurations.

    Several of a start as well: limits and bodies keep parts of the manifold apart (elbow up, elbow down), and one
    configuration may lie in a part without a goal.
    """

    def __init__(self, setup: Setup, validity: Validity, rng: np.random.Generator, time_limit: float) -> None:
        self.held, self.arm, self.robot, self.constraint = setup.held, setup.held.arm, setup.robot, setup.constraint
        self.validity, self.rng, self.time_limit = validity, rng, time_limit
        constraint, robot = self.constraint, self.robot
        self.turns = turns_on(constraint, robot)
        # Joints with limits between which there is a turn or more: what a goal says of them has several answers.
        self.winding = revolute(robot.model) & ~robot.turning & (robot.upper - robot.lower >= TURN)
        angles = self.winding if self.turns is None else self.winding | self.turns.mask
        self.goal_turns = Turning(angles) if angles.any() else None  # what differs by these is one goal
        self.asked = np.full(robot.dimension, np.nan)  # of the goal's joints
        self.notes: list[str] = []

    def goals(self, where: Where, count: int, start: np.ndarray) -> np.ndarray:
        """Return what `find` does for a goal, at all turns within the limits, those nearest to `start` first (m, n)."""
        offered: list[tuple[int, float, np.ndarray]] = []
        for q in self.find(where, "goal", count, start):
            turned = turns_within(q, self.robot.lower, self.robot.upper, self.winding, start, _OFFERED)
            inside = [other for other in turned if self.constraint.satisfied(other)]
            kept = [other for other in inside if np.array_equal(other, q) or not self._on_limit(other)] or [q]
            offered += [(rank, float(_distances(other, start, self.turns)), other) for rank, other in enumerate(kept)]
        offered.sort(key=lambda one: one[:2])  # of each its nearest turn before any one's next
        return np.array([q for _, _, q in sorted(offered[:_OFFERED], key=lambda one: one[1])])

    def find(self, where: Where, name: str, count: int, near: np.ndarray | None) -> np.ndarray:
        """Return one exact configuration, or up to `count` valid ones for a pose or region (m, n)."""
        if where.exact:
            q = _exact(where, self.held, name)
            q = self.constraint.project(q).q if where.project else q
            return self._within(range(len(q)), q, name)[None]
        inverse = InverseKinematics(self.robot, self.constraint, self._target(where, name))
        found: list[np.ndarray] = []
        on_limit: list[np.ndarray] = []
        reached: list[np.ndarray] = []
        barren = 0
        turns = self.goal_turns if name == "goal" else self.turns
        until = time.perf_counter() + max(self.time_limit, _SEARCHED)
        for q in inverse.solutions(self.rng, _TRIES * count, near, _BARREN, until):
            barren = 0 if _apart(q, reached, turns) else barren + 1
            if barren == _BARREN:
                break
            reached.append(q)
            if _apart(q, found, turns) and self.validity.free(q):
                if self._on_limit(q):
                    on_limit.append(q)
                    continue
                found.append(q)
                if len(found) == count:
                    break
        found = found or on_limit[:1]
        tries = inverse.tried
        if not reached:
            feasible(self.constraint, *self.robot.box, self.rng)  # names the rows that cannot be met
            raise ProblemError(
                f"{name}: inverse kinematics found no configuration there that is within the joint limits and on "
                f"the manifold {self.constraint.name!r}, in {tries} tries; the nearest is {_off(inverse.nearest)}"
                f"{_units(where)}"
            )
        if not found:
            raise ProblemError(
                f"{name}: {len(reached)} of {tries} tries of inverse kinematics arrived there, and none is valid; the "
                f"first is {self.validity.reason(reached[0])}"
            )
        return np.array(found)

    def _on_limit(self, q: np.ndarray) -> bool:
        """Tell whether a joint of the arm is about at one of its limits."""
        n = self.arm.dimension
        return bool(min((q - self.robot.lower)[:n].min(), (self.robot.upper - q)[:n].min()) < _FROM_LIMITS)

    def _target(self, where: Where, name: str) -> Target:
        frame = where.frame or self.robot.tool
        if where.pose is not None:
            return at_pose(self.robot, frame, where.pose.se3())
        if where.region is not None:
            return in_region(self.robot, frame, where.region.region())
        values = where.values or {}
        names = self.robot.joint_names
        for joint in values:
            if joint not in names:
                raise ProblemError(unknown(f"{name} names a joint that {self.robot.name!r} lacks:", joint, names))
        numbers = [names.index(joint) for joint in values]
        asked = self._within(numbers, np.array(list(values.values())), name)
        if self.turns is not None:  # inverse kinematics does not go far
            canonical = self.turns.canonical(_filled(asked, numbers, self.robot.dimension))
            asked = canonical[numbers]
        return with_values(list(zip(numbers, asked.tolist(), strict=True)))

    def _within(self, joints: Sequence[int], values: np.ndarray, name: str) -> np.ndarray:
        """Return values (m,) of some joints, at the limit those that are a rounding beyond it, of which `notes` tell.

        A goal's value that is farther beyond is taken at a turn within the limits, where there always is one.

        Raises:
            ProblemError: one that is farther beyond its limit, or not finite.
        """
        low, high = self.robot.lower[list(joints)], self.robot.upper[list(joints)]
        kept = np.clip(values, low, high)
        if name == "goal":
            self.asked[list(joints)] = values
        for i, (joint, asked, least, most) in enumerate(zip(joints, values, low, high, strict=True)):
            taken = kept[i]
            if asked == taken:
                continue
            if name == "goal" and self.winding[joint] and _ROUNDED < abs(asked - taken) < np.inf:
                turns = np.ceil((asked - most) / TURN) if asked > most else np.floor((asked - least) / TURN)
                kept[i] = asked - TURN * turns
                continue
            said, lower, upper = told_apart(asked, least, most)
            outside = f"{name}: joint {self.robot.joint_names[joint]} is {said}, outside its limits [{lower}, {upper}]"
            if not abs(asked - taken) <= _ROUNDED:
                raise ProblemError(f"{outside}{_DEGREES if TURN < abs(asked) < np.inf else ''}")
            self.notes.append(f"{outside}: taken at the limit")
        return kept


def _distances(Q: np.ndarray, q: np.ndarray, turns: Turning | None) -> np.ndarray:
    """Return how far configurations Q (..., n) are from q (n,) [rad or m]."""
    return np.asarray(np.linalg.norm(Q - q, axis=-1)) if turns is None else turns.distances(Q, q)


def _apart(q: np.ndarray, others: list[np.ndarray], turns: Turning | None) -> bool:
    return not others or bool(_distances(np.array(others), q, turns).min() > _APART)


def _filled(values: np.ndarray, places: Sequence[int], size: int) -> np.ndarray:
    """Return a vector (size,) that has values (m,) at some places and zeros at the others."""
    whole = np.zeros(size)
    whole[list(places)] = values
    return whole


def _off(nearest: tuple[float, float] | None) -> str:
    """Say how far off a try of inverse kinematics is."""
    if nearest is None:
        return "none"
    return f"{nearest[0]:.3g} (m and rad) from the target and ||F|| = {nearest[1]:.3g} from the manifold"


def _units(where: Where) -> str:
    """Ask about the units of a pose or region that nothing reaches, whose numbers look unlike [m] and [rad]."""
    lengths: list[float] = []
    angles: list[float] = []
    if where.pose is not None:
        lengths, angles = [*where.pose.xyz], [*where.pose.rpy]
    elif where.region is not None:
        lower, upper = np.array(where.region.region().lower), np.array(where.region.region().upper)
        lengths, angles = [*lower[:3], *upper[:3]], [*lower[3:], *upper[3:]]
    far = any(_LARGE < abs(v) < np.inf for v in lengths)
    return (_MILLIMETRES if far else "") + (_DEGREES if any(TURN < abs(v) < np.inf for v in angles) else "")


def _beside(address: str, folder: Path) -> str:
    """The file that a problem in `folder` names by a path: beside the problem, or else relative to the caller."""
    if not address or address.startswith("package://"):
        return address
    try:
        return str(resolve(address, (), folder))
    except RobotError:
        if is_file(Path(address)):
            return address
        raise


def _exact(where: Where, held: Held, name: str) -> np.ndarray:
    """The configuration a file gives, with the chain's values where it leaves them out."""
    arm, chain = held.arm, held.chain
    if where.joints is not None:
        for joint in where.joints:
            if joint not in arm.joint_names:
                raise ProblemError(unknown(f"{name} names a joint that {arm.name!r} lacks:", joint, arm.joint_names))
        rest = np.zeros(arm.dimension) if arm.rest is None else arm.rest
        values = {j: where.joints.get(j, r) for j, r in zip(arm.joint_names, rest.tolist(), strict=True)}
        for joint, follower in arm.followers.items():
            if joint not in where.joints:
                values[joint] = follower.multiplier * values[follower.leader] + follower.offset
        q = np.array(list(values.values()), float)
    else:
        q = np.array(where.configuration, float)
    sizes = [arm.dimension] + ([chain.robot.dimension] if chain is not None else [])
    if len(q) not in sizes or not np.isfinite(q).all():
        raise ProblemError(
            f"{name} has {len(q)} joint values; {arm.name!r} has {' or, with the chain, '.join(map(str, sizes))} "
            f"joints, and values must be finite: {', '.join(arm.joint_names)}"
        )
    if chain is not None and len(q) == arm.dimension:
        q = np.concatenate([q, chain.values(q)[0]])
    return q
