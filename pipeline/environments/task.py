"""Tasks: what families of problems are made of, for benchmarks and the soak test."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.constraints import Condition, Constraint
from pipeline.robots import IDENTITY, Obstacle, Placement, Robot, Validity

# What start and goal keep from obstacles and from the robot itself [m], so that no planner's margin forbids them.
NEAR, NEAR_ITSELF = 0.02, 0.005


@dataclass(frozen=True)
class Level:
    """An axis of a frame (3,) keeps a direction of the world (3,)."""

    frame: str
    axis: tuple[float, ...]
    direction: tuple[float, ...]


@dataclass(frozen=True)
class Joined:
    """`other` keeps a pose in `frame`."""

    frame: str
    other: str
    relative: Placement = IDENTITY


@dataclass(frozen=True)
class Pinned:
    """The origin of a frame stays at a point of the world (3,) [m]."""

    frame: str
    point: tuple[float, ...]


@dataclass(frozen=True)
class OnPlane:
    """The origin of a frame keeps a distance [m] from the world's origin along a unit vector (3,)."""

    frame: str
    normal: tuple[float, ...]
    distance: float


@dataclass(frozen=True)
class OnTorus:
    """A point stays on a torus about the world's z axis [m]."""

    major: float
    minor: float


Saying = Level | Joined | Pinned | OnPlane | OnTorus


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
