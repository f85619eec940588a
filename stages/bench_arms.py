"""Measure families of tasks, ours beside peers. Not a stage of the pipeline."""

import shlex
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.atomic import check_file
from pipeline.config import load
from pipeline.evaluation.arm_contest import ArmContest, arm_shard, installed
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.upkeep import Upkeep, maintain
from pipeline.keys import code_digest, digest
from pipeline.parallel import single_threaded, timed_shards
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
    if config.output:
        check_file(config.output)
    contest = installed(config.contest)
    sources = {name: family.sources() for name, family in contest.families.items()}
    scratch = SCRATCH / "arms" / digest(asdict(contest), sources, code_digest(Path(__file__)))
    with single_threaded():
        upkept = maintain(config.upkeep, contest.families, contest.seed)
    with timed_shards(partial(arm_shard, contest), contest.shards(), scratch, 1, "arms", hardware) as measured:
        rows = pd.concat(measured.frames, ignore_index=True)
        text = arms_page(rows[~rows["tried"]], rows[rows["tried"]], upkept, contest, command, measured.provenance)
        print(text, end="")
        if config.output:
            write_part(text, config.output)


if __name__ == "__main__":
    main()
