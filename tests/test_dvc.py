"""DVC runs what Hydra composes: every stage again when, and only when, something it reads has changed."""

import ast
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import networkx
import numpy as np
import pandas as pd
import pytest
import yaml
from dvc.dependency.param import ParamsDependency
from dvc.repo import Repo
from dvc.stage import Stage
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode

from pipeline.config import ROOT
from pipeline.dag import _given, dag
from pipeline.files import read_table
from pipeline.recording import read_recording

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:dvc")
SOURCES = (
    *("conf", "pipeline", "stages", "profiles", "dvc.yaml", "params.yaml", ".dvc/config", ".dvc/.gitignore"),
    *(".dvcignore", ".gitignore", "artifacts/.gitignore", "examples/my_arm"),
)
STAGES = list(yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"])
PROFILES = {"quick": ".", **{path.name: f"profiles/{path.name}" for path in sorted((ROOT / "profiles").iterdir())}}
ENVIRONMENTS = sorted(path.stem for path in (ROOT / "conf" / "environment").glob("*.yaml"))
EACH = [(profile, stage) for profile in PROFILES for stage in STAGES]
SPHERE = {name for name in STAGES if name.endswith("-sphere")}


def copied(folder: Path) -> Path:
    """Copy the sources into a repository of their own, with nothing that was computed."""
    for name in SOURCES:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, target, follow_symlinks=False)
    call(folder, "git", "init", "-q")
    commit(folder)
    return folder


def commit(folder: Path) -> None:
    call(folder, "git", "add", "-A")
    call(folder, "git", "-c", "user.name=test", "-c", "user.email=test@localhost", "commit", "-qm", "state")


def environment(folder: Path) -> dict[str, str]:
    """Return the environment variables in which commands run in a copy with the interpreter of the tests."""
    return {
        # A hook of git's may have set which repository to work on: never from here.
        **{name: value for name, value in os.environ.items() if not name.startswith("GIT_")},
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(folder),
        "DVC_SITE_CACHE_DIR": str(folder.parent / "site"),
    }


def call(folder: Path, *command: str) -> str:
    """Run a command in a copy; return what it printed."""
    done = subprocess.run(command, cwd=folder, env=environment(folder), text=True, capture_output=True)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout + done.stderr


@contextmanager
def opened(folder: Path) -> Iterator[Repo]:
    """Open a copy; DVC resolves names such as dvc.yaml in the current folder, not in that of the repository."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("DVC_SITE_CACHE_DIR", str(folder.parent / "site"))
        for name in [name for name in os.environ if name.startswith("GIT_")]:
            patch.delenv(name)
        with Repo(str(folder)) as repository:
            yield repository


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """A repository in which every stage of the profile quick counts as done, with outputs that nothing computed."""
    folder = copied(tmp_path_factory.mktemp("committed") / "repository")
    with opened(folder) as repository:
        for stage in repository.index.stages:
            for out in stage.outs if stage.path_in_repo == "dvc.yaml" else ():
                path = Path(out.fs_path)
                if path.suffix:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_text(out.fs_path)
                else:
                    path.mkdir(parents=True)
                    (path / "content").write_text(out.fs_path)
        repository.commit("dvc.yaml", force=True)
    return folder


@pytest.fixture(scope="module")
def stages(copy) -> dict[tuple[str, str], Stage]:
    """Every stage by profile and name, as DVC resolves it."""
    folders = {str(copy / place): profile for profile, place in PROFILES.items()}
    with opened(copy) as repository:
        return {(folders[str(Path(s.path).parent)], s.name): s for s in repository.index.stages}


def of(script: str, names: Iterable[str] = ENVIRONMENTS) -> set[str]:
    """Return the stages of a script, one for each environment."""
    return {f"{script}-{environment}" for environment in names}


def script_of(name: str) -> str:
    """Return the script of a stage, without its environment."""
    return name.partition("-")[0]


def within(copy: Path, path: str) -> str:
    return str(Path(path).relative_to(copy))


def params(copy: Path, stage: Stage) -> dict[str, list[str]]:
    """Return file -> keys of what a stage watches by value; no keys stand for the whole file."""
    found = [d for d in stage.deps if isinstance(d, ParamsDependency)]
    return {within(copy, d.fs_path): list(d.params) for d in found}


def dependencies(copy: Path, stage: Stage) -> list[str]:
    return [within(copy, d.fs_path) for d in stage.deps if not isinstance(d, ParamsDependency)]


IMPORTS = """
import json, os, runpy, sys
import casadi, coal, hydra, joblib, lightning, matplotlib.figure, mcap.writer, pandas, pinocchio, scipy.spatial, torch
found = {}
for script in sys.argv[1:]:
    reading, writing = os.pipe()
    if os.fork() == 0:
        runpy.run_path(script, run_name="stage")
        modules = [getattr(module, "__file__", None) for name, module in sys.modules.items()
                   if name.split(".")[0] == "pipeline"]
        os.write(writing, json.dumps([file for file in modules if file]).encode())
        os._exit(0)
    os.close(writing)
    found[script] = json.loads(os.fdopen(reading).read() or "null")
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def imported(copy) -> dict[str, set[str]]:
    """Stage -> files of `pipeline` that are loaded once a fresh process has imported its script."""
    found = json.loads(call(copy, sys.executable, "-c", IMPORTS, *(f"stages/{s}.py" for s in map(script_of, STAGES))))
    files = {Path(script).stem: {within(copy, file) for file in files} for script, files in found.items()}
    return {name: files[script_of(name)] for name in STAGES}


