"""Try variants of the methods on the validation scenes: the evidence for the choices in conf/."""

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.environments import ENVIRONMENTS, Split, pick, read_problems, read_scenes
from pipeline.environments.oracle import shards
from pipeline.evaluation.choices import Variant, variants
from pipeline.evaluation.trials import Experiment, Method, run_trials
from pipeline.files import atomic_folder, code_digest, digest, read_arrays, write_table
from pipeline.learning import CompnetxNetwork, load_model
from pipeline.parallel import run_shards
from pipeline.profile import Profile
from pipeline.samplers.choices import Learned
from pipeline.schema import Choice, convert
from pipeline.stage import SCRATCH, folder, guarded


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: Choice
    bases: dict[str, Method]
    variants: list[Variant]
    experiment: dict[str, Any]
    shard: int
    workers: int


@hydra.main(version_base="1.3", config_path="../conf", config_name="choices")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    methods = variants(config.bases, config.variants)
    empty = convert({**config.experiment, "methods": {"base": asdict(next(iter(methods.values())))}}, Experiment)
    experiment = replace(empty, methods=methods)
    profile, name = config.profile.name, config.environment.name
    environment = config.environment.make(ENVIRONMENTS, "environment")
    source, voxels = folder(profile, "scenes", name), folder(profile, "voxels", name) / "voxels.npz"
    trained = folder(profile, "train", name) / "model.pt"
    scenes = read_scenes(source)
    problems = read_problems(source, environment.robot().dimension)
    problems = pick(problems, [Split.VALIDATION], config.profile.choices.problems_per_scene)
    grids = read_arrays(voxels, "voxels", ("scene", "voxels"))
    learned = Learned(CompnetxNetwork(load_model(trained)), dict(zip(grids["scene"], grids["voxels"], strict=True)))
    files = [source / "scenes.parquet", source / "problems.parquet", voxels, trained]
    chosen = [config.profile.choices.problems_per_scene, config.shard]
    key = digest(*files, chosen, asdict(experiment), config.environment.parameters, code_digest())
    frames = run_shards(
        partial(run_trials, experiment, environment, scenes, learned),
        list(shards(problems, config.shard)),
        SCRATCH / "choices" / key,
        config.workers,
        "choices",
    )
    trials = pd.concat(frames, ignore_index=True).drop(columns=["path", "waypoints", "dimension"])
    with atomic_folder(folder(profile, "choices", name)) as out:
        write_table(trials, out / "trials.parquet", "trials")


if __name__ == "__main__":
    main()
