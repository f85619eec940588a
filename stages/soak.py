"""Plan and verify thousands of paths of all families, on all cores and resumably. Not a stage of the pipeline."""

import logging
import shlex
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.atomic import check_file
from pipeline.config import load
from pipeline.evaluation.soak import Soak, soak_shard, wrong
from pipeline.keys import code_digest, digest
from pipeline.parallel import run_shards
from pipeline.reporting.markdown import write
from pipeline.reporting.soak_page import soak_page
from pipeline.stage import SCRATCH, guarded

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Config:
    soak: Soak
    workers: int
    cluster: str | None
    output: Path | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="soak")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    if config.output:
        check_file(config.output)
    sources = {name: family.sources() for name, family in config.soak.families.items()}
    key = digest(asdict(config.soak), sources, code_digest(Path(__file__)))
    shards = config.soak.shards()
    work, scratch = partial(soak_shard, config.soak), SCRATCH / "soak" / key
    frames = run_shards(work, shards, scratch, config.workers, "soak", config.cluster)
    rows = pd.concat(frames, ignore_index=True)
    command = shlex.join(["python", "stages/soak.py", *HydraConfig.get().overrides.task])
    text = soak_page(rows, config.soak, command)
    print(text, end="")
    if config.output:
        write(text, config.output)
    bad = wrong(rows)
    for row in bad[:10]:
        log.error("wrong: %s", row)
    if bad:
        sys.exit(1)


if __name__ == "__main__":
    main()
