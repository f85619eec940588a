"""Trials count a plan as solved only after the verifier has passed its path, and treat all methods alike."""

from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest

from pipeline.environments import BANDS, BLOCKS, Band, SphereEnvironment
from pipeline.errors import ConfigError
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.trials import Experiment, Method, benchmark_metrics, run_trials, sample_clouds
from pipeline.learning.choices import Learned
from pipeline.learning.compnetx import CompnetxNetwork, Layers, untrained
from pipeline.learning.task_kinds import task_kinds
from pipeline.planners import PLANNERS, Planner, PlanStatus
from pipeline.schema import Choice
from pipeline.spec.scene import Split, unflatten
from pipeline.tasks import set_up
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import VerifierParameters
from tests.robots.worlds import on_sphere, signed_distance

ENVIRONMENT = SphereEnvironment(blocks=60, grid=3000, bands=(Band(-0.1, 0.1, "x", -1, 0.3),))
SCENES = {scene.name: scene for scene in ENVIRONMENT.scenes({Split.TEST: 1})}
BLOCK_SCENE = SCENES["blocks-test-000"]
PROBLEMS = ENVIRONMENT.tasks(BLOCK_SCENE, 3)
UNIFORM, LEARNED = Choice("uniform"), Choice("compnetx", {"batch": 4, "n_ismp": 20})
FMT, RRT = Choice("fmt", {"samples": 60}), Choice("rrtconnect")
METHODS = {
    "fmt": Method("FMT*", FMT, UNIFORM),
    "learned_fmt": Method("L-FMT*", FMT, LEARNED),
    "rrt": Method("RRTConnect", RRT, UNIFORM),
    "learned_rrt": Method("L-RRTConnect", RRT, LEARNED),
}
ADHERENCES = {"straight": Choice("projection"), "charts": Choice("atlas", {"rho": 0.3})}


def experiment(**changes) -> Experiment:
    found = Experiment(METHODS, ADHERENCES, 20.0, 4, VerifierParameters(clearance=True))
    return replace(found, **changes)


@pytest.fixture(scope="module")
def learned() -> Learned:
    setup = set_up(next(iter(SCENES.values())).statement)
    kinds = task_kinds([(setup.robot, setup.constraint)], centre=False)
    model = untrained(Layers(scene_hidden=8, scene_code=8, hidden=(16, 8), dropout_layers=2), kinds, 11, 0)
    return Learned(CompnetxNetwork(model), dict.fromkeys(SCENES, np.zeros((11, 11, 11), bool)))


@pytest.fixture(scope="module")
def trials(learned) -> pd.DataFrame:
    return run_trials(experiment(), ENVIRONMENT, SCENES, learned, PROBLEMS)


def test_every_method_meets_every_problem_with_every_adherence(trials):
    """There is one row per problem, method and adherence, problem by problem, under the names of the experiment."""
    keys = ["problem", "method", "adherence"]
    expected = [(p, m.label, a) for p in range(3) for m in METHODS.values() for a in ADHERENCES]
    assert list(trials[keys].itertuples(index=False, name=None)) == expected
    assert set(trials["scene"]) == {BLOCK_SCENE.name} and set(trials["scenario"]) == {BLOCKS}
    assert set(trials["environment"]) == {"sphere"}
    kinds = trials.drop_duplicates("method")[["method", "planner", "sampler"]].to_numpy().tolist()
    assert kinds == [[m.label, m.planner.kind, m.sampler.kind] for m in METHODS.values()]


def test_solved_means_that_the_verifier_passes(trials):
    """The stored path of every solved row passes the verifier again, which finds the length and clearance stored."""
    assert trials["solved"].mean() > 0.9 and (trials["solved"] <= trials["claimed"]).all()
    judge = Judge(BLOCK_SCENE.statement)
    for _, row in trials[trials["solved"]].iterrows():
        problem = PROBLEMS.iloc[row["problem"]]
        path = unflatten(row)
        verdict = judge.verify(path, problem["start"], problem["goal"])
        assert verdict.passed, verdict.message
        assert row["path_length"] == verdict.length == np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert row["max_violation"] == np.abs(np.linalg.norm(path, axis=1) - 1).max() < 1e-3
        clear = min(signed_distance(o, path).min() for o in BLOCK_SCENE.obstacles) - ENVIRONMENT.robot_radius
        assert row["min_clearance"] == pytest.approx(clear, abs=1e-6) and clear >= ENVIRONMENT.margin - 1e-6
        assert row["rejection"] == ""


