"""Stages refuse bad input in one line and write nothing; what they write depends on the seeds alone."""

import ctypes
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.config import ROOT
from pipeline.files import read_arrays, read_table, write_arrays, write_table
from tests.tasks.test_sources import with_limit

# Starts stages as the command line does, each in a process of its own, but imports torch once for all of them and saves
# the second that Python takes to clean up behind it.
SERVER = """
import json, os, runpy, sys, traceback
import casadi, coal, hydra, joblib, lightning, pandas, pinocchio, pyarrow.parquet, scipy.spatial, torch
for line in sys.stdin:
    script, arguments, folder = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        for descriptor, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
        sys.argv, sys.path[0] = [script, *arguments], os.path.dirname(script)
        status = 1
        try:
            runpy.run_path(script, run_name="__main__")
            status = 0
        except SystemExit as ended:
            status = ended.code
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(status)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
TINY = [
    *("profile.name=tiny", "profile.scenes.train=1", "profile.scenes.validation=1", "profile.scenes.test=1"),
    *(
        "profile.scenes.pairs=10",
        "profile.scenes.test_pairs=1",
        "profile.scenes.others.bands=1",
        "profile.train.epochs=1",
    ),
    *("profile.benchmark.problems_per_scene=1", "profile.benchmark.others.bands=1"),
    *("environment.parameters.blocks=100", "environment.parameters.grid=3000"),
]
STAGE = {  # what else makes a stage quick
    "scenes": ["workers=1"],
    "demonstrations": ["workers=1", "shard=1", "oracle.shortcuts=40"],
    "voxels": ["perception.voxels.size=11"],
    "train": [
        "model.parameters.layers.hidden=[16,8]",
        "model.parameters.layers.dropout_layers=2",
        "training.threads=1",
    ],
    "benchmark": ["experiment.time_limit=1.0", "experiment.methods.fmt.planner.parameters.samples=10"],
    "choices": [],
    "report": ["environments=[sphere]", "output=artifacts/tiny/report"],
}


@dataclass(frozen=True)
class Ended:
    """How a stage ended."""

    status: int
    stdout: str
    stderr: str


Run = Callable[..., Ended]


def command(stage: str, *more: str) -> list[str]:
    """Return script and arguments of a tiny run of a stage; those in `more` take the place of others."""
    replaced = {setting.partition("=")[0] for setting in more}
    settings = [setting for setting in (*TINY, *STAGE[stage]) if setting.partition("=")[0] not in replaced]
    if stage == "report" or "environment" in replaced:
        settings = [setting for setting in settings if not setting.startswith("environment.")]
    return [str(ROOT / "stages" / f"{stage}.py"), *settings, *more]


@pytest.fixture(scope="module")
def run() -> Run:
    """Run a tiny stage in a folder to its end."""
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    )

    def start(stage: str, folder: Path, *more: str) -> Ended:
        script, *arguments = command(stage, *more)
        server.stdin.write(json.dumps([script, arguments, str(folder)]) + "\n")
        server.stdin.flush()
        status = int(server.stdout.readline())
        out, err = ((folder / name).read_text() for name in ("stdout", "stderr"))
        return Ended(status, out, err)

    yield start
    server.stdin.close()
    server.wait()


def started(stage: str, folder: Path, *more: str, before: Callable[[], object] | None = None) -> subprocess.Popen:
    """Start a tiny stage in a folder as a user does; `before` is called in its process."""
    return subprocess.Popen(
        [sys.executable, *command(stage, *more)], cwd=folder, env=ENVIRONMENT, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, start_new_session=True, preexec_fn=before,
    )  # fmt: skip


def ended(process: subprocess.Popen) -> Ended:
    out, err = process.communicate()
    return Ended(process.returncode, out, err)


@pytest.fixture(scope="module")
def chain(run, tmp_path_factory) -> Path:
    """A folder in which the stages up to training have run; the controls of everything that is broken below."""
    folder = tmp_path_factory.mktemp("chain")
    for stage in ("scenes", "demonstrations", "voxels", "train"):
        done = run(stage, folder)
        assert (done.status, done.stderr) == (0, ""), f"{stage}: {done.stderr}"
    return folder


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted((folder / "artifacts").rglob("*")) if p.is_file()
    }


def only_line(done: Ended, status: int = 1) -> str:
    """Return the one line on stderr with which a stage has ended."""
    assert (done.status, done.stderr.count("\n")) == (status, 1) and done.stderr.endswith("\n"), done.stderr
    assert "Traceback" not in done.stdout
    return done.stderr


def damage(folder: Path, how: str) -> None:
    """Damage one file as `how` says: '<what> <file below artifacts/tiny>'."""
    what, _, name = how.partition(" ")
    path = folder / "artifacts" / "tiny" / name
    if what == "remove":
        path.unlink()
    elif what == "truncate":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    elif what == "foreign":
        pd.DataFrame({"x": [1.0]}).to_parquet(path)
    elif what in ("device", "fifo"):
        path.unlink()
        path.symlink_to("/dev/zero") if what == "device" else os.mkfifo(path)
    elif what == "scribble":
        path.write_bytes(b"\x89PNG\r\n" + bytes(200))
    elif what == "unsolved":
        write_table(read_table(path, "paths").assign(solved=False), path, "paths")
    elif what == "resize":
        grids = read_arrays(path, "voxels")
        write_arrays({**grids, "voxels": np.zeros((len(grids["scene"]), 13, 13, 13), bool)}, path, "voxels")
    else:
        assert what == "lengthen"
        problems = read_table(path, "tasks")
        write_table(problems.assign(goal=[[0.0, 0.0, 1.0, 0.0]] * len(problems)), path, "tasks")


SCENES, PROBLEMS = "scenes/sphere/scenes.jsonl", "scenes/sphere/tasks.parquet"
PATHS, VOXELS, MODEL = "demonstrations/sphere/paths.parquet", "voxels/sphere/voxels.npz", "train/sphere/model.pt"
MISSING, UNREADABLE = (
    "does not exist: run the stage that writes it (`make repro`, its PROFILE)",
    "(truncated or foreign)",
)
METHOD = "experiment.methods.compnetx_rrtconnect"


@pytest.mark.parametrize(
    ("stage", "broken", "said"),
    [
        # The command line.
        ("scenes", "+worker=2", ["ConfigError: unknown key 'worker'", "mean 'workers'?", "Valid keys: profile"]),
        ("train", "+model.parameters.layers.drop=2", ["ConfigError: unknown key 'drop' in model.layers"]),
        ("scenes", "environment.kind=cube", ["ConfigError: environment is 'cube'; choices: family, folder, sphere"]),
        ("demonstrations", "oracle.planner.kind=prm", ["ConfigError: oracle.planner is 'prm'; choices: fmt, rrt"]),
        ("demonstrations", "oracle.adherence.kind=at", ["ConfigError: adherence is 'at'; choices: atlas, projection"]),
        ("benchmark", f"{METHOD}.planner.kind=prm", ["ConfigError", ".planner is 'prm'; choices: fmt, rrt"]),
        ("benchmark", f"{METHOD}.sampler.kind=sobol", ["ConfigError: sampler is 'sobol'; choices: compnetx, uniform"]),
        ("scenes", "environment.parameters.blocks=-3", ["ConfigError: environment.blocks is -3; it must be"]),
        ("scenes", f"workers={'9' * 400}", ["ConfigError: workers is a number of 400 digits", "at most 64 bits"]),
        ("scenes", f"environment.parameters.slack={'9' * 400}", ["environment.parameters.slack is a number of 400"]),
        ("scenes", "environment.parameters.slack=1e400", ["ConfigError: environment.slack is inf"]),
        ("scenes", "profile.scenes.test=-1", ["ConfigError: profile.scenes.test is -1; it must be above 0"]),
        ("scenes", "workers=-1", ["ConfigError: workers is -1; it must be at least 0"]),
        ("demonstrations", "shard=0", ["ConfigError: shard is 0; it must be at least 1"]),
        ("train", "profile.train.epochs=0", ["ConfigError: profile.train.epochs is 0; it must be above 0"]),
        ("scenes", "environment.margin=nan", ["ConfigError: environment.margin is nan"]),
        ("train", "model.parameters.spacing=nan", ["ConfigError: model.spacing is nan"]),
        ("voxels", "perception.seed=-1", ["ConfigError: perception.seed is -1"]),
        ("benchmark", "cloud=-5", ["ConfigError: cloud is -5; it must be at least 1"]),
        ("scenes", "environment.margin=3", ["ProblemError: scene 'blocks-train-000' has no free space"]),
        ("scenes", "workers=${nowhere}", ["ConfigError", "be resolved", "'nowhere' not found full_key: workers"]),
        ("choices", "variants=[]", ["ConfigError: variants is empty"]),
        ("report", "output=", ["ConfigError: output is the current folder"]),
        ("report", "environments=[]", ["ConfigError: environments is empty"]),
        # What earlier stages left.
        ("demonstrations", f"remove {SCENES}", ["ArtifactError", SCENES, MISSING]),
        ("demonstrations", f"remove {PROBLEMS}", ["ArtifactError", PROBLEMS, MISSING]),
        ("demonstrations", f"truncate {PROBLEMS}", ["ArtifactError", PROBLEMS, "not a readable parquet", UNREADABLE]),
        ("demonstrations", f"foreign {PROBLEMS}", ["ArtifactError", PROBLEMS, "schema 'none', expected 'tasks'"]),
        ("demonstrations", f"device {PROBLEMS}", ["ArtifactError", PROBLEMS, MISSING]),
        ("demonstrations", f"fifo {SCENES}", ["ArtifactError", SCENES, MISSING]),
        ("demonstrations", f"lengthen {PROBLEMS}", ["ArtifactError", PROBLEMS, "goal of row 0", "expected 3 finite"]),
        ("voxels", f"truncate {SCENES}", ["ArtifactError", SCENES, UNREADABLE]),
        ("voxels", f"foreign {SCENES}", ["ArtifactError", SCENES, "holds no scenes of this version"]),
        ("train", f"remove {VOXELS}", ["ArtifactError", VOXELS, MISSING]),
        ("train", f"truncate {VOXELS}", ["ArtifactError", VOXELS, "not a readable npz", UNREADABLE]),
        ("train", f"truncate {PATHS}", ["ArtifactError", PATHS, UNREADABLE]),
        ("train", f"unsolved {PATHS}", ["ArtifactError: no validation scene has a solved demonstration"]),
        ("benchmark", f"remove {MODEL}", ["ArtifactError", MODEL, "does not exist"]),
        ("train", f"device {VOXELS}", ["ArtifactError", VOXELS, MISSING]),
        ("benchmark", f"fifo {MODEL}", ["ArtifactError", MODEL, MISSING]),
        ("benchmark", f"truncate {MODEL}", ["ArtifactError", MODEL, "truncated or foreign"]),
        ("benchmark", f"scribble {MODEL}", ["ArtifactError", MODEL, "truncated or foreign"]),
        ("benchmark", f"resize {VOXELS}", ["ArtifactError: voxels of a scene are (13, 13, 13)", "(11, 11, 11)"]),
        ("choices", f"remove {MODEL}", ["ArtifactError", MODEL, "does not exist"]),
        ("report", "", ["ArtifactError", "benchmark/sphere/methods.json", MISSING]),
    ],
)  # fmt: skip
def test_bad_input_ends_in_one_line(run, chain, tmp_path, stage, broken, said):
    """Bad input ends a stage with status 1 and one line that names it, no trace, and every artifact as it was."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    on_disk = " " in broken
    if on_disk:
        damage(tmp_path, broken)
    before = files(tmp_path)
    line = only_line(run(stage, tmp_path, *([] if on_disk or not broken else [broken])))
    assert [words for words in said if words not in line] == []
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("override", "said"),
    [
        (
            "profile=huge",
            ["Could not find 'profile/huge'", "Available options in 'profile'", "paper", "quick", "standard"],
        ),
        ("environment=cube", ["Could not find 'environment/cube'", "sphere"]),
        ("worker=2", ["Could not override 'worker'", "Key 'worker' is not in struct"]),
    ],
)
def test_unknown_choices_end_in_hydras_words(run, tmp_path, override, said):
    """What Hydra itself does not know ends a stage with its message, which names the alternatives, and no trace."""
    done = run("scenes", tmp_path, override)
    assert done.status == 1
    assert [words for words in said if words not in done.stderr] == []
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "artifacts").exists()


