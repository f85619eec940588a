"""Train a model on the demonstrations."""

import hydra
from omegaconf import DictConfig

from pipeline.atomic import atomic_folder
from pipeline.config import load
from pipeline.files import write_json
from pipeline.learning.compnetx import save_model
from pipeline.learning.recipe import Recipe, train_recipe
from pipeline.stage import ARTIFACTS, SCRATCH, destination, guarded


@hydra.main(version_base="1.3", config_path="../conf", config_name="train")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Recipe)
    target = destination(config.profile.name, "train", config.environment.name)
    model, trained = train_recipe(config, ARTIFACTS, SCRATCH / "train")
    with atomic_folder(target) as out:
        save_model(model, out / "model.pt")
        trained.curves.to_csv(out / "curves.csv", index=False)
        write_json(trained.metrics, out / "metrics.json")


if __name__ == "__main__":
    main()
