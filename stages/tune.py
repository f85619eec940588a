"""Train and try one method on the validation scenes: one row of a sweep's table. Not a stage of the pipeline."""

from dataclasses import dataclass, fields

import hydra
import pandas as pd
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.evaluation import summary
from pipeline.evaluation.trials import Experiment, Method, run_trials
from pipeline.learning.choices import Learned
from pipeline.learning.recipe import Recipe, train_recipe
from pipeline.parallel import single_threaded
from pipeline.schema import Choice
from pipeline.spec.scene import Split, pick, read_tasks
from pipeline.stage import ARTIFACTS, SCRATCH, folder, guarded
from pipeline.sweep import keep_row
from pipeline.tasks.sources import current_scenes
from pipeline.verification.verdict import VerifierParameters


@dataclass(frozen=True)
class Config(Recipe):
    adherence: Choice
    method: Method
    verifier: VerifierParameters
    problems_per_scene: int
    time_limit: float
    trial_seed: int


@hydra.main(version_base="1.3", config_path="../conf", config_name="tune")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    profile, name = config.profile.name, config.environment.name
    experiment = Experiment(
        {"tuned": config.method},
        {config.adherence.kind: config.adherence},
        config.time_limit,
        config.trial_seed,
        config.verifier,
    )
    source = folder(profile, "scenes", name)
    scenes = current_scenes(source)
    problems = read_tasks(source, scenes)
    problems = pick(problems, [Split.VALIDATION], config.problems_per_scene)
    recipe = Recipe(**{f.name: getattr(config, f.name) for f in fields(Recipe)})
    model, trained = train_recipe(recipe, ARTIFACTS, SCRATCH / "train")
    learned = Learned.of(model, folder(profile, "voxels", name) / "voxels.npz")
    with single_threaded():
        trials = pd.concat(
            run_trials(experiment, config.environment, scenes, learned, rows) for _, rows in problems.groupby("scene")
        )
    solved = trials[trials.solved]
    times, lengths = summary((1e3 * trials.planning_time).to_numpy(float)), summary(solved.path_length.to_numpy(float))
    row = {
        "n": len(trials),
        "solved [%]": 100 * trials.solved.mean(),
        "time median [ms]": times.median,
        "time mean [ms]": times.mean,
        "time p95 [ms]": times.p95,
        "length median": lengths.median,
        "samples": float(trials.samples.median()),
        "collision checks": float(trials.collision_checks.median()),
        "fallback [%]": 100 * trials.fallback_samples.sum() / max(trials.samples.sum(), 1),
        "val_loss": trained.metrics["val_loss"],
    }
    print(pd.Series(row).to_string())
    keep_row(row)


if __name__ == "__main__":
    main()