def test_started_as_a_user_does(tmp_path):
    """The command that the documentation gives ends in one line and status 1 too."""
    done = ended(started("scenes", tmp_path, "environment.margin=3"))
    assert done.status == 1
    assert done.stderr.startswith("ProblemError: scene 'blocks-") and done.stderr.count("\n") == 1, done.stderr
    assert not list(tmp_path.glob("artifacts/**/*.parquet"))


def test_stages_write_where_they_are_started(chain):
    """A stage writes its artifacts and scratch below the current folder, and nothing of Hydra's beside them."""
    assert sorted(path.name for path in chain.iterdir()) == ["artifacts", "scratch", "stderr", "stdout"]
    assert sorted(files(chain)) == [
        *(f"artifacts/tiny/demonstrations/sphere/{n}" for n in ("metrics.json", "paths.parquet", "timing.parquet")),
        *(f"artifacts/tiny/scenes/sphere/{n}" for n in ("scenes.jsonl", "tasks.parquet")),
        *(f"artifacts/tiny/train/sphere/{n}" for n in ("curves.csv", "metrics.json", "model.pt")),
        "artifacts/tiny/voxels/sphere/voxels.npz",
    ]


def repeatable(folder: Path, stage: str) -> dict[str, bytes]:
    """Return what a stage wrote but for the wall clock."""
    prefix = f"artifacts/tiny/{stage}/"
    return {
        name: content for name, content in files(folder).items() if name.startswith(prefix) and "timing" not in name
    }


