"""Write the pages a reader sees."""

from dataclasses import dataclass
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pipeline import reporting
from pipeline.atomic import atomic_entries, check_file
from pipeline.config import load
from pipeline.errors import ConfigError, require_name
from pipeline.files import read_arrays, read_json, read_table
from pipeline.profile import Profile
from pipeline.recording.layout import write_layout
from pipeline.reporting.frames import in_order, read_curves
from pipeline.spec.scene import read_scenes
from pipeline.stage import folder, guarded


@dataclass(frozen=True)
class Config:
    profile: Profile
    environments: list[str]
    papers: dict[str, reporting.Paper]
    other: reporting.Paper
    output: Path
    plain_stills: bool | None

    def __post_init__(self) -> None:
        if self.output.resolve() == Path.cwd().resolve():
            raise ConfigError("output is the current folder and would replace README.md; name one such as reports")
        check_file(self.output / "README.md")
        if not self.environments:
            raise ConfigError("environments is empty; name at least one")
        for name in self.environments:
            require_name("a name in environments", name)


@hydra.main(version_base="1.3", config_path="../conf", config_name="report")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    # Entry by entry: beside these pages may lie others that this stage does not write.
    with atomic_entries(config.output) as out:
        summaries = [(f"{name}.md", _page(config, name, out)) for name in config.environments]
        index = reporting.index("Reports", summaries, _provenance(config, config.environments[0]))
        reporting.write(index, out / "README.md")
        write_layout(out / "layout.json", 3)


def _page(config: Config, name: str, out: Path) -> reporting.Section:
    """Write the page of an environment and its pictures; return its section of the index."""
    benchmark = folder(config.profile.name, "benchmark", name)
    settings = read_json(benchmark / "methods.json", "methods")
    trials = in_order(read_table(benchmark / "trials.parquet", "trials"), settings)
    solutions = in_order(read_table(benchmark / "solutions.parquet", "solutions"), settings)
    samples = read_arrays(benchmark / "samples.npz", "samples")
    curves = read_curves(folder(config.profile.name, "train", name))
    scenes = read_scenes(folder(config.profile.name, "scenes", name))
    choices = read_table(folder(config.profile.name, "choices", name) / "trials.parquet", "trials")
    tried = read_json(folder(config.profile.name, "choices", name) / "methods.json", "variants")
    paper = config.papers.get(name, config.other).titled(name)
    provenance, stills = _provenance(config, name), reporting.Stills(config.plain_stills)
    figures = out / name  # beside the page, which links to it by this name
    pictures = {
        **reporting.environment_figures(trials, curves, figures, paper),
        **reporting.path_pictures(trials, solutions, scenes, samples, figures, stills, paper),
    }
    text = reporting.environment_page(trials, pictures, provenance, choices, settings, tried, paper)
    reporting.write(text, out / f"{name}.md")
    return reporting.environment_summary(trials, pictures, provenance, settings, paper)


def _provenance(config: Config, name: str) -> reporting.Provenance:
    places = [folder(config.profile.name, stage, name) / "hardware.json" for stage in ("benchmark", "choices")]
    return reporting.Provenance.read(config.profile.name, *places)


if __name__ == "__main__":
    main()
