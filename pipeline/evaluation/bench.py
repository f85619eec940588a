"""Everything `make bench` measures: what parts cost, planning against OMPL, scaling of the demonstrations."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.environments import BLOCKS, ENVIRONMENTS
from pipeline.errors import ConfigError, require
from pipeline.evaluation.costs import Parts, Workplace, parts_table, scaling_lines, scaling_table
from pipeline.evaluation.oracle import Oracle
from pipeline.evaluation.peers import Contest, contest_trials, goal_lines, parity_lines, parity_table, planning_table
from pipeline.learning.compnetx import Layers, load_model, untrained
from pipeline.learning.task_kinds import task_kinds
from pipeline.parallel import single_threaded
from pipeline.perception import Perception, scene_voxels
from pipeline.schema import Choice, convert
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import Split
from pipeline.tasks import set_up


@dataclass(frozen=True)
class Goals:
    """What is promised: least ratio of OMPL's median time to ours by planner, least speed-up of two workers."""

    planners: dict[str, float]
    workers: float


@dataclass(frozen=True)
class Bench:
    """See `conf/bench.yaml`."""

    environment: EnvironmentChoice
    perception: Perception
    model: Choice
    trained: Path | None
    scenes: int
    contest: Contest
    parts: Parts
    oracle: Oracle
    demonstrations: int
    shard: int
    rounds: int
    goals: Goals
    output: Path | None

    def __post_init__(self) -> None:
        for name in ("scenes", "demonstrations", "rounds"):
            require(name, getattr(self, name), at_least=1)
        if set(self.goals.planners) != set(self.contest.labels):
            raise ConfigError(f"goals.planners has {list(self.goals.planners)}; expected {self.contest.labels}")
        self.layers()

    def layers(self) -> Layers:
        """Return the sizes of the network whose calls are measured.

        Raises:
            ConfigError: sizes that make no network.
        """
        layers: Layers = convert(self.model.parameters.get("layers", {}), Layers, "model.parameters.layers")
        return layers


@dataclass(frozen=True)
class Measured:
    """What `measure` found.

    Attributes:
        place: where, in words.
        network: which weights, in words of Markdown.
        goals: one sentence per goal, met or not.
        parts, planning, parity, scaling: tables, see `costs` and `peers`.
    """

    place: str
    network: str
    goals: list[str]
    parts: pd.DataFrame
    planning: pd.DataFrame
    parity: pd.DataFrame
    scaling: pd.DataFrame


def measure(bench: Bench) -> Measured:
    """Measure everything, on validation scenes."""
    environment, contest = bench.environment.environment(ENVIRONMENTS), bench.contest
    found = environment.scenes({Split.VALIDATION: bench.scenes})
    scenes = {scene.name: scene for scene in found if scene.scenario == BLOCKS}
    per_scene = -(-max(contest.problems, bench.demonstrations) // len(scenes))
    problems = pd.concat([environment.tasks(scene, per_scene) for scene in scenes.values()])
    problems = problems.sort_values("problem", kind="stable")  # the first of every scene, then the second ones
    setup = set_up(found[0].statement)
    kinds = task_kinds([(setup.robot, setup.constraint)], centre=False)
    model = (
        load_model(bench.trained)
        if bench.trained
        else untrained(bench.layers(), kinds, bench.perception.voxels.size, contest.seed)
    )
    voxels = scene_voxels(next(iter(scenes.values())).obstacles, bench.perception.voxels, bench.perception.seed)
    place = Workplace(
        environment,
        scenes,
        problems,
        contest.adherences,
        contest.verifier,
        bench.parts,
        contest.time_limit,
        contest.seed,
    )
    with single_threaded():
        parts = parts_table(place, model, voxels)
        trials = contest_trials(contest, environment, scenes, problems)
    demonstrations = problems.iloc[: bench.demonstrations]
    scaling = scaling_table(bench.oracle, environment, scenes, demonstrations, bench.shard, bench.rounds)
    planning, parity = planning_table(trials), parity_table(trials)
    return Measured(
        place=f"{len(scenes)} validation scenes of {environment.name}, {environment.blocks} blocks each",
        network=f"`{bench.trained}`" if bench.trained else "freshly initialised; cost does not depend on weights",
        goals=[
            *goal_lines(planning, bench.goals.planners),
            *parity_lines(parity),
            *scaling_lines(scaling, bench.goals.workers),
        ],
        parts=parts,
        planning=planning,
        parity=parity,
        scaling=scaling,
    )