@pytest.mark.parametrize("stage", ["scenes", "demonstrations", "voxels", "train"])
def test_same_seed_gives_same_bytes(run, chain, tmp_path, stage):
    """Run again, elsewhere, with two processes instead of one where it has any, a stage writes the same bytes."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    shutil.rmtree(tmp_path / "artifacts" / "tiny" / stage)
    parallel = stage in ("scenes", "demonstrations")
    done = ended(started(stage, tmp_path, "workers=2")) if parallel else run(stage, tmp_path)
    assert (done.status, done.stderr) == (0, "")
    assert repeatable(tmp_path, stage) == repeatable(chain, stage) != {}


@pytest.mark.parametrize(
    ("stage", "override"),
    [
        ("scenes", "environment.parameters.seed=1"),
        ("demonstrations", "oracle.seed=2"),
        ("voxels", "perception.seed=3"),
        ("train", "training.seed=4"),
    ],
)
def test_other_seed_gives_other_bytes(run, chain, tmp_path, stage, override):
    """Every file of a stage that chance has a part in differs with another seed."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    assert run(stage, tmp_path, override).status == 0
    before, after = repeatable(chain, stage), repeatable(tmp_path, stage)
    assert before.keys() == after.keys()
    assert [name for name in before if before[name] == after[name]] == []