def test_seeds_are_of_the_problem(trials, learned):
    """All methods have a problem's own seed, which depends on the experiment's and not on the other problems."""
    assert (trials.groupby("problem")["seed"].nunique() == 1).all() and trials["seed"].nunique() == 3
    alone = run_trials(experiment(), ENVIRONMENT, SCENES, learned, PROBLEMS.iloc[1:2])
    same = trials[trials["problem"] == 1].reset_index(drop=True)
    repeated = ["seed", "solved", "iterations", "collision_checks", "samples", "path_length", "waypoints"]
    pd.testing.assert_frame_equal(alone[repeated], same[repeated])
    assert all(map(np.array_equal, alone["path"], same["path"]))
    other = run_trials(experiment(methods={"rrt": METHODS["rrt"]}, seed=5), ENVIRONMENT, SCENES, None, PROBLEMS)
    assert not set(other["seed"]) & set(trials["seed"])


def test_fallback_and_network_are_counted(trials):
    """Learned methods call the network at most N_ismp times and count the classical samples; others do neither."""
    is_learned = trials["sampler"] == "compnetx"
    assert (trials[is_learned]["network_calls"].between(1, 20)).all()
    assert (trials[~is_learned][["network_calls", "fallback_samples", "network_time"]] == 0).all(axis=None)
    assert (trials[is_learned]["network_time"] > 0).all()
    assert (trials["network_time"] <= trials["planning_time"]).all()
    assert (trials["fallback_samples"] <= trials["samples"]).all()


@dataclass(frozen=True)
class Pretender(Planner):
    """Claims a path without a search, wrong in the way of its `trick`; keeps what it was asked."""

    trick: str = "none"

    asked: ClassVar[list] = []  # of all of them

    def _search(self, problem, sampler, termination, clock):
        self.asked.append((self.trick, problem, termination, sampler.rng.bytes(8)))
        start, goal = problem.start, problem.goal
        shares = np.linspace(0, 1, 200)[:, None]
        straight = start + shares * (goal - start)
        arc = straight / np.linalg.norm(straight, axis=1)[:, None]
        path = {
            "chord": straight,
            "arc": arc,
            "elsewhere": arc[:-5],
            "leap": np.stack([start, goal]),
            "nan": np.where(np.arange(200)[:, None] == 7, np.nan, arc),
            "empty": None,
        }.get(self.trick)
        return (PlanStatus.FAILED if self.trick == "none" else PlanStatus.SOLVED), path


TRICKS = {
    "chord": "off the manifold",
    "arc": "contact",
    "elsewhere": "goal",
    "leap": "leaves the manifold",
    "nan": "not finite",
    "empty": "",
}


@pytest.fixture
def pretended(monkeypatch) -> pd.DataFrame:
    """Trials of planners that claim wrong paths, beside one that claims none, where a block stands in the way."""
    monkeypatch.setitem(PLANNERS, "pretender", Pretender)
    monkeypatch.setattr(Pretender, "asked", [])
    methods = {t: Method(t, Choice("pretender", {"trick": t}), UNIFORM) for t in (*TRICKS, "none")}
    ends = on_sphere(np.random.default_rng(0), 500)
    checker = set_up(BLOCK_SCENE.statement).validity(ENVIRONMENT.margin)
    free = [q for q in ends if checker.free(q)]
    pair = next((p, q) for p in free for q in free if blocked(p, q))
    problem = PROBLEMS.iloc[:1].assign(start=[pair[0]], goal=[pair[1]])
    return run_trials(experiment(methods=methods), ENVIRONMENT, SCENES, None, problem)


def blocked(p: np.ndarray, q: np.ndarray) -> bool:
    arc = p + np.linspace(0, 1, 50)[:, None] * (q - p)
    arc /= np.linalg.norm(arc, axis=1)[:, None]
    inside = min(signed_distance(o, arc).min() for o in BLOCK_SCENE.obstacles) < -0.01
    return bool(1 < np.linalg.norm(q - p) < 1.4 and inside)


