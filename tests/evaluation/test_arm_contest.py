"""The arms' contest: peers solve the same problem, and the page says what the trials say."""

import builtins
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.config import compose, load
from pipeline.environments.transport import STATIONS, transport, transport_constraint
from pipeline.errors import ConfigError
from pipeline.evaluation.arm_contest import ORDINARY, TABLE, ArmContest, arm_table, arm_trials, ratio_lines
from pipeline.evaluation.ordinary import OrdinaryUpright, OrdinaryValidity
from pipeline.evaluation.roboplan_peer import load_roboplan
from pipeline.reporting.arms_page import arms_page
from pipeline.robots import Validity
from tests.robots.named import configurations, named
from tests.robots.worlds import differences


def contest(**changes) -> ArmContest:
    """The contest of conf/bench_arms.yaml, without roboplan, which need not be installed."""
    config = compose("bench_arms", ["contest.roboplan=null"])
    return replace(load(config.contest, ArmContest), **changes)


@pytest.mark.parametrize("name", STATIONS)
def test_ordinary_constraint_is_ours(name):
    """By numpy and pinocchio the tilt is as long as ours everywhere; its Jacobian is exact on the manifold."""
    robot = named(name)
    ours = transport_constraint(robot)
    ordinary = OrdinaryUpright(robot, STATIONS[name].level, ours.tolerance, ours.max_iterations)
    for q in configurations(robot, np.random.default_rng(1), 20):
        assert np.linalg.norm(ordinary.value(q)) == pytest.approx(ours.distance(q), abs=1e-7)
        on = ours.project(q).q
        np.testing.assert_allclose(ordinary.jacobian(on), differences(ordinary.value, on), atol=1e-5)


@pytest.mark.parametrize("name", STATIONS)
def test_ordinary_checker_is_ours(name):
    """Plain pinocchio over all pairs gives the verdicts of our checker."""
    robot = named(name)
    problem = transport(robot, transport_constraint(robot), 5, 1)
    ours, ordinary = Validity(robot, problem.obstacles), OrdinaryValidity(robot, problem.obstacles)
    near = problem.start + np.random.default_rng(3).normal(scale=0.3, size=(100, 7))
    Q = np.concatenate([configurations(robot, np.random.default_rng(2), 100), np.clip(near, robot.lower, robot.upper)])
    verdicts = [ours.free(q) for q in Q]
    assert verdicts == [ordinary.free(q) for q in Q]
    assert 20 < sum(verdicts) < 180


@pytest.mark.slow
def test_all_routes_plan_and_are_verified():
    """On two problems of Panda every route but OMPL's ordinary one verifies a path; the page holds them all."""
    small = contest(problems=2, ordinary=1, seed=1001)
    small = replace(small, robots={"panda": small.robots["panda"]})
    trials = arm_trials(small)
    routes = ["ours, projection", "ours, atlas", "ours, tangent bundle", ORDINARY, "OMPL, our constraint and checker"]
    assert trials["route"].unique().tolist() == routes
    assert (trials.groupby("route").size() == [1 if r == ORDINARY else 2 for r in sorted(routes)]).all()
    assert trials[trials["route"] != ORDINARY]["verified"].all()
    assert (trials["violation"].dropna() < 1e-3).all()
    page = arms_page(trials, trials, small, "the command")
    assert all(route in page for route in routes) and "the command" in page


def synthetic() -> pd.DataFrame:
    """Trials of two routes: the peer takes ten times as long, and half of its paths are refused."""
    rows = []
    for problem in range(10):
        for route, scale in (("ours, projection", 1.0), ("peer", 10.0)):
            passed = route != "peer" or problem % 2 == 0
            told = {"claimed": True, "verified": passed, "reason": "" if passed else "collision"}
            counts = {"violation": 5e-4, "checks": 100, "projections": 50}
            names = {"robot": "panda", "route": route, "problem": problem}
            rows.append({**names, "time": scale * (problem + 1) / 1000, "length": scale + problem, **told, **counts})
    return pd.DataFrame(rows)


def test_table_and_sentence_say_what_the_trials_say():
    """Medians, shares and ratios are those of the rows."""
    table = arm_table(synthetic()).set_index("route")
    assert tuple(arm_table(synthetic()).columns) == TABLE
    assert table.loc["peer", "verified [%]"] == 50 and table.loc["ours, projection", "verified [%]"] == 100
    assert table.loc["ours, projection", "time median [ms]"] == pytest.approx(5.5)
    assert table.loc["peer", "length median [rad]"] == pytest.approx(14)
    (line,) = ratio_lines(synthetic(), "ours, projection")
    assert line.startswith("panda: 10x faster than peer at the median, 10x at p95, n = 10")
    assert "passes 50 % of its trials and 100 % of ours" in line
    assert "| panda | peer" not in arms_page(synthetic(), synthetic(), contest(), "c")
    assert "collision" in arms_page(synthetic(), synthetic(), contest(), "c")


def test_missing_roboplan_is_named(monkeypatch):
    """Without roboplan the error says how to get it."""
    real = builtins.__import__

    def without(name, *arguments, **keywords):
        if name.startswith("roboplan"):
            raise ImportError("No module named 'roboplan'")
        return real(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"pip install 'roboplan==0\.7\.0'"):
        load_roboplan()


def test_bad_contests_are_refused():
    """No problem, more ordinary ones than there are, and robots without a station are refused."""
    for changes, message in (
        ({"problems": 0}, "problems is 0"),
        ({"ordinary": 41}, "ordinary is 41"),
        ({"robots": {}}, "without a station"),
        ({"tried_seed": 0}, "tried_seed is 0"),
    ):
        with pytest.raises(ConfigError, match=message):
            contest(**changes)