ONE_METHOD = [
    *("~experiment.methods.fmt", "~experiment.methods.compnetx_fmt", "~experiment.methods.compnetx_rrtconnect"),
    *("~experiment.methods.fmt_tuned", "~experiment.methods.algorithm6_fmt"),
    *("~experiment.adherences.atlas", "~experiment.adherences.tangent_bundle"),
    *("profile.scenes.test_pairs=4", "profile.benchmark.problems_per_scene=4"),
]
ONE_VARIANT = ["variants=[{base: rrtconnect}]", "profile.choices.problems_per_scene=4"]


@pytest.mark.parametrize(
    ("stage", "file", "schema", "settings"),
    [
        ("demonstrations", "paths.parquet", "paths", []),
        ("benchmark", "trials.parquet", "trials", ONE_METHOD),
        ("choices", "trials.parquet", "trials", ONE_VARIANT),
    ],
)
def test_size_of_shards_changes_nothing(run, chain, tmp_path, stage, file, schema, settings):
    """Cut into other pieces, with those of the last run still there, a stage works on each problem once."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    if stage == "benchmark":
        assert run("scenes", tmp_path, "profile.scenes.test_pairs=4").status == 0
    tables = []
    for size in (3, 2):
        done = run(stage, tmp_path, *settings, f"shard={size}")
        assert (done.status, done.stderr) == (0, "")
        table = read_table(tmp_path / "artifacts" / "tiny" / stage / "sphere" / file, schema)
        tables.append(table[["scene", "problem", "status"]])
    assert not tables[1].duplicated(["scene", "problem"]).any()
    pd.testing.assert_frame_equal(*tables)


def test_killed_demonstrations_continue(chain, tmp_path):
    """Killed in the middle and started again, demonstrations are those of an unbroken run, finished shards reused."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    shutil.rmtree(tmp_path / "artifacts" / "tiny" / "demonstrations")
    process = started("demonstrations", tmp_path)
    end = time.monotonic() + 60
    while len(shards(tmp_path)) < 3 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    assert ended(process).status == -signal.SIGKILL
    finished = shards(tmp_path)
    assert 3 <= len(finished) < 20
    assert not (tmp_path / "artifacts" / "tiny" / "demonstrations").exists()
    again = ended(started("demonstrations", tmp_path))
    assert (again.status, again.stderr) == (0, "")
    assert f"{len(finished)} of 20 shards are there from an earlier run" in again.stdout
    assert len(shards(tmp_path)) == 20 and finished.items() <= shards(tmp_path).items()
    assert repeatable(tmp_path, "demonstrations") == repeatable(chain, "demonstrations")


