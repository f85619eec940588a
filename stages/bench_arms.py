"""Measure families of tasks, ours beside peers. Not a stage of the pipeline."""

import shlex
from dataclasses import dataclass
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.evaluation.arm_contest import ArmContest, arm_trials, tried_trials
from pipeline.evaluation.upkeep import Upkeep, maintain
from pipeline.parallel import single_threaded
from pipeline.reporting.arms_page import arms_page
from pipeline.reporting.markdown import write
from pipeline.stage import guarded


@dataclass(frozen=True)
class Config:
    contest: ArmContest
    upkeep: Upkeep
    output: Path | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="bench_arms")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    command = shlex.join(["python", "stages/bench_arms.py", *HydraConfig.get().overrides.task])
    with single_threaded():
        contest = config.contest
        upkept = maintain(config.upkeep, contest.families, contest.seed)
        trials, tried = arm_trials(contest), tried_trials(contest)
    text = arms_page(trials, tried, upkept, contest, command)
    print(text, end="")
    if config.output:
        write(text, config.output)


if __name__ == "__main__":
    main()
