"""Run every method on the test problems, verify the paths, and keep samples and recordings to look at."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import hydra
import pandas as pd
from omegaconf import DictConfig, OmegaConf

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.errors import require
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.oracle import shards
from pipeline.evaluation.runner import PATH
from pipeline.evaluation.trials import Experiment, benchmark_metrics, method_settings, run_trials, sample_clouds
from pipeline.files import write_arrays, write_json, write_table
from pipeline.keys import code_digest, digest
from pipeline.learning.choices import Learned
from pipeline.learning.compnetx import load_model
from pipeline.parallel import single_threaded, timed_shards
from pipeline.profile import Profile
from pipeline.recording.trials import record_trials
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import SCENES, TASKS, Split, pick, read_tasks
from pipeline.stage import SCRATCH, destination, folder, guarded
from pipeline.tasks.sources import current_scenes


@dataclass(frozen=True)
class Config:
    profile: Profile
    environment: EnvironmentChoice
    experiment: Experiment
    cloud: int
    shard: int
    workers: int
    cluster: str | None

    def __post_init__(self) -> None:
        require("cloud", self.cloud, at_least=1)
        self.experiment.check_names()


@hydra.main(version_base="1.3", config_path="../conf", config_name="benchmark")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    profile, name, scale = config.profile.name, config.environment.name, config.profile.benchmark
    target = destination(profile, "benchmark", name)
    source, voxels = folder(profile, "scenes", name), folder(profile, "voxels", name) / "voxels.npz"
    trained, scenes = folder(profile, "train", name) / "model.pt", current_scenes(source)
    problems = pick(read_tasks(source, scenes), [Split.TEST], scale.problems_per_scene, scale.others)
    learned = Learned.of(load_model(trained), voxels)
    files = [source / SCENES, source / TASKS, voxels, trained]
    chosen = [scale.problems_per_scene, scale.others, config.shard, asdict(config.environment)]
    key = digest(*files, chosen, asdict(config.experiment), code_digest(Path(__file__)))
    work = partial(run_trials, config.experiment, config.environment, scenes, learned)
    items, scratch = list(shards(problems, config.shard)), SCRATCH / "benchmark" / key
    with (
        timed_shards(work, items, scratch, config.workers, "benchmark", hardware, config.cluster) as measured,
        atomic_folder(target) as out,
        single_threaded(),
    ):
        trials = pd.concat(measured.frames, ignore_index=True)
        write_table(trials.drop(columns=list(PATH)), out / "trials.parquet", "trials")
        columns = ["scenario", "scene", "problem", "leg", "method", "adherence", *PATH]
        write_table(trials.loc[trials.solved, columns], out / "solutions.parquet", "solutions")
        clouds = sample_clouds(config.experiment, config.environment, scenes, learned, problems, config.cloud)
        write_arrays(clouds, out / "samples.npz", "samples")
        write_json(measured.provenance, out / "hardware.json", "hardware")
        write_json(method_settings(config.experiment.methods), out / "methods.json", "methods")
        write_json(benchmark_metrics(trials), out / "metrics.json")
        settings = OmegaConf.to_container(cfg, resolve=True)
        record_trials(trials, problems, scenes, settings, scale.recordings, out / "recordings")


if __name__ == "__main__":
    main()
