"""Generate the scenes and problems of an environment."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.environments import BANDS, ENVIRONMENTS, Scene, Split, write_problems, write_scenes
from pipeline.keys import code_digest, digest
from pipeline.parallel import run_shards
from pipeline.profile import Profile
from pipeline.schema import Choice
from pipeline.stage import SCRATCH, destination, guarded


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: Choice
    workers: int


@hydra.main(version_base="1.3", config_path="../conf", config_name="scenes")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    target = destination(config.profile.name, "scenes", config.environment.name)
    environment, scale = config.environment.make(ENVIRONMENTS, "environment"), config.profile.scenes
    scenes = environment.scenes(scale.counts)
    counts = {
        scene.name: scale.band_pairs
        if scene.scenario == BANDS
        else scale.test_pairs
        if scene.split is Split.TEST
        else scale.pairs
        for scene in scenes
    }
    key = digest(asdict(config.environment), counts, code_digest(Path(__file__)))
    problems = run_shards(
        partial(_problems, environment, counts),
        [(scene.name, scene) for scene in scenes],
        SCRATCH / "scenes" / key,
        config.workers,
        "scenes",
    )
    with atomic_folder(target) as out:
        write_scenes(scenes, out)
        write_problems(pd.concat(problems, ignore_index=True), out)


def _problems(environment: Any, counts: dict[str, int], scene: Scene) -> pd.DataFrame:
    frame: pd.DataFrame = environment.problems(scene, counts[scene.name])
    return frame


if __name__ == "__main__":
    main()
