"""What a network is told of a task beside the scene: which kind it is of, and the numbers its constraint depends on.

Tasks are of one kind where the robot is the same, and the joints and rows have the same names. What then differs is
numbers: a height, where a hinge stands, the distance of two hands. They are those that the constraint was made of
(`Numbers.said`), so that nobody has to list them; what is the same in all tasks that were learned says nothing and is
left out.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, ProblemError
from pipeline.keys import digest
from pipeline.learning.codec import Codec
from pipeline.robots import Robot

_NUMBERS = re.compile(r"\[[-+\d., e]+\]")  # in a label: a direction; names of frames keep theirs
_SAME = 1e-4  # numbers nearer than this to each other count as one, for their size above 1: less is no other task
_FARTHEST = 3.0  # a number that far outside of those that were learned, from -1 to 1, is no longer like them
_DECIMALS = 9  # of places [m], as what is read from another file of the same robot may differ in the last ones


@dataclass(frozen=True)
class TaskKind:
    """Tasks of one robot whose joints and rows have the same names.

    Attributes:
        joints: names of the variables (n,).
        rows: labels of the constraint without the numbers in them (k,).
        kinematics: of the robot, see `kinematics_key`.
        codec: of configurations.
        lower, upper: least and greatest value of each number of the constraint among the tasks that were learned (s,).
    """

    joints: tuple[str, ...]
    rows: tuple[str, ...]
    kinematics: str
    codec: Codec
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("joints", "rows", "lower", "upper"):  # lists, when they come from a file
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len(self.joints) != self.codec.dimension:
            raise ConfigError(f"a kind of task has {len(self.joints)} joints and a codec of {self.codec.dimension}")
        if not all(-np.inf < low <= high < np.inf for low, high in zip(self.lower, self.upper, strict=True)):
            raise ConfigError(f"numbers of a kind of task are from {self.lower} to {self.upper}")

    @property
    def varying(self) -> list[int]:
        """Which numbers differ among tasks."""
        pairs = zip(self.lower, self.upper, strict=True)
        return [i for i, (low, high) in enumerate(pairs) if not _same(low, high)]

    def fits(self, robot: Robot, constraint: Constraint) -> bool:
        """Tell whether tasks of this robot and constraint are of this kind, whatever their numbers."""
        mine = self.joints, self.rows, self.kinematics, self.codec.turning, len(self.lower)
        return mine == _identity(robot, constraint)

    def numbers(self, said: np.ndarray) -> np.ndarray:
        """Return those of a constraint's numbers (s,) that differ among tasks, from -1 to 1 where they were learned.

        Raises:
            ProblemError: a number that was the same in all tasks that were learned has another value, or one is far
                outside of what was learned.
        """
        rows = "; ".join(self.rows)
        for value, low, high in zip(said.tolist(), self.lower, self.upper, strict=True):
            if _same(low, high) and not _same(value, low):
                raise ProblemError(
                    f"a number of the constraint ({rows}) is {value:g}, and {low:g} in all tasks that the network has "
                    "learned from: train it on tasks that differ in it"
                )
        least, most = (np.array(bound)[self.varying] for bound in (self.lower, self.upper))
        found = np.asarray((2 * said[self.varying] - least - most) / (most - least))
        for i in np.flatnonzero(np.abs(found) > _FARTHEST).tolist():
            raise ProblemError(
                f"a number of the constraint ({rows}) is {said[self.varying][i]:g}, far from those of the tasks that "
                f"the network has learned from, {least[i]:g} to {most[i]:g}"
            )
        return found


def task_kinds(tasks: Sequence[tuple[Robot, Constraint]], centre: bool) -> tuple[TaskKind, ...]:
    """Return the kinds of tasks, given by robot and constraint, in the order in which they come.

    Args:
        tasks: at least one.
        centre: see `Codec`.
    """
    groups: dict[_Identity, list[tuple[Robot, Constraint]]] = {}
    for robot, constraint in tasks:
        groups.setdefault(_identity(robot, constraint), []).append((robot, constraint))
    kinds = []
    for group in groups.values():
        joints, rows, kinematics, *_ = _identity(*group[0])
        said = np.array([constraint.said for _, constraint in group])
        lower, upper = tuple(said.min(axis=0).tolist()), tuple(said.max(axis=0).tolist())
        codec = Codec.of([robot for robot, _ in group], centre)
        kinds.append(TaskKind(joints, rows, kinematics, codec, lower, upper))
    return tuple(kinds)


def kind_of(kinds: Sequence[TaskKind], robot: Robot, constraint: Constraint) -> int:
    """Return which of several kinds a task is of.

    Raises:
        ProblemError: it is of none.
    """
    for number, kind in enumerate(kinds):
        if kind.fits(robot, constraint):
            return number
    alike = [kind for kind in kinds if kind.rows == _rows(constraint) and kind.joints == robot.joint_names]
    if alike:
        raise ProblemError(
            f"the network has learned tasks of another robot with the joints {', '.join(robot.joint_names)}: links "
            "have other lengths, or joints turn where they did not"
        )
    known = " or ".join(f"{'; '.join(kind.rows) or 'free space'} ({', '.join(kind.joints)})" for kind in kinds)
    raise ProblemError(
        f"the network has learned tasks of {known}, not of {'; '.join(constraint.labels) or 'free space'} "
        f"({', '.join(robot.joint_names)})"
    )


def task_input(kinds: Sequence[TaskKind]) -> int:
    """Return how many numbers `task_vector` has; 0 where all tasks are of one kind and differ in nothing."""
    return (len(kinds) if len(kinds) > 1 else 0) + max(len(kind.varying) for kind in kinds)


def task_vector(kinds: Sequence[TaskKind], number: int, said: np.ndarray) -> np.ndarray:
    """Return what a network is told of a task: of which kind it is, as 0 and 1, and what numbers it has (task_input,).

    Args:
        kinds: that the network knows.
        number: of the task's kind.
        said: its constraint's numbers (s,).

    Raises:
        ProblemError: see `TaskKind.numbers`.
    """
    numbers = kinds[number].numbers(said)
    which = np.eye(len(kinds))[number] if len(kinds) > 1 else np.empty(0)
    padding = task_input(kinds) - len(which) - len(numbers)
    return np.concatenate([which, numbers, np.zeros(padding)])


def kinematics_key(robot: Robot) -> str:
    """Return a hash of where joints and frames of a robot are, but for those that a task has put somewhere."""
    model = robot.model
    joints = [
        (model.names[i], model.joints[i].shortname(), model.names[model.parents[i]], model.jointPlacements[i])
        for i in range(1, model.njoints)
    ]
    frames = [(frame.name, "", model.names[frame.parentJoint], frame.placement) for frame in model.frames]
    own = [
        [*words, *(np.round(np.append(place.rotation, place.translation), _DECIMALS) + 0.0).tolist()]
        for *words, place in (*joints, *frames)
        if words[0] not in robot.placed
    ]
    return digest(own)


_Identity = tuple[tuple[str, ...], tuple[str, ...], str, tuple[bool, ...], int]


def _identity(robot: Robot, constraint: Constraint) -> _Identity:
    """Return what tasks of one kind have in common: joints, rows, kinematics, which joints turn, count of numbers."""
    turning = tuple(robot.turning.tolist())
    return robot.joint_names, _rows(constraint), kinematics_key(robot), turning, len(constraint.said)


def _rows(constraint: Constraint) -> tuple[str, ...]:
    return tuple(_NUMBERS.sub("[*]", label) for label in constraint.labels)


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME * max(1.0, abs(one))
