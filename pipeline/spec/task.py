"""A task: starts, goals and what is asked of the way between them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.errors import ConfigError
from pipeline.spec.statement import Statement


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a task along which nothing changes of what is asked.

    Attributes:
        statement: what every point of the way must keep.
        starts: configurations (S, n), any of which will do.
        goals: likewise (G, n).
    """

    statement: Statement
    starts: np.ndarray
    goals: np.ndarray

    def __post_init__(self) -> None:
        for name in ("starts", "goals"):
            ends = getattr(self, name)
            if ends.ndim != 2 or not len(ends):
                raise ConfigError(f"{name} of a leg have shape {ends.shape}; they must be configurations (m, n)")

    @property
    def start(self) -> np.ndarray:
        """The first start (n,)."""
        return np.asarray(self.starts[0])

    @property
    def goal(self) -> np.ndarray:
        """The first goal (n,)."""
        return np.asarray(self.goals[0])


@dataclass(frozen=True, eq=False)
class TaskSpec:
    """A task, as plain data.

    Attributes:
        name: of the task, among those of its scene.
        legs: one after the other; most tasks have one.
        scene, scenario, split: of the scene it belongs to; empty where it stands alone.
        parameters: numbers that its statements were made from, by name: a height, the distance of two hands.
    """

    name: str
    legs: tuple[Leg, ...]
    scene: str = ""
    scenario: str = ""
    split: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.legs:
            raise ConfigError(f"task {self.name!r} has no leg")

    @property
    def leg(self) -> Leg:
        """The only leg.

        Raises:
            ConfigError: there are several.
        """
        if len(self.legs) > 1:
            raise ConfigError(f"task {self.name!r} has {len(self.legs)} legs; one is planned at a time")
        return self.legs[0]


def single(name: str, statement: Statement, start: np.ndarray, goal: np.ndarray) -> TaskSpec:
    """Return a task of one leg from a configuration (n,) to another."""
    return TaskSpec(name, (Leg(statement, np.asarray(start)[None], np.asarray(goal)[None]),))
