"""A benchmark's recordings are its first solved trials per scenario, method and adherence, as they were stored."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from pipeline.environments import Band, SphereEnvironment
from pipeline.evaluation.trials import Experiment, Method, run_trials
from pipeline.files import read_json
from pipeline.provenance import commit, planning_versions
from pipeline.recording import foxglove_layout, read_recording
from pipeline.recording.trials import record_trials
from pipeline.schema import Choice
from pipeline.spec.scene import Split, flatten
from pipeline.verification.verdict import VerifierParameters
from tests.robots.worlds import on_sphere

ENVIRONMENT = SphereEnvironment(blocks=5, bands=(Band(-0.1, 0.1, "x", -1),))
SCENES = {scene.name: scene for scene in ENVIRONMENT.scenes({Split.TEST: 2})}
SETTINGS = {"experiment": {"seed": 4, "labels": ["FMT*"]}, "cloud": None}
COUNTERS = {
    "iterations": 12, "traversals": 7, "projections": 40, "collision_checks": 90, "samples": 64, "fallback_samples": 3,
    "nearest_queries": 5, "network_calls": 2, "charts": 1, "repairs": 0,
}  # fmt: skip


def path(seed: int) -> np.ndarray:
    """A great circle between two random points, of a number of states that depends on the seed (T, 3)."""
    start, goal = on_sphere(np.random.default_rng(seed), 2)
    states = start + np.linspace(0, 1, 20 + seed)[:, None] * (goal - start)
    return states / np.linalg.norm(states, axis=1)[:, None]


@pytest.fixture
def trials() -> pd.DataFrame:
    """Three trials per scene, method and adherence, of which the first is not solved."""
    rows = []
    names = product(SCENES.values(), range(3), ("FMT*", "CoMPNetX-RRTConnect"), ("projection", "atlas"))
    for seed, (scene, problem, method, adherence) in enumerate(names):
        solved = problem > 0
        states = path(seed) if solved else np.empty((0, 3))
        rows.append(
            {
                "scenario": scene.scenario, "scene": scene.name, "problem": problem, "leg": 0, "method": method,
                "planner": "fmt", "sampler": "uniform", "adherence": adherence, "seed": 100 + seed, "solved": solved,
                "planning_time": seed / 7, "path_length": seed / 3 if solved else np.nan, "max_violation": 1e-4,
                **COUNTERS, **flatten(states),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


@pytest.fixture
def problems(trials) -> pd.DataFrame:
    keys = trials.drop_duplicates(["scene", "problem"])[["scene", "problem", "leg"]]
    ends = on_sphere(np.random.default_rng(9), 2 * len(keys))
    return keys.assign(start=list(ends[::2]), goal=list(ends[1::2])).sample(frac=1, random_state=0)


def record(trials, problems, count, folder):
    return record_trials(trials, problems, SCENES, SETTINGS, count, folder)


@pytest.mark.parametrize("count", [1, 3])
def test_first_solved_trials_are_recorded(trials, problems, tmp_path, count):
    """Of every scenario, method and adherence the first solved trials are recorded, each once, and nothing else."""
    written = record(trials, problems, count, tmp_path)
    expected = []
    for scenario, method, adherence in product(
        ("blocks", "bands"), ("FMTstar", "CoMPNetX-RRTConnect"), ("projection", "atlas")
    ):
        scenes = [name for name, scene in SCENES.items() if scene.scenario == scenario]
        solved = [(scene, problem) for scene in scenes for problem in (1, 2)]
        expected += [f"{scenario}_{method}_{adherence}_{s}_{p:04d}.mcap" for s, p in solved[:count]]
    assert sorted(path.name for path in written) == sorted(expected)
    assert {path.name for path in tmp_path.iterdir()} == {*expected, "layout.json"}


def test_recordings_hold_the_stored_path(trials, problems, tmp_path):
    """States read back equal the stored ones to the last bit, walked at uniform speed, with the trial's numbers."""
    ends = problems.set_index(["scene", "problem"])
    for file in record(trials, problems, 2, tmp_path):
        stored = read_recording(file)
        about = stored.metadata
        chosen = (trials["scene"] == about["scene"]) & (trials["problem"] == int(about["problem"]))
        chosen &= (trials["method"] == about["method"]) & (trials["adherence"] == about["adherence"])
        (row,) = trials[chosen].itertuples()
        np.testing.assert_array_equal(stored.states, np.reshape(row.path, (-1, 3)))
        assert about["commit"] == commit() and stored.versions == planning_versions()
        assert {key: about[key] for key in ("scenario", "planner", "sampler", "seed")} == {
            "scenario": row.scenario, "planner": "fmt", "sampler": "uniform", "seed": str(row.seed),
        }  # fmt: skip
        assert {name: stored.counters[name] for name in COUNTERS} == COUNTERS
        assert stored.counters["path_length"] == row.path_length
        steps = np.linalg.norm(np.diff(stored.states, axis=0), axis=1)
        np.testing.assert_allclose(np.diff(stored.times), steps / 0.5, atol=2e-9)
        assert stored.obstacle_count == len(SCENES[row.scene].obstacles)
        assert (stored.robot, stored.tool, stored.joint_names) == ("point", "point", ("x", "y", "z"))
        problem = ends.loc[(row.scene, row.problem)]
        assert stored.attachments["config"] == SETTINGS
        assert stored.attachments["problem"] == {
            "scene": row.scene, "problem": row.problem, "start": [*problem["start"]], "goal": [*problem["goal"]],
        }  # fmt: skip


def test_layout_fits_the_robot(trials, problems, tmp_path):
    """Beside the recordings lies the layout that opens them, with a plot of each of the robot's joints."""
    record(trials, problems, 1, tmp_path)
    assert read_json(tmp_path / "layout.json") == foxglove_layout(3)


def test_same_trials_give_same_bytes(trials, problems, tmp_path):
    """Recording the same trials again, measured anew, gives the same files to the last byte."""
    slower = trials.assign(planning_time=trials["planning_time"] + 1.5, network_time=0.7)
    once, again = (record(t, problems, 1, tmp_path / name) for t, name in ((trials, "once"), (slower, "again")))
    assert [file.read_bytes() for file in once] == [file.read_bytes() for file in again]


def test_nothing_solved_leaves_a_layout_only(trials, problems, tmp_path):
    """Without a solved trial there is no recording, and that is no error."""
    assert record(trials.assign(solved=False), problems, 3, tmp_path) == []
    assert [path.name for path in tmp_path.iterdir()] == ["layout.json"]


def test_trials_run_again_give_same_bytes(tmp_path):
    """Planned and verified twice, which no clock measures alike, the same problems have the same recordings."""
    methods = {
        kind: Method(kind, Choice(kind, parameters), Choice("uniform"))
        for kind, parameters in (("fmt", {"samples": 100}), ("rrtconnect", {}))
    }
    asked = Experiment(methods, {"projection": Choice("projection")}, 20.0, 4, VerifierParameters())
    scene = next(iter(SCENES.values()))
    problems = ENVIRONMENT.tasks(scene, 1)
    found = []
    for name in ("once", "again"):
        rows = run_trials(asked, ENVIRONMENT, SCENES, None, problems)
        found.append([file.read_bytes() for file in record(rows, problems, 1, tmp_path / name)])
    assert len(found[0]) == 2 and found[0] == found[1]
