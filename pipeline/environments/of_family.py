"""An environment whose scenes and tasks come from a family: arms at tables and doors, points in mazes."""

from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from pipeline.environments.families import KINDS, make_family
from pipeline.environments.task import Family
from pipeline.errors import ConfigError, require
from pipeline.problems.sources import from_here
from pipeline.robots import ROBOTS
from pipeline.schema import Choice
from pipeline.spec.scene import Scene, Split, task_rows
from pipeline.tasks.sources import contents, read_by

_APART = 1_000_000  # numbers of scenes between splits


@dataclass(frozen=True)
class FamilyEnvironment:
    """See `conf/environment/transport_panda.yaml`.

    Attributes:
        name: of the environment.
        family: kind of the family, which is also the name of its only scenario.
        robot: as in conf/robot; None for mazes.
        seed: of all scenes and tasks.
        margin, self_margin: see `Environment`.
        of_family: parameters of the family, where it has some.
    """

    name: str
    family: str
    robot: Choice | None
    seed: int
    margin: float
    self_margin: float
    of_family: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.family not in KINDS:
            raise ConfigError(f"environment.family is {self.family!r}; choices: {', '.join(KINDS)}")
        for name in ("seed", "margin", "self_margin"):
            require(f"environment.{name}", getattr(self, name), at_least=0)

    def scenes(self, counts: dict[Split, int]) -> list[Scene]:
        """See `Environment`. Scene i of a split depends on the seed and i only.

        Raises:
            ProblemError: a scene has no start and goal.
        """
        for split, count in counts.items():
            require(f"scenes.{split.value}", count, at_least=0)
        family, found = self._made(), []
        for split in Split:
            for i in range(counts.get(split, 0)):
                (task,) = family.tasks(self.seed, _number(split, i))
                statement, name = from_here(task.leg.statement), f"{self.family}-{split.value}-{i:03d}"
                found.append(Scene(self.family, name, split, (statement,), contents(read_by(statement))))
        return found

    def tasks(self, scene: Scene, count: int) -> pd.DataFrame:
        """See `Environment`.

        Raises:
            ProblemError: the scene has not as many starts and goals.
        """
        require("the number of problems", count, at_least=0)
        number = _number(scene.split, int(scene.name.rsplit("-", 1)[-1]))
        tasks = self._made().tasks(self.seed, number, count) if count else []
        return task_rows(scene, [(task.leg.start, task.leg.goal) for task in tasks])

    def _made(self) -> Family:
        # The robot is kept by what it is made of: to make the family again costs little.
        robot = None if self.robot is None else self.robot.make(ROBOTS, "environment.robot")
        return make_family(self.family, robot, self.of_family)


def _number(split: Split, i: int) -> int:
    """Return the family's number of the i-th scene of a split, even where i is: families tell even and odd apart."""
    return list(Split).index(split) * _APART + i