def shards(folder: Path) -> dict[str, int]:
    """Return the finished shards of demonstrations and when each was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("scratch/demonstrations/*/*.parquet")}


def test_a_sweep_ends_in_a_table(chain, tmp_path):
    """A multirun over two values of one parameter, from the command line, ends in a table with a row for each."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    settings = [s for s in (*TINY, *STAGE["train"]) if not s.startswith("profile.benchmark")]
    swept = "method.planner.parameters.samples=20,30"
    script = str(ROOT / "stages" / "tune.py")
    done = subprocess.run(
        [sys.executable, script, "-m", *settings, "problems_per_scene=2", swept],
        cwd=tmp_path, env=ENVIRONMENT, text=True, capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (table,) = (tmp_path / "multirun").rglob("table.csv")
    found = pd.read_csv(table)
    assert sorted(found["method.planner.parameters.samples"]) == [20, 30] and list(found["n"]) == [2, 2]


def obey_permissions() -> None:
    """Make the superuser obey them too, from the next program on."""
    bounding_set_drop, dac_override = 24, 1  # linux/prctl.h, linux/capability.h
    ctypes.CDLL(None).prctl(bounding_set_drop, dac_override, 0, 0, 0)


def test_artifacts_that_cannot_be_written(tmp_path):
    """Where the folder of artifacts is read-only a stage says so before it works on anything."""
    (tmp_path / "artifacts").mkdir(mode=0o555)
    line = only_line(ended(started("scenes", tmp_path, before=obey_permissions)))
    assert line == "ArtifactError: artifacts/tiny/scenes/sphere cannot be written: Permission denied\n"
    assert [path.name for path in tmp_path.iterdir()] == ["artifacts"]


@pytest.mark.parametrize(("stage", "bytes_per_file"), [("scenes", 4_000), ("demonstrations", 2_000), ("train", 50_000)])
def test_no_space(chain, tmp_path, stage, bytes_per_file):
    """Where the system takes no more bytes a stage says for which file, and what it wrote before stays as it was."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    before = files(tmp_path)
    limit = (resource.RLIMIT_FSIZE, (bytes_per_file, bytes_per_file))
    line = only_line(ended(started(stage, tmp_path, before=lambda: resource.setrlimit(*limit))))
    assert line.startswith("ArtifactError: ") and line.endswith(" cannot be written: File too large\n"), line
    assert files(tmp_path) == before
    left = [path.name for path in tmp_path.rglob("*") if path.name.endswith((".partial", ".lock"))]
    assert left == []


@pytest.mark.parametrize("workers", [1, 2])
def test_interrupted_by_ctrl_c(chain, tmp_path, workers):
    """Ctrl-C, which the terminal sends to all processes, ends a stage with status 130 and one line; it then goes on."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    before = files(tmp_path)
    slow = ["oracle.shortcuts=400", f"workers={workers}"]
    process = started("demonstrations", tmp_path, *slow)
    end = time.monotonic() + 120
    while len(shards(tmp_path)) < 2 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGINT)
    assert only_line(ended(process), 130) == "interrupted; nothing is half-written\n"
    assert files(tmp_path) == before
    assert [path.name for path in tmp_path.rglob("*") if path.name.endswith((".partial", ".lock"))] == []
    finished = len(shards(tmp_path))
    again = ended(started("demonstrations", tmp_path, *slow[:1]))
    assert (again.status, again.stderr) == (0, "")
    assert f"{finished} of 20 shards are there from an earlier run" in again.stdout


