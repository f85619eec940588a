"""A family of tasks with everything it is planned and verified with: what benchmarks and the soak test run over."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.environments.families import KINDS, make_family
from pipeline.environments.task import Family
from pipeline.errors import ConfigError, require
from pipeline.learning.choices import make_sampler
from pipeline.manifolds import Adherence, make_adherence
from pipeline.planners import PLANNERS, PlanResult, Problem, Termination
from pipeline.robots import ROBOTS, Geometry, UrdfRobot
from pipeline.schema import Choice
from pipeline.tasks import Task
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Verdict, VerifierParameters


@dataclass(frozen=True)
class Setting:
    """See conf/family.

    Attributes:
        kind: of the family.
        robot: as in conf/robot; None for mazes.
        adherences: ours, by name.
        planner, sampler: ours.
        margin, self_margin: ours, to obstacles and between bodies [m]; peers plan without.
        time_limit: of every plan of a benchmark [s].
        ompl_delta: step of OMPL's walks, at which it checks collisions [rad or m].
        peers: how many tasks OMPL's routes plan: in some families each runs into the time limit.
        verifier: bounds of the check.
        parameters: of mazes.
    """

    kind: str
    robot: Choice | None
    adherences: dict[str, Choice]
    planner: Choice
    sampler: Choice
    margin: float
    self_margin: float
    time_limit: float
    ompl_delta: float
    peers: int
    verifier: VerifierParameters
    parameters: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f"family is {self.kind!r}; choices: {', '.join(KINDS)}")
        if not self.adherences:
            raise ConfigError(f"family {self.kind!r} has no adherence method")
        require("time_limit", self.time_limit, above=0, unit=" s")
        require("margin", self.margin, at_least=0, unit=" m")
        require("self_margin", self.self_margin, at_least=0, unit=" m")
        require("peers", self.peers, at_least=0)
        require("ompl_delta", self.ompl_delta, above=0)

    def description(self, geometry: Geometry | None = None) -> UrdfRobot | None:
        """Return what the robot is made of; None for mazes. `geometry` replaces what meshes become by its settings."""
        made: UrdfRobot | None = None if self.robot is None else self.robot.make(ROBOTS, "robot")
        return made if made is None or geometry is None else replace(made, geometry=geometry)

    def family(self, geometry: Geometry | None = None) -> Family:
        """Return the family; reading its robot takes up to a second.

        Args:
            geometry: what meshes of the robot become, in place of what its settings say.
        """
        return make_family(self.kind, self.description(geometry), self.parameters)

    def verdict(self, task: Task, path: np.ndarray, geometry: Geometry | None = None) -> Verdict:
        """Return the verifier's verdict on a path (T, n), by the robot's own geometry or another."""
        asked = task.statement
        if geometry is not None and isinstance(asked.robot, UrdfRobot):
            asked = replace(asked, robot=replace(asked.robot, geometry=geometry))
        return Judge(asked, self.verifier).verify(path, task.start, task.goal)


class Ours:
    """Our planner with one adherence method, over the tasks of a family.

    Args:
        setting: of the family.
        adherence: the method.
    """

    def __init__(self, setting: Setting, adherence: Choice) -> None:
        self.setting, self.adherence = setting, adherence
        self._planner = setting.planner.make(PLANNERS, "planner")
        self._space: Adherence | None = None
        self._task: Task | None = None  # whose scene the manifold is in

    def space(self, task: Task) -> Adherence:
        """Return the manifold of a task; that of the last one in another scene where the constraint is the same."""
        if self._space is not None and self._task is task:
            self._space.reset()
            return self._space
        validity = task.validity(self.setting.margin, self.setting.self_margin)
        if self._space is None or self._space.constraint is not task.constraint:
            self._space = make_adherence(self.adherence, task.constraint, validity)
        self._space.reset(validity)
        self._task = task
        return self._space

    def plan(self, task: Task, termination: Termination, seed: int) -> PlanResult:
        """Plan a task; making the checker and the manifold is left out of the planning time."""
        asked = Problem(self.space(task), task.start, task.goal)
        return self._planner.plan(asked, make_sampler(self.setting.sampler), termination, seed)
