"""Measure what parts, plans and demonstrations cost, ours beside OMPL's. Not a stage of the pipeline."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hydra
import pandas as pd
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.environments import BLOCKS, ENVIRONMENTS, Scene, Split
from pipeline.environments.oracle import Oracle
from pipeline.evaluation.costs import Workplace, parts_table, scaling_lines, scaling_table
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.peers import Contest, contest_trials, goal_lines, parity_table, planning_table
from pipeline.learning import CompnetxNetwork, Model, Normalisation, load_model
from pipeline.learning.networks import Compnetx
from pipeline.learning.recipe import ModelConfig
from pipeline.parallel import single_threaded
from pipeline.perception import VoxelParameters, scene_voxels
from pipeline.planners import PLANNERS
from pipeline.reporting.markdown import escape, write
from pipeline.reporting.text import number
from pipeline.schema import Choice
from pipeline.stage import guarded

PARTS_NOTE = (
    "One thread. `traverse` is timed inside RRTConnect plans: all walks of a plan, failed ones and new charts included, "
    "over the states they reached, so that among blocks a state carries the price of walks that end at once. "
    "A walk checks the chord between two states at the resolution too: 5 checks per state. "
)
PLANNING_NOTE = (
    "n problems, one seed each, planned one after the other by all rows in turn. Times are of all trials, failures "
    "included; ratios are OMPL's over ours on the same problems; claimed by the planner, verified by "
    "`pipeline.evaluation.verify`; lengths are of verified paths. Constraint, validity checker and time limit are the "
    "same, charts have our epsilon, rho, alpha and exploration, FMT our number of samples; range and radius multiplier "
    "are OMPL's defaults. OMPL's tangent bundle gives FMT only samples around start and goal, and it runs into the "
    "time limit where they are far apart."
)
PARITY_NOTE = "Lengths are medians over the problems that both solved; paired bootstrap interval of the difference."


@dataclass(frozen=True)
class Perception:
    seed: int
    voxels: VoxelParameters


@dataclass(frozen=True)
class Parts:
    plans: int
    calls: int


@dataclass(frozen=True)
class Goals:
    rrtconnect: float
    fmt: float
    workers: float


@dataclass(frozen=True)
class Config:
    environment: Choice
    perception: Perception
    model: ModelConfig
    scenes: int
    contest: Contest
    parts: Parts
    trained: Path | None
    oracle: Oracle
    demonstrations: int
    shard: int
    goals: Goals
    output: Path | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="bench")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    arguments = shlex.join(HydraConfig.get().overrides.task)
    command = f'make bench BENCH_ARGS="{arguments}"' if arguments else "make bench"
    environment = config.environment.make(ENVIRONMENTS, "environment")
    scenes, problems = validation_problems(environment, config)
    ...


if __name__ == "__main__":
    main()