def test_a_full_place_for_output(tmp_path):
    """Where what a script prints finds no place, that is one line too, and what it wrote is there."""
    asked = [f"problem={ROOT / 'examples' / 'line_sawyer.yaml'}", "output=out", "picture=false"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, str(ROOT / "stages" / "plan.py"), *asked], cwd=tmp_path, env=ENVIRONMENT, text=True,
            stdout=full, stderr=subprocess.PIPE,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, "OSError: [Errno 28] No space left on device\n")
    assert (tmp_path / "out" / "path.csv").is_file()


NOT_FOUND = [
    *("oracle.max_iterations=1", "oracle.planner.parameters.range=0.001", "oracle.adherence.parameters.max_steps=1"),
]
REFUSED = ["environment.margin=0.3"]  # starts and goals are too near to obstacles


@pytest.mark.parametrize(("settings", "status"), [(NOT_FOUND, "limit"), (REFUSED, "refused")])
def test_metrics_without_a_solution_are_json(run, chain, tmp_path, settings, status):
    """Where no path is found, or every problem is refused, there is no median, and the metrics are JSON."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    done = run("demonstrations", tmp_path, *settings)
    assert done.status == 0, done.stderr
    folder = tmp_path / "artifacts/tiny/demonstrations/sphere"
    metrics = json.loads((folder / "metrics.json").read_text(), parse_constant=lambda word: pytest.fail(word))
    assert (metrics["median_length"], metrics["solved"], metrics["failed"]) == (None, 0, 20)
    assert all(status in found for found in read_table(folder / "paths.parquet", "paths")["status"])


def test_times_say_where_they_are_from(chain):
    """Every time of a demonstration stands beside the commit, the machine, the packages and the hour it belongs to."""
    folder = chain / "artifacts/tiny/demonstrations/sphere"
    timing = read_table(folder / "timing.parquet", "timing")
    assert (timing["planning_time"] > 0).all()
    for column in ("commit", "machine", "packages", "measured"):
        assert (timing[column].str.len() > 5).all()
        assert column not in read_table(folder / "paths.parquet", "paths")


def test_measurements_are_made_anew(run, chain, tmp_path):
    """A benchmark says when it was measured, leaves no shard behind, and repeated it measures again."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    assert run("scenes", tmp_path, "profile.scenes.test_pairs=4").status == 0
    times = []
    for _ in range(2):
        done = run("benchmark", tmp_path, *ONE_METHOD)
        assert (done.status, done.stderr) == (0, "")
        folder = tmp_path / "artifacts/tiny/benchmark/sphere"
        assert re.fullmatch(
            r"\S+ \S+ UTC to \S+ \S+ UTC", json.loads((folder / "hardware.json").read_text())["measured"]
        )
        assert list((tmp_path / "scratch" / "benchmark").iterdir()) == []
        times.append(read_table(folder / "trials.parquet", "trials")["planning_time"].tolist())
    assert times[0] != times[1]


