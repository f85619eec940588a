"""What a network is told of a task beside the scene: which kind it is of, and the numbers its constraint depends on.

Tasks are of one kind where joints and rows have the same names. What then differs is numbers: a height, where a hinge
stands, the distance of two hands. They are those that the constraint's expression takes as arguments, so that nobody
has to list them; what is the same in all tasks that were learned says nothing and is left out.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ProblemError
from pipeline.learning.codec import Codec
from pipeline.robots import Robot

_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])")  # in a label; joint2 has none
_SAME = 1e-6  # numbers nearer than this to each other count as one, for their size above 1


@dataclass(frozen=True)
class TaskKind:
    """Tasks whose joints and rows have the same names.

    Attributes:
        joints: names of the variables (n,).
        rows: labels of the constraint without the numbers in them (k,).
        codec: of their configurations.
        lower, upper: least and greatest value of each number of the constraint among the tasks that were learned (p,).
    """

    joints: tuple[str, ...]
    rows: tuple[str, ...]
    codec: Codec
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("joints", "rows", "lower", "upper"):  # lists, when they come from a file
            object.__setattr__(self, name, tuple(getattr(self, name)))

    @property
    def varying(self) -> list[int]:
        """Which numbers differ among tasks."""
        pairs = zip(self.lower, self.upper, strict=True)
        return [i for i, (low, high) in enumerate(pairs) if not _same(low, high)]

    def fits(self, robot: Robot, constraint: Constraint) -> bool:
        """Tell whether tasks of this robot and constraint are of this kind, whatever their numbers."""
        said = robot.joint_names, _rows(constraint), len(constraint.numbers)
        return said == (self.joints, self.rows, len(self.lower))

    def numbers(self, values: np.ndarray) -> np.ndarray:
        """Return those of a constraint's numbers (p,) that differ among tasks, from -1 to 1 where they were learned.

        Raises:
            ProblemError: a number that was the same in all tasks that were learned has another value.
        """
        for value, low, high in zip(values.tolist(), self.lower, self.upper, strict=True):
            if _same(low, high) and not _same(value, low):
                raise ProblemError(
                    f"a number of the constraint ({'; '.join(self.rows)}) is {value:g}, and {low:g} in all tasks that "
                    "the network has learned from: train it on tasks that differ in it"
                )
        least, most = (np.array(bound)[self.varying] for bound in (self.lower, self.upper))
        return np.asarray((2 * values[self.varying] - least - most) / (most - least))


def task_kinds(tasks: Sequence[tuple[Robot, Constraint]], centre: bool) -> tuple[TaskKind, ...]:
    """Return the kinds of tasks, given by robot and constraint, in the order in which they come.

    Args:
        tasks: at least one.
        centre: see `Codec`.
    """
    found: dict[tuple[object, ...], list[tuple[Robot, Constraint]]] = {}
    for robot, constraint in tasks:
        key = robot.joint_names, _rows(constraint), len(constraint.numbers), tuple(robot.turning.tolist())
        found.setdefault(key, []).append((robot, constraint))
    kinds = []
    for group in found.values():
        robot, constraint = group[0]
        numbers = np.array([other.numbers for _, other in group])
        lower, upper = tuple(numbers.min(axis=0).tolist()), tuple(numbers.max(axis=0).tolist())
        codec = Codec.of([other for other, _ in group], centre)
        kinds.append(TaskKind(robot.joint_names, _rows(constraint), codec, lower, upper))
    return tuple(kinds)


def kind_of(kinds: Sequence[TaskKind], robot: Robot, constraint: Constraint) -> int:
    """Return which of several kinds a task is of.

    Raises:
        ProblemError: it is of none.
    """
    for number, kind in enumerate(kinds):
        if kind.fits(robot, constraint):
            return number
    known = " or ".join(f"{'; '.join(kind.rows) or 'free space'} ({len(kind.joints)} joints)" for kind in kinds)
    raise ProblemError(
        f"the network has learned tasks of {known}, not of {'; '.join(constraint.labels) or 'free space'} with the "
        f"joints {', '.join(robot.joint_names)}"
    )


def task_input(kinds: Sequence[TaskKind]) -> int:
    """Return how many numbers `task_vector` has; 0 where all tasks are of one kind and differ in nothing."""
    return (len(kinds) if len(kinds) > 1 else 0) + max(len(kind.varying) for kind in kinds)


def task_vector(kinds: Sequence[TaskKind], number: int, values: np.ndarray) -> np.ndarray:
    """Return what a network is told of a task: of which kind it is, as 0 and 1, and what numbers it has (task_input,).

    Args:
        kinds: that the network knows.
        number: of the task's kind.
        values: of its constraint's numbers (p,).

    Raises:
        ProblemError: see `TaskKind.numbers`.
    """
    numbers = kinds[number].numbers(values)
    which = np.eye(len(kinds))[number] if len(kinds) > 1 else np.empty(0)
    padding = task_input(kinds) - len(which) - len(numbers)
    return np.concatenate([which, numbers, np.zeros(padding)])


def _rows(constraint: Constraint) -> tuple[str, ...]:
    return tuple(_NUMBER.sub("*", label) for label in constraint.labels)


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME * max(1.0, abs(one))
