"""Turn every scene into the voxel grid the scene encoder sees."""

from dataclasses import dataclass

import hydra
import numpy as np
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.files import write_arrays
from pipeline.perception import Perception, scene_voxels
from pipeline.profile import Profile
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import read_scenes
from pipeline.stage import destination, folder, guarded


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: EnvironmentChoice
    perception: Perception


@hydra.main(version_base="1.3", config_path="../conf", config_name="voxels")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    target = destination(config.profile.name, "voxels", config.environment.name)
    scenes = read_scenes(folder(config.profile.name, "scenes", config.environment.name))
    voxels = config.perception.of(next(iter(scenes.values())).statement.robot)
    grids = [scene_voxels(scene.obstacles, voxels, config.perception.seed) for scene in scenes.values()]
    with atomic_folder(target) as out:
        write_arrays(
            {"scene": np.array(list(scenes)), "voxels": np.stack(grids), "bounds": voxels.bounds},
            out / "voxels.npz",
            "voxels",
        )


if __name__ == "__main__":
    main()
