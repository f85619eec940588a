"""Try variants of the methods on the validation scenes: the evidence for the choices in conf/."""

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.evaluation.choices import Variant, variant_settings, variants
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.oracle import shards
from pipeline.evaluation.runner import PATH
from pipeline.evaluation.trials import Experiment, Method, run_trials
from pipeline.files import write_json, write_table
from pipeline.keys import code_digest, digest
from pipeline.learning.choices import Learned
from pipeline.learning.compnetx import load_model
from pipeline.parallel import timed_shards
from pipeline.profile import Profile
from pipeline.schema import convert
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import SCENES, TASKS, Split, pick, read_tasks
from pipeline.stage import SCRATCH, destination, folder, guarded
from pipeline.tasks.sources import current_scenes


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: EnvironmentChoice
    bases: dict[str, Method]
    variants: list[Variant]
    experiment: dict[str, Any]
    shard: int
    workers: int
    cluster: str | None


@hydra.main(version_base="1.3", config_path="../conf", config_name="choices")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    methods = variants(config.bases, config.variants)
    empty = convert({**config.experiment, "methods": {"base": asdict(next(iter(methods.values())))}}, Experiment)
    experiment = replace(empty, methods=methods)
    profile, name = config.profile.name, config.environment.name
    target = destination(profile, "choices", name)
    source, voxels = folder(profile, "scenes", name), folder(profile, "voxels", name) / "voxels.npz"
    trained = folder(profile, "train", name) / "model.pt"
    scenes = current_scenes(source)
    problems = read_tasks(source, scenes)
    problems = pick(problems, [Split.VALIDATION], config.profile.choices.problems_per_scene)
    learned = Learned.of(load_model(trained), voxels)
    files = [source / SCENES, source / TASKS, voxels, trained]
    chosen = [config.profile.choices.problems_per_scene, config.shard, asdict(config.environment)]
    key = digest(*files, chosen, asdict(experiment), code_digest(Path(__file__)))
    work = partial(run_trials, experiment, config.environment, scenes, learned)
    items, scratch = list(shards(problems, config.shard)), SCRATCH / "choices" / key
    with (
        timed_shards(work, items, scratch, config.workers, "choices", hardware, config.cluster) as measured,
        atomic_folder(target) as out,
    ):
        trials = pd.concat(measured.frames, ignore_index=True).drop(columns=list(PATH))
        write_table(trials, out / "trials.parquet", "trials")
        write_json(variant_settings(config.bases, config.variants), out / "methods.json", "variants")
        write_json(measured.provenance, out / "hardware.json", "hardware")


if __name__ == "__main__":
    main()
