"""What is planned and by what: a case is a task with its names, a route is a way to plan it."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
import pandas as pd

from pipeline.manifolds import Adherence, make_adherence
from pipeline.planners import Planner, PlanResult, Query, Termination
from pipeline.robots import Geometry
from pipeline.samplers import Sampler
from pipeline.schema import Choice
from pipeline.spec.scene import Scene, leg_of
from pipeline.spec.statement import Statement
from pipeline.tasks import Task, build
from pipeline.tasks.sources import check_sources


class Role(Enum):
    """What a route stands for where routes are compared."""

    OURS = "ours"
    UNPROVEN = "ours, unproven"  # whose found paths are looked at and not proven
    PEER = "peer"


@dataclass(frozen=True)
class Names:
    """A route in the columns of a row.

    Attributes:
        method: its label.
        planner, sampler: their kinds; of a peer which one it is, and no sampler.
        adherence: key of the method.
        role: what it stands for.
    """

    method: str
    planner: str
    sampler: str
    adherence: str
    role: Role = Role.OURS


@dataclass(frozen=True)
class Case:
    """A leg of a task, ready to be planned, with its names.

    Attributes:
        environment, scenario, scene: where it is.
        problem, leg: its numbers, among those of the scene and of the problem.
        task: what is asked.
    """

    environment: str
    scenario: str
    scene: str
    problem: int
    leg: int
    task: Task

    def seed(self, seed: int) -> int:
        """Return the problem's own seed, that of all methods, from the seed of all trials."""
        stream = np.random.SeedSequence([seed, self.problem, *self.scene.encode()])
        return int(stream.generate_state(1)[0])


def cases(environment: str, scenes: Mapping[str, Scene], problems: pd.DataFrame) -> Iterator[Case]:
    """Yield the cases of a table of tasks, in its order, whatever their scenes ask for.

    Raises:
        ArtifactError: see `check_sources`; where a worker plans, its files are meant.
    """
    check_sources(scenes[name] for name in problems["scene"].unique())
    tuples: Any = problems.itertuples()  # pandas types its fields as any scalar
    for row in tuples:
        scene = scenes[row.scene]
        task = build(leg_of(scene, row))
        yield Case(environment, scene.scenario, scene.name, int(row.problem), int(row.leg), task)


class Manifold:
    """An adherence method over many tasks: what the last one had is kept where the next one has it too.

    Args:
        adherence: the method.
        margin, self_margin: kept in planning, to obstacles and conditions and between bodies [m].
    """

    def __init__(self, adherence: Choice, margin: float = 0.0, self_margin: float = 0.0) -> None:
        self.adherence, self.margins = adherence, (margin, self_margin)
        self._space: Adherence | None = None
        self._asked: Statement | None = None  # whose scene the manifold is in

    def at(self, task: Task) -> Adherence:
        """Return the manifold of a task; that of the last one where as much is asked, in another scene if need be."""
        if self._space is None or self._asked is not task.statement:
            validity = task.validity(*self.margins)
            if self._space is None or self._space.constraint is not task.constraint:
                self._space = make_adherence(self.adherence, task.constraint, validity)
            self._space.reset(validity)
            self._asked = task.statement
        return self._space

    def problem(self, case: Case) -> Query:
        """Return what planners are asked for a case."""
        return Query(self.at(case.task), case.task.start, case.task.goal, case.scene)


@dataclass
class Route(ABC):
    """A way to plan a task.

    Attributes:
        names: in the columns of rows.
        manifold: where it plans, or where its waypoints are joined; routes that share one plan one after the other.
        geometry: what it takes meshes of a robot to be; None for what the settings of the robot say.
        uncounted: columns of counts that it has none for.
    """

    names: Names
    manifold: Manifold
    geometry: Geometry | None = field(default=None, kw_only=True)
    uncounted: tuple[str, ...] = field(default=(), kw_only=True)

    @abstractmethod
    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; what is made before the search begins is left out of the planning time.

        Raises:
            ProblemError: the start or goal is invalid.
        """


@dataclass
class Ours(Route):
    """One of our planners with a sampler."""

    planner: Planner
    sampler: Sampler

    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; see `Route`."""
        return self.planner.plan(self.manifold.problem(case), self.sampler, termination, seed)
