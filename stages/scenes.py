"""Generate the scenes and problems of an environment."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.environments import ENVIRONMENTS, Environment
from pipeline.keys import code_digest, digest
from pipeline.parallel import run_shards
from pipeline.profile import Profile
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import Scene, write_scenes, write_tasks
from pipeline.stage import SCRATCH, destination, guarded
from pipeline.tasks.sources import check_sources


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: EnvironmentChoice
    workers: int
    cluster: str | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="scenes")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    target = destination(config.profile.name, "scenes", config.environment.name)
    environment, scale = config.environment.environment(ENVIRONMENTS), config.profile.scenes
    scenes = environment.scenes(scale.counts)
    counts = {scene.name: scale.problems(scene) for scene in scenes}
    sources = {scene.name: scene.sources for scene in scenes}
    key = digest(asdict(config.environment), counts, sources, code_digest(Path(__file__)))
    tasks = run_shards(
        partial(_tasks, environment, counts),
        [(scene.name, scene) for scene in scenes],
        SCRATCH / "scenes" / key,
        config.workers,
        "scenes",
        config.cluster,
    )
    with atomic_folder(target) as out:
        write_scenes(scenes, out)
        write_tasks(pd.concat(tasks, ignore_index=True), out)


def _tasks(environment: Environment, counts: dict[str, int], scene: Scene) -> pd.DataFrame:
    check_sources([scene])  # a worker may have other files
    return environment.tasks(scene, counts[scene.name])


if __name__ == "__main__":
    main()