def test_every_profile_has_every_stage(copy, stages):
    """DVC finds each stage once per profile and starts it in the root, with its profile and environment."""
    assert sorted(stages) == sorted(EACH)
    for (profile, name), stage in stages.items():
        script, *overrides = stage.cmd.split()[1:]
        assert stage.cmd.startswith("python ") and script == f"stages/{script_of(name)}.py" and Path(stage.wdir) == copy
        assert f"profile={profile}" in overrides
        assert [o for o in overrides if o.startswith("environment=")] == [
            f"environment={e}" for e in name.split("-")[1:]
        ]


def test_dag_is_what_make_dag_writes():
    """The committed files are those that `make dag` would write now."""
    for folder in PROFILES.values():
        assert (ROOT / folder / "dvc.yaml").read_text() == dag(ROOT), "run `make dag`"


@pytest.mark.parametrize(("profile", "name"), EACH)
def test_params_are_the_files_hydra_composes(copy, stages, profile, name):
    """A stage watches exactly the files that Hydra reads for its command line, those of Hydra itself apart."""
    overrides = stages[profile, name].cmd.split()[2:]
    with initialize_config_dir(str(copy / "conf"), version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
        defaults = loader.compute_defaults_list(script_of(name), overrides, RunMode.RUN).defaults
    composed = {f"conf/{default.config_path}.yaml" for default in defaults}
    composed = {path for path in composed if not path.startswith("conf/hydra/")}
    assert f"conf/profile/{profile}.yaml" in composed
    assert set(params(copy, stages[profile, name])) == composed


@pytest.mark.parametrize(("profile", "name"), EACH)
def test_params_of_the_profile_are_the_sections_read(copy, stages, imported, profile, name):
    """Of the profile a stage watches its name and the sections that its script, or what it imports, reads."""
    watched = params(copy, stages[profile, name])
    sections = set(yaml.safe_load((copy / f"conf/profile/{profile}.yaml").read_text()))
    read = set()
    for path in {f"stages/{script_of(name)}.py", *imported[name]}:
        for node in ast.walk(ast.parse((copy / path).read_text())):
            match node:
                case ast.Attribute(attr=section, value=ast.Attribute(attr="profile")):
                    read.add(section)
    assert read <= sections
    keys = watched.pop(f"conf/profile/{profile}.yaml")
    assert set(keys) == read or (not keys and name == "report")  # at the end, whatever changes has changed before
    assert list(watched.values()) == [[]] * len(watched)


@pytest.mark.parametrize("name", STAGES)
def test_imports_are_dependencies(copy, stages, imported, name):
    """Every module of ours that a stage imports is a dependency or inside one, as is its own script."""
    listed = dependencies(copy, stages["quick", name])
    assert len(imported[name]) > 5
    assert uncovered({*imported[name], f"stages/{script_of(name)}.py"}, listed) == set()


def test_started_scripts_are_dependencies(copy, stages, imported):
    """A script of ours that a module starts in a process of its own is a dependency of the module's stages too."""
    scripts = r'with_name\("(\w+\.py)"\)'
    missing = {}
    for name in STAGES:
        found = {(path, script) for path in imported[name] for script in re.findall(scripts, (copy / path).read_text())}
        started = {str(Path(path).with_name(script)) for path, script in found}
        missing[name] = uncovered(started, dependencies(copy, stages["quick", name]))
    assert missing == {name: set() for name in STAGES}


def uncovered(files: set[str], listed: list[str]) -> set[str]:
    """Return the files that are neither among the listed paths nor inside one of them."""
    return {path for path in files if not any(Path(path).is_relative_to(entry) for entry in listed)}


@pytest.mark.parametrize("name", STAGES)
def test_dependencies_are_there_and_needed(copy, stages, imported, name):
    """Every dependency exists or is an output of another stage; one in `pipeline` is imported at once, named by what is
    (an import inside a function), or data."""
    sources = "".join((copy / file).read_text() for file in imported[name])
    listed = dependencies(copy, stages["quick", name])
    outputs = [within(copy, out.fs_path) for stage in stages.values() for out in stage.outs]
    assert len(set(listed)) == len(listed)
    for path in listed:
        if path.startswith("artifacts/"):
            assert any(Path(output).is_relative_to(path) for output in outputs)
        else:
            assert (copy / path).exists()
        if path.startswith("pipeline/") and not path.endswith("_vtk.py"):  # started, not imported
            modules = [path] if path.endswith(".py") else [str(f.relative_to(copy)) for f in (copy / path).glob("*.py")]
            named = {module.removesuffix(".py").replace("/", ".") for module in modules}
            assert not modules or set(modules) & imported[name] or any(f"from {module} " in sources for module in named)


def test_every_environment_has_every_stage():
    """An environment is a choice of Hydra and the folder that a stage writes; groups chosen by it have files of
    environments, and one for all others."""
    document = yaml.safe_load((ROOT / "dvc.yaml").read_text())
    scripts = dict.fromkeys(script_of(name) for name in STAGES if name != "report")
    assert sorted(STAGES) == sorted(
        [*(f"{s}-{environment}" for s in scripts for environment in ENVIRONMENTS), "report"]
    )
    for name, stage in document["stages"].items():
        if name != "report":
            script, environment = name.split("-")
            assert stage["outs"] == [f"artifacts/${{profile}}/{script}/{environment}"]
    chosen = {
        m
        for path in (ROOT / "conf").glob("*.yaml")
        for m in re.findall(r"- (\w+): \$\{own_or:\1,\$\{environment\},arm\}", path.read_text())
    }
    assert chosen == {"oracle", "perception", "recipe", "experiment", "tried"}
    for group in (*chosen, "paper"):
        files = {path.stem for path in (ROOT / "conf" / group).glob("*.yaml")}
        assert {"arm", "sphere"} <= files <= {"arm", *ENVIRONMENTS}
    for path in document["metrics"]:
        stage, environment = re.fullmatch(
            r"\$\{root\}/artifacts/\$\{profile\}/(\w+)/(\w+)/metrics\.json", path
        ).groups()
        assert stage in scripts and environment in ENVIRONMENTS


def test_a_description_of_ones_own_is_watched(tmp_path):
    """DVC watches the URDF of a family's robot where no package has it; its SRDF, of a package, it does not."""
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    path = tmp_path / "conf" / "environment" / "transport_panda.yaml"
    path.write_text(path.read_text() + "  robot: {parameters: {urdf: mine/arm.urdf}}\n")
    assert _given(tmp_path, "transport_panda") == ["mine/arm.urdf"]
    assert _given(tmp_path, "sphere") == _given(ROOT, "transport_panda") == []


def test_profiles_share_one_pipeline(stages):
    """Every profile has the same dvc.yaml and its own three variables; none writes into another's folders."""
    variables = {}
    for profile, folder in PROFILES.items():
        assert (ROOT / folder / "dvc.yaml").read_bytes() == (ROOT / "dvc.yaml").read_bytes()
        variables[profile] = yaml.safe_load((ROOT / folder / "params.yaml").read_text())
        assert variables[profile].keys() == {"profile", "root", "reports"}
        assert variables[profile]["profile"] == profile
        assert (ROOT / folder / variables[profile]["root"]).resolve() == ROOT
    assert {path.stem for path in (ROOT / "conf" / "profile").glob("*.yaml")} == set(PROFILES)
    written = {name: {o.fs_path for (p, _), s in stages.items() if p == name for o in s.outs} for name in PROFILES}
    assert sum(map(len, written.values())) == len(set.union(*written.values()))
    published = [name for name, found in variables.items() if found["reports"] == "reports"]
    assert published == ["standard"]
    assert all(f["reports"] == f"artifacts/{n}/report" for n, f in variables.items() if n not in published)


def changed(folder: Path) -> dict[str, dict]:
    """Return stage -> what DVC finds changed about it."""
    with opened(folder) as repository:
        return {name: found[0] for name, found in repository.status(targets=["dvc.yaml"]).items()}


@pytest.fixture
def edit(copy):
    """Substitute a pattern, once, in files of the committed repository, for one test."""
    before = {}

    def substitute(name: str, pattern: str, new: str) -> None:
        before.setdefault(name, (copy / name).read_text())
        text, count = re.subn(pattern, new, (copy / name).read_text(), count=1)
        assert count == 1
        (copy / name).write_text(text)

    yield substitute
    for name, text in before.items():
        (copy / name).write_text(text)


@pytest.mark.parametrize(
    ("name", "key", "expected"),
    [
        ("conf/perception/sphere.yaml", "seed", {"voxels-sphere"}),
        ("conf/perception/sphere.yaml", "size", {"voxels-sphere"}),
        ("conf/perception/arm.yaml", "size", {"voxels-transport_panda"}),
        ("conf/model/compnetx.yaml", "dropout", set(of("train"))),
        ("conf/recipe/sphere.yaml", "spacing", {"train-sphere"}),
        ("conf/oracle/sphere.yaml", "shortcuts", {"demonstrations-sphere"}),
        ("conf/tried/sphere.yaml", "time_limit", {"choices-sphere"}),
        ("conf/profile/quick.yaml", "epochs", {*of("train"), "report"}),
        ("conf/profile/quick.yaml", "test_pairs", {*of("scenes"), "report"}),
        ("conf/profile/quick.yaml", "recordings", {*of("benchmark"), "report"}),
        ("conf/profile/standard.yaml", "epochs", set()),
        ("conf/environment/sphere.yaml", "blocks", SPHERE),
        ("conf/planner/rrt.yaml", "range", set()),
        ("conf/tune.yaml", "time_limit", set()),
    ],
)
def test_an_edited_number_concerns_those_who_read_it(copy, edit, name, key, expected):
    """With one number edited DVC finds changed just the stages that read it."""
    edit(name, rf"\b{key}: (\d[\d.]*)", rf"{key}: \g<1>1")
    assert set(changed(copy)) == expected


def test_what_comes_after_an_edit(copy):
    """After voxels come training and everything measured with it, but neither scenes nor demonstrations."""
    with opened(copy) as repository:
        graph = repository.index.graph.reverse()
        (voxels,) = (stage for stage in graph if stage.addressing == "voxels-sphere")
        after = {stage.addressing for stage in networkx.descendants(graph, voxels)}
    assert after == {"train-sphere", "benchmark-sphere", "choices-sphere", "report"}


def test_an_edited_comment_concerns_nobody(copy, edit):
    """With comments of all configuration files edited DVC finds nothing changed."""
    assert changed(copy) == {}
    for path in sorted((copy / "conf").rglob("*.yaml")):
        edit(str(path.relative_to(copy)), "# ", "# Indeed: ")
    assert changed(copy) == {}


def test_an_edited_module_concerns_those_who_import_it(copy, edit, imported):
    """With a module edited DVC finds changed all stages that import it and no other."""
    for module, number in (("pipeline/planners/ompl_adapter.py", 0), ("pipeline/learning/compnetx/sampler.py", 7)):
        edit(module, '"""', '"""Also: ')
        importing = {name for name in STAGES if module in imported[name]}
        assert set(changed(copy)) == importing and len(importing) == number


def test_params_diff_shows_the_edit(copy, edit):
    """Against the last commit DVC shows the edited number, its old and its new value, and nothing else."""
    commit(copy)
    edit("conf/perception/sphere.yaml", r"\bseed: 2", "seed: 3")
    found = json.loads(re.search(r"^\{.*\}$", call(copy, "dvc", "params", "diff", "--json"), re.MULTILINE).group())
    assert found == {"conf/perception/sphere.yaml": {"seed": {"old": 2, "new": 3, "diff": 1}}}


OWN = ["my_arm", "sphere"]  # environments of the repository below


def documented() -> list[list[str]]:
    """Return the commands that docs/own_robot.md shows first."""
    (block, *_) = re.findall(r"```\n(.*?)```", (ROOT / "docs" / "own_robot.md").read_text(), re.DOTALL)
    return [shlex.split(line, comments=True) for line in block.splitlines()]


@pytest.fixture(scope="module")
def smoke(tmp_path_factory) -> tuple[Path, str]:
    """A repository whose whole pipeline has run in the smallest sizes, and what DVC printed.

    Its environments are the sphere and the one that docs/own_robot.md makes, by the commands that it shows.
    """
    folder = copied(tmp_path_factory.mktemp("smoke") / "repository")
    for name in set(ENVIRONMENTS) - set(OWN):
        (folder / f"conf/environment/{name}.yaml").unlink()
    scale = yaml.safe_load((folder / "conf/profile/quick.yaml").read_text())
    small = {
        key: {n: {"bands": 1} if n == "others" else 1 for n in of_it} for key, of_it in scale.items() if key != "name"
    }
    small["scenes"]["pairs"] = 3
    (folder / "conf/profile/smoke.yaml").write_text(yaml.safe_dump({"name": "smoke", **small}))
    (folder / "params.yaml").write_text("profile: smoke\nroot: .\nreports: artifacts/smoke/report\n")
    for name, numbers in {
        "conf/environment/sphere.yaml": {"blocks": 80, "grid": 5000},
        "conf/planner/fmt.yaml": {"samples": 60},
        "conf/planner/fmt_learned.yaml": {"samples": 60},
        "conf/planner/fmt_tuned.yaml": {"samples": 60},
        "conf/planner/fmt_algorithm6.yaml": {"samples": 60},
        "conf/benchmark.yaml": {"cloud": 20},
        "conf/experiment/sphere.yaml": {"time_limit": 1.0},
        "conf/tried/sphere.yaml": {"time_limit": 0.1},
        "conf/scenes.yaml": {"workers": 1},
        "conf/demonstrations.yaml": {"workers": 1},
        "conf/report.yaml": {"plain_stills": "true"},
    }.items():
        for key, number in numbers.items():
            text, count = re.subn(rf"\b{key}: [\w.]+", f"{key}: {number}", (folder / name).read_text(), count=1)
            assert count == 1
            (folder / name).write_text(text)
    *before, repro = documented()
    assert repro == ["dvc", "repro"]
    for command in before:
        call(folder, *command)
    for path in folder.glob("problems/my_arm/train/scene_00[1-3]_*.yaml"):  # two problems to learn from are enough here
        path.unlink()
    commit(folder)
    return folder, call(folder, *repro)


def ran(log: str) -> list[str]:
    return re.findall(r"^Running stage '([\w-]+)", log, re.MULTILINE)


@pytest.mark.slow
def test_pipeline_runs_from_nothing(smoke):
    """`dvc repro` runs every stage once, after those it reads, and then finds nothing to do."""
    folder, log = smoke
    scripts = {script_of(name) for name in STAGES} - {"report"}
    assert sorted(ran(log)) == sorted([*(name for script in scripts for name in of(script, OWN)), "report"])
    assert script_of(ran(log)[0]) == "scenes" and ran(log)[-1] == "report"
    again = call(folder, "dvc", "repro")
    assert ran(again) == [] and "up to date" in again
    assert changed(folder) == {}


@pytest.mark.slow
def test_pipeline_leaves_git_as_it_was(smoke):
    """A run changes nothing that git tracks and leaves nothing untracked but DVC's lock."""
    status = call(smoke[0], "git", "status", "--porcelain", "--untracked-files=all")
    assert {line[3:] for line in status.splitlines()} == {"dvc.lock"}


@pytest.mark.slow
def test_reports_name_the_command(smoke):
    """The pages exist, say which command made their numbers, and show pictures that are there."""
    pages = smoke[0] / "artifacts/smoke/report"
    assert sorted(path.name for path in pages.iterdir()) == sorted(
        ["README.md", "layout.json", *OWN, *(f"{name}.md" for name in OWN)]
    )
    assert (pages / "my_arm.md").read_text().startswith("# My arm\n")
    for name in ("README.md", *(f"{name}.md" for name in OWN)):
        text = (pages / name).read_text()
        assert "`make repro PROFILE=smoke`" in text
        shown = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
        assert shown and all((pages / picture).is_file() for picture in shown)


@pytest.mark.slow
def test_recordings_are_the_stored_solutions(smoke):
    """Every recording reads back with the states of the stored solution, to the last bit, and each method has one."""
    folder = smoke[0] / "artifacts/smoke/benchmark/sphere"
    solutions = read_table(folder / "solutions.parquet", "solutions")
    trials = read_table(folder / "trials.parquet", "trials")
    keys = ["scenario", "scene", "problem", "method", "adherence"]
    assert len(solutions) == trials["solved"].sum() > 0
    stored = solutions.set_index(keys)
    recordings = sorted((folder / "recordings").glob("*.mcap"))
    assert len(recordings) == len(solutions.drop_duplicates(["scenario", "method", "adherence"]))
    for path in recordings:
        found = read_recording(path)
        about = {**found.metadata, "problem": int(found.metadata["problem"])}
        states = np.reshape(stored.loc[tuple(about[key] for key in keys), "path"], (-1, 3))
        np.testing.assert_array_equal(found.states, states)


@pytest.mark.slow
def test_dvc_shows_numbers_and_curves(smoke):
    """`dvc metrics show`, `dvc params diff` and `dvc plots show` work, and the first shows what the tables say."""
    folder, _ = smoke
    shown = call(folder, "dvc", "metrics", "show", "--json")
    found = json.loads(re.search(r"^\{.*\}$", shown, re.MULTILINE).group())[""]["data"]
    found = {
        Path(path).parts[2]: entry["data"] for path, entry in found.items() if "smoke" in path and "sphere" in path
    }
    demonstrations = pd.read_parquet(folder / "artifacts/smoke/demonstrations/sphere/paths.parquet")
    assert found["demonstrations"]["solved"] == demonstrations["solved"].sum()
    assert found["train"]["epochs"] == 1
    assert set(found["benchmark"]) == {"blocks", "bands"}
    call(folder, "dvc", "params", "diff")
    call(folder, "dvc", "plots", "show")
    assert (folder / "dvc_plots" / "index.html").is_file()


@pytest.mark.slow
def test_one_number_reruns_what_reads_it(smoke):
    """With another size of the clouds only the benchmark runs of what leads to it, and measures all of it again."""
    folder, _ = smoke
    out = folder / "artifacts/smoke/benchmark/sphere"
    times = read_table(out / "trials.parquet", "trials")["planning_time"].tolist()
    path = folder / "conf/benchmark.yaml"
    path.write_text(path.read_text().replace("cloud: 20", "cloud: 30"))
    assert set(changed(folder)) == of("benchmark", OWN)
    assert ran(call(folder, "dvc", "repro", "benchmark-sphere")) == ["benchmark-sphere"]
    assert read_table(out / "trials.parquet", "trials")["planning_time"].tolist() != times
    with np.load(out / "samples.npz") as clouds:
        assert {clouds[name].shape for name in clouds.files if "*" in name} == {(30, 3)}
    assert set(changed(folder)) == {"report", *of("benchmark", OWN)} - {"benchmark-sphere"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["problems/my_arm/test/scene_000_000.yaml", "examples/my_arm/my_arm.urdf"])
def test_files_of_a_user_are_watched(smoke, name):
    """With a problem file or the robot's description changed, DVC finds changed what reads them: the scenes."""
    folder, _ = smoke
    before, other = (folder / name).read_text(), set(changed(folder))
    (folder / name).write_text(before.replace("0.1", "0.11", 1))
    assert set(changed(folder)) - other == {"scenes-my_arm"}
    (folder / name).write_text(before)
    assert set(changed(folder)) == other


@pytest.mark.slow
def test_killed_in_every_stage_it_ends_the_same(smoke):
    """Killed once in each stage and repeated, `dvc repro` writes what the unbroken run wrote, and pages that stand."""
    folder, _ = smoke
    call(folder, "dvc", "repro")
    made = [folder / "artifacts/smoke" / stage for stage in ("scenes", "demonstrations", "voxels", "train")]

    def written() -> dict[str, bytes]:
        paths = [path for stage in made for path in stage.rglob("*") if path.is_file() and "timing" not in path.name]
        return {str(path.relative_to(folder)): path.read_bytes() for path in paths}

    before = written()
    assert {Path(name).name for name in before} >= {
        "scenes.jsonl",
        "tasks.parquet",
        "paths.parquet",
        "voxels.npz",
        "model.pt",
    }
    for name in ("artifacts/smoke", "scratch"):
        shutil.rmtree(folder / name)
    (folder / "dvc.lock").unlink()
    repeated = ["dvc", "repro", "--no-run-cache"]  # otherwise DVC takes the outputs from its cache
    others = {*of("benchmark", OWN), *of("choices", OWN)} - SPHERE
    call(folder, *repeated, *sorted(others))
    for stage in ("scenes", "demonstrations", "voxels", "train", "benchmark", "choices", "report"):
        name = stage if stage == "report" else f"{stage}-sphere"
        asked = [*repeated, name]
        with subprocess.Popen(
            asked, cwd=folder, env=environment(folder), text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process:  # fmt: skip
            running = next(line for line in process.stdout if line.startswith("Running stage"))
            assert stage in running  # those before it are done
            end = time.monotonic() + 2.0  # those without a scratch folder are importing or working by then
            while not list((folder / "scratch" / stage).rglob("*.*")) and time.monotonic() < end:
                time.sleep(0.01)
            os.killpg(process.pid, signal.SIGKILL)
        again = ran(call(folder, *asked))
        # Scenes and voxels take hardly longer than to be killed.
        assert again == [name] or (again == [] and stage in ("scenes", "voxels"))
    assert written() == before
    assert changed(folder) == {}
    assert (folder / "artifacts/smoke/report/sphere.md").is_file()
