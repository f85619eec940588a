"""Tasks: what families of problems are made of, for benchmarks and the soak test."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.constraints import Condition, Constraint
from pipeline.errors import ConfigError
from pipeline.robots import Obstacle, Robot, UrdfRobot, Validity
from pipeline.verification.statement import Carried, ChainSaid, Joined, Saying, Statement, Term

# What start and goal keep from obstacles and from the robot itself [m], so that no planner's margin forbids them.
NEAR, NEAR_ITSELF = 0.02, 0.005


@dataclass(frozen=True)
class Task:
    """One start and goal, with all that a planner needs.

    Attributes:
        name: family, robot and number.
        robot: with what it holds and with the virtual joints of a chain.
        constraint, obstacles: what there is; every obstacle has a name.
        start, goal: configurations on the manifold (n,), free with a margin.
        says: what the constraint says, for peers that write it in their own way.
        touching: pairs (body, obstacle) that may touch.
        conditions: what else configurations must meet.
        carried: what the robot holds, as plain data.
        chain: regions whose end it holds; `says` has them too, as frames that are joined.
        terms: what the conditions say.
        tolerance: of ||F||.
    """

    name: str
    robot: Robot
    constraint: Constraint
    obstacles: tuple[Obstacle, ...]
    start: np.ndarray
    goal: np.ndarray
    says: tuple[Saying, ...]
    touching: tuple[tuple[str, str], ...] = ()
    conditions: tuple[Condition, ...] = ()
    carried: tuple[Carried, ...] = ()
    chain: ChainSaid | None = None
    terms: tuple[Term, ...] = ()
    tolerance: float = 1e-3

    def statement(self, robot: UrdfRobot | None) -> Statement:
        """Return what the task says, for the verifier; `robot` is what the family's robot is made of."""
        if robot is None:
            raise ConfigError(f"task {self.name!r} needs the settings of its robot to be verified")
        joined = None if self.chain is None else Joined(self.chain.end, self.chain.frame)
        return Statement(
            robot,
            tuple(saying for saying in self.says if saying != joined),
            self.tolerance,
            self.obstacles,
            self.carried,
            self.chain,
            dict.fromkeys(self.touching),
            self.terms,
        )

    def validity(self, margin: float = 0.0, self_margin: float = 0.0) -> Validity:
        """Return the checker that keeps `margin` from obstacles and conditions and `self_margin` between bodies [m]."""
        conditions = [condition.kept(margin) for condition in self.conditions]
        return Validity(self.robot, self.obstacles, margin, self_margin, self.touching, conditions)


class Family(Protocol):
    """Makes tasks of one kind, by seed and number."""

    def task(self, seed: int, number: int) -> Task:
        """Return task `number` of a seed; the same every time.

        Raises:
            ProblemError: no start and goal are found.
        """
        ...


def two_ends(
    draw: Callable[[], np.ndarray], accept: Callable[[np.ndarray], bool], apart: float, tries: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return two accepted configurations (n,) at least `apart` from each other [rad]; None after `tries` draws.

    Args:
        draw: gives configurations on the manifold (m, n).
        accept: says which may be a start or goal.
        apart: see above.
        tries: calls of `draw`.
    """
    first: np.ndarray | None = None
    for _ in range(tries):
        for q in draw():
            if first is not None and np.linalg.norm(q - first) <= apart:
                continue
            if not accept(q):
                continue
            if first is not None:
                return first, q
            first = q
    return None
