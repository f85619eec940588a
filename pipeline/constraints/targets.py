"""Target sets: configurations that meet constraints and a target, with any number of rows.

A manifold to walk on has fewer rows than variables; a place where two of them meet may have as many, or more.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints.base import Constraint
from pipeline.constraints.conditions import Condition
from pipeline.constraints.regions import TaskSpaceRegion
from pipeline.constraints.turns import turns_on
from pipeline.constraints.within import Within
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot
from pipeline.robots.symbolic import rotation_vector
from pipeline.robots.turning import Turning

TARGET_TOLERANCE = 1e-3  # rows of a target are met within this [m and rad]
_NOISE = 0.2  # the first starts near a known configuration are this far off; later ones are farther [rad or m]

# What is wanted: values within bounds, as expressions of q (n,) that take numbers as arguments.
Target = Callable[[ca.SX, Numbers], Within]


def at_pose(robot: Robot, frame: str, wanted: pin.SE3) -> Target:
    """The frame is at a pose in the world."""

    def within(q: ca.SX, p: Numbers) -> Within:
        E = p.pose(wanted.inverse()) @ robot.symbolic_pose(q, frame, p)
        return Within.zero(ca.vertcat(E.position, rotation_vector(E.rotation)))

    return within


def in_region(robot: Robot, frame: str, region: TaskSpaceRegion) -> Target:
    """The frame is within the region's bounds."""
    return lambda q, p: region.within(robot.symbolic_pose(q, frame, p), p)


def with_values(values: Sequence[tuple[int, float]]) -> Target:
    """Joints, given by their index, have values [rad or m]."""
    return lambda q, p: Within.zero(ca.vertcat(*(q[i] - p(value) for i, value in values)))


class TargetSet(ABC):
    """Configurations within joint limits that meet all of some constraints, a target and conditions.

    Args:
        robot: whose configurations they are.
        constraints: one, or several whose intersection is meant; each is met within half its own tolerance. They may
            say the same thing twice, and have as many rows together as there are variables, or more.
        target: what else is wanted, met within 0.001 [m and rad].
        conditions: likewise, held with the margins they are `kept` with.

    Attributes:
        turns: joints whose turns change no constraint; None without any.
        tried: tries that `solutions` made.
        nearest: of all tries that failed: how far the best was from the target with its conditions, and ||F|| of the
            constraints; None before one failed.

    Raises:
        ConstraintError: a constraint or condition on another number of variables.
    """

    inset: float  # by which intervals are made smaller, so that what is met within the tolerance is inside

    def __init__(
        self,
        robot: Robot,
        constraints: Constraint | Sequence[Constraint],
        target: Target | None = None,
        conditions: Sequence[Condition] = (),
    ) -> None:
        self.robot, self.target, self.conditions = robot, target, tuple(conditions)
        self.constraints = (constraints,) if isinstance(constraints, Constraint) else tuple(constraints)
        asked: list[Constraint | Condition] = [*self.constraints, *self.conditions]
        if any(one.n != robot.dimension for one in asked):
            raise ConstraintError(
                f"a target set of {robot.name!r} needs constraints and conditions on its {robot.dimension} variables; "
                f"they have {[(one.name, one.n) for one in asked]}"
            )
        self._ends = np.cumsum([0, *(constraint.k for constraint in self.constraints)]).tolist()
        self.turns = self._turns()
        self.tried = 0
        self.nearest: tuple[float, float] | None = None

    @abstractmethod
    def solve(self, guess: np.ndarray, until: float = np.inf) -> np.ndarray | None:
        """Return a configuration (n,) of the set, found from a guess (n,); None where none is found.

        Gives up at a time `until` by time.perf_counter() [s].

        Raises:
            ConstraintError: a guess that is no finite configuration.
        """

    def solutions(
        self,
        rng: np.random.Generator,
        tries: int,
        near: np.ndarray | None = None,
        patience: int | None = None,
        until: float = np.inf,
    ) -> Iterator[np.ndarray]:
        """Yield configurations (n,); every other try starts near `near`, at first exactly there, the rest anywhere.

        Ends after `tries` tries, `patience` in a row that arrive nowhere, or, from the second try on, at a time `until`
        by time.perf_counter() [s]; `tried` counts them. Joints that turn have angles in (-pi, pi].
        """
        self.tried = failed = 0
        for i in range(tries):
            if failed == patience or (i and time.perf_counter() >= until):
                return
            self.tried = i + 1
            start = rng.uniform(*self.robot.box)
            if near is not None and i % 2 == 0:
                start = near + _NOISE * min(i / 10, 3.0) * rng.normal(size=len(near))
            found = self.solve(start, until if i else np.inf)
            failed = failed + 1 if found is None else 0
            if found is not None:
                yield found if self.turns is None else self.turns.canonical(found)

    def _within(self, q: ca.SX, numbers: Numbers) -> Within:
        """Return all that is asked: the constraints' rows, then the target's, then those of conditions."""
        equations = [Within.zero(constraint.rows(q, numbers)) for constraint in self.constraints]
        wanted = [] if self.target is None else [self.target(q, numbers)]
        for condition in self.conditions:
            k = len(condition.labels)
            wanted.append(Within(condition.rows(q, numbers), np.full(k, condition.margin), np.full(k, np.inf)))
        return Within.together(*equations, *(part.inset(self.inset) for part in wanted))

    def _met(self, outside: np.ndarray) -> bool:
        """Tell whether rows (m,), how far values are outside of their bounds, are within the tolerances.

        Where they are not, `nearest` keeps how near a try came, among configurations about on the constraints.
        """
        k, parts = self._ends[-1], zip(self.constraints, self._ends, self._ends[1:], strict=False)
        target, constraint = float(np.linalg.norm(outside[k:])), float(np.linalg.norm(outside[:k]))
        on_all = all(np.linalg.norm(outside[a:b]) < one.tolerance / 2 for one, a, b in parts)
        if on_all and target < TARGET_TOLERANCE:
            return True
        if np.isfinite(target + constraint) and max(target, constraint) < max(self.nearest or (np.inf,)):
            self.nearest = target, constraint
        return False

    def _begun(self, guess: np.ndarray) -> np.ndarray:
        """Return a guess (n,) within the limits."""
        if np.shape(guess) != (self.robot.dimension,) or not np.isfinite(guess).all():
            raise ConstraintError(
                f"a guess is {guess}; it must be {self.robot.dimension} finite numbers, as many as {self.robot.name!r} "
                "has variables"
            )
        return np.clip(guess, self.robot.lower, self.robot.upper)

    def _turns(self) -> Turning | None:
        mask = self.robot.turning.copy()
        for constraint in self.constraints:
            turns = turns_on(constraint, self.robot)
            mask &= turns.mask if turns is not None else False
        return Turning(mask) if mask.any() else None
