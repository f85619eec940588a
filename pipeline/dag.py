"""The pipeline's DAG for DVC: written from what stages import and what Hydra composes, so that nobody keeps it by hand.

Every stage runs once per environment, but for the report. The name of an environment is Hydra's choice, that of its
configuration files and of the folder that the stage writes.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import yaml
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode

from pipeline.config import environments
from pipeline.keys import imported_files

_HEAD = """\
# Written by `make dag`, do not edit: stages are in pipeline/dag.py, what they read follows from imports and from conf/.
# The pipeline for whatever profile the params.yaml beside this file names (docs/architecture.md, "Profiles").
"""


@dataclass(frozen=True)
class Stage:
    """A stage of the pipeline.

    Attributes:
        name: of its script, its configuration and its folder.
        says: what it makes, for `dvc stage list`.
        reads: stages whose folders it reads.
        sections: of the profile that it reads.
        metrics: whether it writes metrics.json.
        started: modules that it starts in a process of their own, which imports do not show.
    """

    name: str
    says: str
    reads: tuple[str, ...] = ()
    sections: tuple[str, ...] = ()
    metrics: bool = False
    started: tuple[str, ...] = ()


SCENES = "scenes"  # the stage that runs an environment's own code
STAGES = (
    Stage(SCENES, "Scenes and tasks", sections=("scenes",)),
    Stage("demonstrations", "Paths of the oracle", ("scenes",), metrics=True),
    Stage("voxels", "Voxel grids of the scenes", ("scenes",)),
    Stage("train", "CoMPNetX", ("scenes", "demonstrations", "voxels"), ("train",), metrics=True),
    Stage("benchmark", "Methods on test problems", ("scenes", "voxels", "train"), ("benchmark",), metrics=True),
    Stage("choices", "Variants of the methods on validation problems", ("scenes", "voxels", "train"), ("choices",)),
)
REPORT = Stage(
    "report",
    "The pages a reader sees",
    ("scenes", "demonstrations", "train", "benchmark", "choices"),
    started=("pipeline/reporting/scene_vtk.py", "pipeline/reporting/stills_vtk.py"),
)


def dag(root: Path) -> str:
    """Return the text of dvc.yaml for the stages of a repository at `root`, the same for all profiles."""
    names = environments(root)
    stages = {f"{stage.name}-{name}": _stage(root, stage, name) for name in names for stage in STAGES}
    stages[REPORT.name] = _report(root, names)
    below = "${root}/artifacts/${profile}"
    metrics = [f"{below}/{s.name}/{name}/metrics.json" for s in STAGES if s.metrics for name in names]
    curves = {"x": "epoch", "y": ["train_loss", "val_loss"]}
    plots = [{f"{below}/train/{name}/curves.csv": {**curves, "title": f"CoMPNetX, {name}"}} for name in names]
    content = {"stages": stages, "metrics": metrics, "plots": plots}
    return _HEAD + yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=10**6, allow_unicode=True)


def write_dag(root: Path) -> list[Path]:
    """Write dvc.yaml at `root` and beside the other profiles' params.yaml; return the files."""
    text = dag(root)
    files = [root / "dvc.yaml", *(path.parent / "dvc.yaml" for path in sorted(root.glob("profiles/*/params.yaml")))]
    for file in files:
        file.write_text(text)
    return files


def _stage(root: Path, stage: Stage, environment: str) -> dict[str, object]:
    profile: dict[str, object] = {"conf/profile/${profile}.yaml": sorted(["name", *stage.sections])}
    files = _composed(root, stage.name, [f"environment={environment}"])
    read = [*(f"artifacts/${{profile}}/{name}/{environment}" for name in stage.reads), *_code(root, stage)]
    return {
        "wdir": "${root}",
        "desc": f"{stage.says}, {environment}",
        "cmd": f"python stages/{stage.name}.py profile=${{profile}} environment={environment}",
        "deps": [*read, *(_given(root, environment) if stage.name == SCENES else ())],
        "params": [*({file: None} for file in files), profile],
        "outs": [f"artifacts/${{profile}}/{stage.name}/{environment}"],
    }


def _report(root: Path, names: list[str]) -> dict[str, object]:
    written = ["README.md", "layout.json", *(entry for name in names for entry in (name, f"{name}.md"))]
    return {
        "wdir": "${root}",
        "desc": REPORT.says,
        "cmd": "python stages/report.py profile=${profile} output=${reports}",
        "deps": [*(f"artifacts/${{profile}}/{name}" for name in REPORT.reads), *_code(root, REPORT)],
        # At the end, whatever changes has changed before: the whole profile.
        "params": [*({f: None} for f in _composed(root, REPORT.name, [])), {"conf/profile/${profile}.yaml": None}],
        "outs": [{f"${{reports}}/{name}": {"cache": False}} for name in written],
    }


def _composed(root: Path, stage: str, overrides: list[str]) -> list[str]:
    """Return the files of conf/ that Hydra reads for a stage, its own first, those of profiles and Hydra's apart."""
    with initialize_config_dir(str(root / "conf"), version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
        defaults = loader.compute_defaults_list(stage, overrides, RunMode.RUN).defaults
    paths = {str(default.config_path) for default in defaults if default.config_path}
    others = sorted(path for path in paths if not path.startswith(("hydra/", "profile/")) and path != stage)
    return [f"conf/{path}.yaml" for path in (stage, *others) if path in paths]


def _given(root: Path, environment: str) -> list[str]:
    """Return the files and folders of a user's that an environment reads, but for meshes of a family's robot."""
    with initialize_config_dir(str(root / "conf"), version_base="1.3"):
        choice = compose(SCENES, [f"environment={environment}"]).environment
    given = choice.parameters
    if choice.kind == "folder":
        return [given.folder, *given.get("files", [])]
    robot = given.robot.parameters if choice.kind == "family" and given.get("robot") else {}
    named = [str(robot.get(key) or "") for key in ("urdf", "srdf")]
    return [address for address in named if address and not address.startswith("package://")]


def _code(root: Path, stage: Stage) -> list[str]:
    """Return the files a stage runs; a folder of the package where it runs all of its files."""
    script = f"stages/{stage.name}.py"
    files = set(imported_files([root / script], root)) - {script} | set(stage.started)
    found = {*_gathered(root, files), *_data(root, files)}
    return [script, *sorted(path for path in found if str(Path(path).parent) not in found)]


def _data(root: Path, files: Iterable[str]) -> Iterable[str]:
    """Return folders without code beside files that are run: descriptions of robots, shapes."""
    for folder in {root / Path(file).parent for file in files}:
        for other in folder.iterdir():
            if other.is_dir() and not any(other.glob("*.py*")) and not other.name.startswith(("_", ".")):
                yield str(other.relative_to(root))


def _gathered(root: Path, files: Iterable[str]) -> Iterable[str]:
    found = set(files)
    for file in found:
        folder = Path(file).parent
        whole = {str(path.relative_to(root)) for path in (root / folder).glob("*.py")}
        yield str(folder) if len(folder.parts) > 1 and whole <= found else file


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]  # PyYAML has no types
    """Lists below their key are indented, nothing is written as an empty value, and everything in full."""

    def ignore_aliases(self, data: object) -> bool:
        del data
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)


_Dumper.add_representer(type(None), lambda dumper, _: dumper.represent_scalar("tag:yaml.org,2002:null", ""))
