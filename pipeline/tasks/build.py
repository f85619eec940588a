"""From what is asked to what planners take. Robots are read once, and whatever tasks share is shared.

Reading a robot takes a third of a second and compiling its constraint up to eight, while a scene is made in
milliseconds: so everything here is kept by what it follows from.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pipeline.constraints import Chain, Condition, Constraint, Unconstrained, chain, following, intersection
from pipeline.constraints.torus import TorusMaze
from pipeline.files import Stamp, stamps, unchanged
from pipeline.keys import digest
from pipeline.robots import Obstacle, Robot, UrdfRobot, Validity, attach, point_robot
from pipeline.spec.statement import Equation, Follows, Joined, Point, Statement
from pipeline.spec.task import Leg
from pipeline.tasks.equations import condition_of, constraint_of, region_of

_MOST = 32  # robots, and robots with what they hold, that are kept: those of the last tasks
Made = TypeVar("Made")


@dataclass(frozen=True)
class Held:
    """A robot with what it holds.

    Attributes:
        arm: as its description has it.
        robot: with the chain's virtual joints and the bodies it carries.
        chain: that it holds the end of.
        touching: pairs of a carried body and an obstacle that may touch, and how deep [m]; None for the usual depth.
        key: no two have the same.
    """

    arm: Robot
    robot: Robot
    chain: Chain | None
    touching: dict[tuple[str, str], float | None]
    key: int


@dataclass(frozen=True)
class Setup:
    """What a statement asks of configurations, ready to be planned with.

    Attributes:
        statement: what is asked.
        held: the robot, and what it holds.
        constraint: all equations.
        conditions: what else configurations must meet.
    """

    statement: Statement
    held: Held
    constraint: Constraint
    conditions: tuple[Condition | TorusMaze, ...]

    @property
    def robot(self) -> Robot:
        """With the chain's virtual joints and what it holds."""
        return self.held.robot

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Of the scene."""
        return self.statement.obstacles

    @property
    def equations(self) -> tuple[Equation, ...]:
        """All equations; of a chain that its end and the frame that holds it are one."""
        chain = self.statement.chain
        return (*(() if chain is None else (Joined(chain.end, chain.frame),)), *self.statement.equations)

    @cached_property
    def touching(self) -> dict[tuple[str, str], float | None]:
        """Pairs (body, obstacle) that may touch, and how deep [m]; None for the usual depth."""
        return {**self.held.touching, **self.statement.touching}

    def validity(self, margin: float = 0.0, self_margin: float = 0.0) -> Validity:
        """Return the checker that keeps `margin` from obstacles and conditions and `self_margin` between bodies [m]."""
        conditions = [condition.kept(margin) for condition in self.conditions]
        return Validity(self.robot, self.obstacles, margin, self_margin, self.touching, conditions)


@dataclass(frozen=True)
class Task(Setup):
    """A leg of a task, ready to be planned.

    Attributes:
        leg: what is asked, with starts and goals.
    """

    leg: Leg

    @property
    def start(self) -> np.ndarray:
        """The first start (n,)."""
        return self.leg.start

    @property
    def goal(self) -> np.ndarray:
        """The first goal (n,)."""
        return self.leg.goal


def build(leg: Leg) -> Task:
    """Make what a leg asks for. Raises as `set_up` does."""
    made = set_up(leg.statement)
    return Task(made.statement, made.held, made.constraint, made.conditions, leg)


def set_up(statement: Statement) -> Setup:
    """Make what a statement asks for.

    Raises:
        ConfigError, RobotError, ConstraintError, ProblemError: whatever does not fit; the message names it.
    """
    held = hold(statement)
    return Setup(statement, held, _constraint(statement, held), _conditions(statement, held))


def robot_of(settings: UrdfRobot | Point) -> Robot:
    """Return the robot of settings; the same one for the same settings."""

    def make() -> Robot:
        if isinstance(settings, Point):
            return point_robot(settings.radius, settings.lower, settings.upper)
        return settings.robot()

    return _ROBOTS.get(digest(settings, str(Path.cwd())), make, lambda robot: robot.files)


def hold(statement: Statement) -> Held:
    """Return the robot of a statement with what it holds; the same one for statements that say the same of it."""
    key = digest(statement.robot, statement.chain, statement.carried, str(Path.cwd()))  # which paths may begin at
    return _HELD.get(key, lambda: _hold(statement), lambda held: held.robot.files)


def _hold(statement: Statement) -> Held:
    arm = robot = robot_of(statement.robot)
    held: Chain | None = None
    if statement.chain is not None:
        regions = [region_of(region) for region in statement.chain.regions]
        held = chain(arm, regions, statement.chain.frame, statement.chain.name, tolerance=statement.tolerance)
        robot = held.robot
    touching: dict[tuple[str, str], float | None] = {}
    for carried in statement.carried:
        robot = attach(robot, carried.body, carried.frame, carried.beside, carried.mass)
        if carried.body.file:
            robot = replace(robot, files=(*robot.files, carried.body.file))
        touching |= {(carried.body.name, name): depth for name, depth in carried.touches.items()}
    return Held(arm, robot, held, touching, next(_NUMBERS))


def _constraint(statement: Statement, held: Held) -> Constraint:
    """Return all equations of a statement; the same constraint for statements that say the same of it."""
    said = [equation for equation in statement.equations if not isinstance(equation, Follows)]

    def make() -> Constraint:
        parts = [held.chain.constraint] if held.chain is not None else []
        parts += [following(held.robot, tolerance=statement.tolerance)] if held.robot.followers else []
        parts += [constraint_of(held.robot, equation, statement.tolerance) for equation in said]
        if not parts:
            return Unconstrained(held.robot.dimension, statement.tolerance)
        return parts[0] if len(parts) == 1 else intersection(*parts)

    return _CONSTRAINTS.get((held.key, digest(said, statement.tolerance)), make)


def _conditions(statement: Statement, held: Held) -> tuple[Condition | TorusMaze, ...]:
    """Return the conditions of a statement; the same ones for statements that say the same of it."""

    def make() -> tuple[Condition | TorusMaze, ...]:
        return tuple(condition_of(held.robot, inequality) for inequality in statement.conditions)

    return _CONDITIONS.get((held.key, digest(statement.conditions)), make)


class _Kept:
    """What was made last, by what it follows from, for as long as the files that it was read from are the same."""

    def __init__(self) -> None:
        self._made: OrderedDict[Hashable, tuple[Any, tuple[Stamp, ...]]] = OrderedDict()

    def get(
        self, key: Hashable, make: Callable[[], Made], files: Callable[[Made], Iterable[str]] | None = None
    ) -> Made:
        """Return what is kept for a key; make it where there is nothing, or where a file it was read from changed."""
        if key not in self._made or not unchanged(self._made[key][1]):
            made = make()
            self._made[key] = made, () if files is None else stamps(files(made))
            if len(self._made) > _MOST:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        found: Made = self._made[key][0]
        return found

    def clear(self) -> None:
        self._made.clear()


_NUMBERS = count()
_ROBOTS, _HELD, _CONSTRAINTS, _CONDITIONS = _Kept(), _Kept(), _Kept(), _Kept()


def forget() -> None:
    """Make everything anew from now on."""
    for kept in (_ROBOTS, _HELD, _CONSTRAINTS, _CONDITIONS):
        kept.clear()