def test_an_edited_robot_drops_shards(run, tmp_path):
    """After an edit of a URDF no shard of before is taken; demonstrations of scenes of before are refused."""
    settings = ["environment=transport_panda", "environment.parameters.robot.parameters.urdf=panda.urdf"]
    settings += ["profile.scenes.pairs=1"]
    first = {}
    for lower in (-3.0, -2.4):
        with_limit(tmp_path / "panda.urdf", lower)
        if first:
            line = only_line(run("demonstrations", tmp_path, *settings))
            assert "scene 'transport-train-000' was made from panda.urdf with another content" in line
        for stage in ("scenes", "demonstrations"):
            assert run(stage, tmp_path, *settings).status == 0
            kept = {path.name for path in (tmp_path / "scratch" / stage).iterdir()}
            assert len(kept) == 1 + len(first.get(stage, ())) and kept > first.get(stage, set())
            first[stage] = kept
    paths = read_table(tmp_path / "artifacts/tiny/demonstrations/transport_panda/paths.parquet", "paths")
    solved = paths[paths["solved"]]
    assert len(solved) and all(np.reshape(row.path, (-1, 7))[:, 3].min() >= -2.4 for row in solved.itertuples())


@pytest.fixture
def copy(tmp_path) -> Path:
    """The sources in a folder of their own, to be edited."""
    for name in ("pipeline", "stages", "conf"):
        shutil.copytree(ROOT / name, tmp_path / "sources" / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "sources"


def edited(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))


def test_an_edit_drops_shards_only_where_it_can_matter(copy, chain, tmp_path):
    """Shards outlive edits of comments and docstrings, in modules and in the stage's own file; others drop them."""
    shutil.copytree(chain / "artifacts", tmp_path / "artifacts")
    place = {**ENVIRONMENT, "PYTHONPATH": str(copy)}

    def demonstrate() -> str:
        script, *settings = command("demonstrations", "shard=10")
        done = subprocess.run(
            [sys.executable, str(copy / "stages" / Path(script).name), *settings], cwd=tmp_path, env=place, text=True,
            capture_output=True, check=True,
        )  # fmt: skip
        return done.stdout

    stage, planner = copy / "stages" / "demonstrations.py", copy / "pipeline" / "planners" / "rrtconnect.py"
    assert "shards are there" not in demonstrate()
    edited(stage, "@hydra.main", "# What follows is what Hydra calls.\n@hydra.main")
    edited(planner, '"""', '"""In other words: ')
    assert "2 of 2 shards are there from an earlier run" in demonstrate()
    edited(stage, "Split.TEST.value", "str(Split.TEST.value)")
    assert "shards are there" not in demonstrate()