def test_claimed_paths_that_are_wrong_do_not_count(pretended):
    """Claims of paths off the manifold, through a block or to elsewhere are not solved, and it is said why."""
    assert not pretended["solved"].any()
    rows = pretended.set_index(["method", "adherence"])
    for trick, said in TRICKS.items():
        for adherence in ADHERENCES:
            row = rows.loc[trick, adherence]
            assert row["claimed"] and row["status"] == "solved"
            assert said in row["rejection"] and len(row["rejection"].split()) > 2
    metrics = benchmark_metrics(pretended)[BLOCKS]
    assert {method: found["straight"]["success"] for method, found in metrics.items()} == dict.fromkeys(metrics, 0.0)
    assert all(found["charts"]["median_length"] is None for found in metrics.values())


def test_unsolved_rows_have_no_length(pretended):
    """A row without a path has neither a length nor a rejection, and no states."""
    rows = pretended[pretended["method"] == "none"]
    assert set(rows["status"]) == {"failed"} and not rows["claimed"].any()
    assert rows[["path_length", "max_violation", "min_clearance"]].isna().all(axis=None)
    assert set(rows["rejection"]) == {""} and set(rows["waypoints"]) == {0}


def test_rejected_rows_have_no_length(pretended):
    """A path that was rejected leaves no length, which a median over the table would take for a path's."""
    assert pretended["path_length"].isna().all()


def test_all_methods_are_asked_the_same(pretended):
    """Every planner gets the same start, goal, scene, time limit and stream, with each adherence, once to warm up."""
    asked = Pretender.asked
    assert [trick for trick, *_ in asked] == [m for m in (*TRICKS, "none") for _ in ADHERENCES for _ in range(2)]
    assert {chance for *_, chance in asked} == {np.random.default_rng(int(pretended["seed"][0])).bytes(8)}
    assert {termination.time_limit for _, _, termination, _ in asked} == {20.0}
    assert {(p.scene, *p.start, *p.goal) for _, p, *_ in asked} == {
        (BLOCK_SCENE.name, *asked[0][1].start, *asked[0][1].goal)
    }
    spaces = [p.adherence for _, p, *_ in asked]
    assert spaces == [spaces[0], spaces[0], spaces[2], spaces[2]] * 7 and spaces[0] is not spaces[2]
    assert list(pretended["method"]) == [m for m in (*TRICKS, "none") for _ in ADHERENCES]  # all of the one problem
    assert spaces[0].validity.margin == ENVIRONMENT.margin


def test_time_limit_ends_a_trial():
    """A plan that does not fit into the time limit is an unsolved row with that status."""
    slow = {"fmt": Method("FMT*", Choice("fmt", {"samples": 100_000}), UNIFORM)}
    found = run_trials(
        experiment(methods=slow, time_limit=0.05, adherences={"straight": ADHERENCES["straight"]}),
        ENVIRONMENT,
        SCENES,
        None,
        PROBLEMS.iloc[:1],
    )
    assert found["status"].tolist() == ["time limit"] and not found["solved"][0]
    assert 0.05 <= found["planning_time"][0] < 2


def test_metrics_summarise_by_method(trials):
    """Success, median time over all trials and median length over the solved ones are those of the table."""
    table = trials.assign(solved=[i % 3 > 0 for i in range(len(trials))])
    found = benchmark_metrics(table)
    assert set(found) == {BLOCKS} and list(found[BLOCKS]) == [m.label for m in METHODS.values()]
    for method, by_adherence in found[BLOCKS].items():
        for adherence, numbers in by_adherence.items():
            rows = table[(table["method"] == method) & (table["adherence"] == adherence)]
            assert numbers["n"] == 3 and numbers["success"] == rows["solved"].sum() / 3
            assert numbers["median_time_ms"] == pytest.approx(1e3 * np.median(rows["planning_time"]))
            assert numbers["median_length"] == pytest.approx(np.median(rows[rows["solved"]]["path_length"]))


