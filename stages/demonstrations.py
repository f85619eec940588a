"""Plan the training problems with the oracle and verify the paths, on all cores and resumably."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.evaluation.oracle import UNVERIFIED, Oracle, demonstrate, shards
from pipeline.files import write_json, write_table
from pipeline.keys import code_digest, digest
from pipeline.machine import here
from pipeline.parallel import run_shards, stamped
from pipeline.profile import Profile
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import SCENES, TASKS, Split, read_tasks
from pipeline.stage import SCRATCH, destination, folder, guarded
from pipeline.tasks.sources import current_scenes


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: EnvironmentChoice
    oracle: Oracle
    shard: int
    workers: int
    cluster: str | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="demonstrations")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    target = destination(config.profile.name, "demonstrations", config.environment.name)
    source = folder(config.profile.name, "scenes", config.environment.name)
    scenes = current_scenes(source)
    problems = read_tasks(source, scenes)
    problems = problems[problems.split != Split.TEST.value]
    files = [source / SCENES, source / TASKS]
    place = here()
    chosen = [asdict(config.environment), asdict(config.oracle), config.shard]
    key = digest(*files, chosen, code_digest(Path(__file__)))
    frames = run_shards(
        partial(stamped, partial(demonstrate, config.oracle, config.environment, scenes), place),
        list(shards(problems, config.shard)),
        SCRATCH / "demonstrations" / key,
        config.workers,
        "demonstrations",
        config.cluster,
    )
    paths = pd.concat(frames, ignore_index=True)
    clocked = ["planning_time", *place, "measured"]
    metrics = {
        "problems": len(paths),
        "solved": int(paths.solved.sum()),
        "failed": int((~paths.solved).sum()),
        "unverified": int((paths.status == UNVERIFIED).sum()),
        "median_length": float(paths[paths.solved].length.median()),
        "median_length_before_shortcuts": float(paths[paths.solved].raw_length.median()),
    }
    with atomic_folder(target) as out:
        write_table(paths.drop(columns=clocked), out / "paths.parquet", "paths")
        write_table(paths[["scene", "problem", *clocked]], out / "timing.parquet", "timing")
        write_json(metrics, out / "metrics.json")


if __name__ == "__main__":
    main()
