"""Measure what parts, plans and demonstrations cost, ours beside OMPL's. Not a stage of the pipeline."""

import shlex
from dataclasses import dataclass
from pathlib import Path

import hydra
import pandas as pd
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.environments import BLOCKS, ENVIRONMENTS, Split
from pipeline.environments.oracle import Oracle
from pipeline.errors import ConfigError
from pipeline.evaluation.costs import Parts, Workplace, parts_table, scaling_lines, scaling_table
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.peers import SPACING, Contest, contest_trials, goal_lines, parity_table, planning_table
from pipeline.learning import CompnetxNetwork, Model, Normalisation, load_model
from pipeline.learning.networks import Compnetx
from pipeline.learning.recipe import ModelConfig
from pipeline.parallel import single_threaded
from pipeline.perception import VoxelParameters, scene_voxels
from pipeline.reporting.markdown import escape, write
from pipeline.reporting.text import number
from pipeline.robots import Robot
from pipeline.schema import Choice
from pipeline.stage import guarded

PARTS_NOTE = (
    "`traverse` is timed inside RRTConnect plans: all walks of a plan, failed ones and new charts included, over the "
    "states they reached, so that among blocks a state carries the price of walks that end at once; n counts plans. "
    "A step includes the collision checks on the chord behind it. Elsewhere n counts calls or paths, each with another "
    "argument."
)
PLANNING_NOTE = (
    "n problems with one seed each; every row plans a problem before the next one comes. Times are of all trials, "
    "failures included; ratios are OMPL's over ours on the same problems; success is claimed by the planner and "
    "verified by `pipeline.evaluation.verify`, without margin; lengths are of verified paths. OMPL has the same "
    "constraint, validity checker and time limit, charts with our epsilon, rho, alpha and exploration, and as many "
    "samples for FMT; range and radius multiplier are its defaults. In its tangent bundle these charts give FMT only "
    "samples near the start and the goal, so that it runs into the time limit where they are far apart."
)
PARITY_NOTE = (
    "Lengths are medians over the problems that both solved, their difference with its paired bootstrap interval."
)
SCALING_NOTE = (
    "The speed-up is that of start and work together; the start of the processes is the same for however much work."
)


@dataclass(frozen=True)
class Perception:
    seed: int
    voxels: VoxelParameters


@dataclass(frozen=True)
class Goals:
    planners: dict[str, float]
    workers: float


@dataclass(frozen=True)
class Config:
    environment: Choice
    perception: Perception
    model: ModelConfig
    trained: Path | None
    scenes: int
    contest: Contest
    parts: Parts
    oracle: Oracle
    demonstrations: int
    shard: int
    goals: Goals
    output: Path | None

    def __post_init__(self) -> None:
        for name in ("scenes", "demonstrations"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be at least 1")
        if set(self.goals.planners) != set(self.contest.labels):
            raise ConfigError(f"goals.planners has {list(self.goals.planners)}; expected {self.contest.labels}")


@hydra.main(version_base="1.3", config_path="../conf", config_name="bench")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    text = page(config, HydraConfig.get().overrides.task)
    print(text, end="")
    if config.output:
        write(text, config.output)


def page(config: Config, overrides: list[str]) -> str:
    """Measure everything; return the page."""
    environment, contest = config.environment.make(ENVIRONMENTS, "environment"), config.contest
    found = environment.scenes({Split.VALIDATION: config.scenes})
    scenes = {scene.name: scene for scene in found if scene.scenario == BLOCKS}
    per_scene = -(-max(contest.problems, config.demonstrations) // len(scenes))
    problems = pd.concat([environment.problems(scene, per_scene) for scene in scenes.values()])
    problems = problems.sort_values("problem", kind="stable")  # the first of every scene, then the second ones
    model = load_model(config.trained) if config.trained else fresh(config.model, environment.robot(), contest.seed)
    voxels = scene_voxels(next(iter(scenes.values())).obstacles, config.perception.voxels, config.perception.seed)
    place = Workplace(
        environment,
        scenes,
        problems,
        contest.adherences,
        contest.verifier,
        config.parts,
        contest.time_limit,
        contest.seed,
    )
    with single_threaded():
        parts = parts_table(place, CompnetxNetwork(model), voxels)
        trials = contest_trials(contest, environment, scenes, problems)
    some = problems.iloc[: config.demonstrations]
    scaling = scaling_table(config.oracle, environment, scenes, some, config.shard)
    planning, parity = planning_table(trials), parity_table(trials)
    goals = [*goal_lines(planning, config.goals.planners), *scaling_lines(scaling, config.goals.workers)]
    weights = f"`{config.trained}`" if config.trained else "freshly initialised; cost does not depend on weights"
    arguments = f' BENCH_ARGS="{shlex.join(overrides)}"' if overrides else ""
    machine = [(key, describe(value)) for key, value in hardware().items()]
    blocks = [
        f"Generated by `make bench{arguments}`, do not edit.",
        "# Performance",
        f"{len(scenes)} validation scenes of {environment.name}, {environment.blocks} blocks each; one thread, but for "
        "the scaling.",
        "## Goals",
        "\n".join(f"- {escape(line)}" for line in goals),
        "## Parts", PARTS_NOTE, f"The network is {weights}.", table(parts),
        "## Planning", PLANNING_NOTE,
        *(block for rows in planning.groupby(["planner", SPACING], sort=False) for block in titled(*rows)),
        f"## Parity with OMPL's states {parity[SPACING].iloc[0]:g} m apart", PARITY_NOTE,
        table(parity.drop(columns=SPACING)),
        "## Scaling of the demonstrations", SCALING_NOTE, table(scaling),
        "## Machine and versions", table(pd.DataFrame(machine, columns=["", "value"])),
    ]  # fmt: skip
    return "\n\n".join(blocks) + "\n"


def fresh(config: ModelConfig, robot: Robot, seed: int) -> Model:
    """Return a model with the initial weights of its sizes."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = Compnetx(config.network).eval()
    return Model(config.network, Normalisation(tuple(robot.lower), tuple(robot.upper), config.centre), network)


def titled(key: tuple[str, float], rows: pd.DataFrame) -> tuple[str, str]:
    """Return the heading of a planner at one of OMPL's spacings and its table without these two columns."""
    return f"### {escape(key[0])}, OMPL's states {key[1]:g} m apart", table(rows.drop(columns=["planner", SPACING]))


def table(frame: pd.DataFrame) -> str:
    """Return a Markdown table with three significant digits, numbers to the right."""
    align = ["right" if pd.api.types.is_numeric_dtype(frame[name]) else "left" for name in frame]
    cells = frame.map(lambda value: number(value) if isinstance(value, float) else escape(str(value)))
    return cells.to_markdown(index=False, disable_numparse=True, colalign=align)


def describe(value: object) -> str:
    """Return a value of the hardware in words."""
    return ", ".join(f"{name} {found}" for name, found in value.items()) if isinstance(value, dict) else str(value)


if __name__ == "__main__":
    main()