def test_clouds_are_of_the_network_alone(learned):
    """However early plans of the learned method fall back to the classical sampler, its cloud is the same."""
    clouds = []
    for n_ismp in (1, 1000):
        method = replace(METHODS["learned_fmt"], sampler=Choice("compnetx", {"batch": 4, "n_ismp": n_ismp}))
        clouds.append(sample_clouds(experiment(methods={"x": method}), ENVIRONMENT, SCENES, learned, PROBLEMS, 50))
    np.testing.assert_array_equal(*(cloud[f"{BLOCKS}/L-FMT*"] for cloud in clouds))


def test_clouds_are_the_samples_fmt_asks_for(learned):
    """Each scenario has its start, goal and a cloud per FMT* method: of the size asked for, free, repeatable."""
    problems = pd.concat([PROBLEMS, ENVIRONMENT.tasks(SCENES[BANDS], 2)])
    clouds = sample_clouds(experiment(), ENVIRONMENT, SCENES, learned, problems, 50)
    names = [f"{scenario}/{name}" for scenario in (BLOCKS, BANDS) for name in ("start", "goal", "FMT*", "L-FMT*")]
    assert list(clouds) == names
    for scenario, scene, first in ((BLOCKS, BLOCK_SCENE, 0), (BANDS, SCENES[BANDS], 3)):
        checker = set_up(scene.statement).validity(ENVIRONMENT.margin)
        for end in ("start", "goal"):
            np.testing.assert_array_equal(clouds[f"{scenario}/{end}"], problems.iloc[first][end])
        for method in ("FMT*", "L-FMT*"):
            cloud = clouds[f"{scenario}/{method}"]
            assert cloud.shape == (50, 3) and len(np.unique(cloud, axis=0)) == 50
            assert np.abs(np.linalg.norm(cloud, axis=1) - 1).max() < 1e-3
            assert all(checker.free(q) for q in cloud)
    again = sample_clouds(experiment(), ENVIRONMENT, SCENES, learned, problems, 50)
    assert all(np.array_equal(clouds[name], again[name]) for name in names)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"methods": {}}, "at least one method and one adherence"),
        ({"adherences": {}}, "at least one method and one adherence"),
        (
            {"methods": {"x": Method("X", FMT, Choice("compnetx", {"batch": -3}))}},
            r"sampler\.batch is -3; it must be at",
        ),
        (
            {"methods": {"x": Method("X", Choice("fmt", {"samples": 2}), UNIFORM)}},
            r"samples is 2; it must be at least 3",
        ),
        ({"time_limit": 0.0}, r"time_limit is 0\.0 s; it must be above 0 s"),
        ({"time_limit": float("nan")}, "time_limit is nan s"),
        ({"time_limit": float("inf")}, "time_limit is inf s"),
        ({"seed": -1}, "seed is -1; it must be at least 0"),
    ],
)
def test_wrong_experiments_are_refused(changes, said):
    """An experiment without methods, without a finite time limit or with a negative seed is refused by name."""
    with pytest.raises(ConfigError, match=said):
        experiment(**changes)


def test_parts_are_refused_by_their_place():
    """An unknown planner of a method is refused with the method's key, an unknown sampler with the choices."""
    for method, said in (
        (replace(METHODS["rrt"], planner=Choice("prm")), r"methods\.rrt\.planner is 'prm'; choices: fmt, rrt"),
        (replace(METHODS["rrt"], sampler=Choice("halton")), "sampler is 'halton'; choices: compnetx, uniform"),
        (replace(METHODS["rrt"], sampler=LEARNED), "run the train stage"),
    ):
        with pytest.raises(ConfigError, match=said):
            run_trials(experiment(methods={"rrt": method}), ENVIRONMENT, SCENES, None, PROBLEMS)


def test_machine_is_named():
    """A measurement comes with processor, cores, memory, Python and the versions of the packages that decide."""
    found = hardware()
    assert found["cores"] >= 1 and found["cpu"] not in ("", "unknown") and found["memory"].endswith("kB")
    assert found["packages"]["torch"] == version("torch") and found["packages"]["ompl"] == version("ompl")
    assert found["compiler"] and found["networks"]
    assert set(found["packages"]) >= {"pin", "coal", "casadi", "numpy", "scipy"}
