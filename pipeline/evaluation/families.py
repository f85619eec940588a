"""A family of tasks with everything it is planned and verified with: what benchmarks and the soak test run over."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.environments.families import KINDS, make_family
from pipeline.environments.task import Family
from pipeline.errors import ConfigError, require
from pipeline.evaluation.routes import Case, Manifold, Ours, Role
from pipeline.evaluation.trials import Method
from pipeline.robots import ROBOTS, Geometry, UrdfRobot
from pipeline.schema import Choice
from pipeline.tasks import build, robot_of
from pipeline.tasks.sources import contents
from pipeline.verification.verdict import VerifierParameters


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

    def sources(self) -> dict[str, str]:
        """Return hashes of the files that the robot is read from, by name: none for mazes."""
        description = self.description()
        return {} if description is None else contents(robot_of(description).files)

    def family(self, geometry: Geometry | None = None) -> Family:
        """Return the family; reading its robot takes up to a second.

        Args:
            geometry: what meshes of the robot become, in place of what its settings say.
        """
        return make_family(self.kind, self.description(geometry), self.parameters)

    def cases(self, label: str, seed: int, numbers: Iterable[int]) -> Iterator[Case]:
        """Yield tasks of the family by number, under a label for the environment; its robot is read once."""
        family = self.family()
        for number in numbers:
            task = family.task(seed, number)
            yield Case(label, self.kind, task.name, number, 0, build(task.leg))

    def ours(self, adherence: str, label: str = "", role: Role = Role.OURS) -> Ours:
        """Return our planner with the adherence method of a key, under a label."""
        method = Method(label or adherence, self.planner, self.sampler)
        manifold = Manifold(self.adherences[adherence], self.margin, self.self_margin)
        return method.route(adherence, manifold, role=role)

    def changed(
        self,
        planner: Mapping[str, Any] | None = None,
        sampler: Mapping[str, Any] | None = None,
        adherence: Mapping[str, Any] | None = None,
    ) -> "Setting":
        """Return the setting with other parameters of planner, sampler and all adherence methods, by name."""

        def other(choice: Choice, parameters: Mapping[str, Any] | None) -> Choice:
            return replace(choice, parameters={**choice.parameters, **(parameters or {})})

        return replace(
            self,
            planner=other(self.planner, planner),
            sampler=other(self.sampler, sampler),
            adherences={key: other(choice, adherence) for key, choice in self.adherences.items()},
        )
