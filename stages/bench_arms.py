"""Measure families of tasks, ours beside peers. Not a stage of the pipeline."""

import shlex
import shutil
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.evaluation.arm_contest import ArmContest, arm_shard, installed
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.upkeep import Upkeep, maintain
from pipeline.files import code_digest, digest
from pipeline.parallel import run_shards, single_threaded
from pipeline.reporting.arms_page import arms_page
from pipeline.reporting.markdown import write_part
from pipeline.stage import SCRATCH, guarded


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
    contest, machine = installed(config.contest), hardware()
    measured = {key: value for key, value in machine.items() if key != "commit"}  # of the code there is a digest
    scratch = SCRATCH / "arms" / digest(asdict(contest), code_digest(), measured)
    with single_threaded():
        upkept = maintain(config.upkeep, contest.families, contest.seed)
    rows = pd.concat(run_shards(partial(arm_shard, contest), contest.shards(), scratch, 1, "arms"), ignore_index=True)
    text = arms_page(rows[~rows["tried"]], rows[rows["tried"]], upkept, contest, command, machine)
    print(text, end="")
    if config.output:
        write_part(text, config.output)
    shutil.rmtree(scratch)  # the next run measures anew; only a killed one goes on


if __name__ == "__main__":
    main()
