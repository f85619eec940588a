"""The arms' contest: routes plan the same tasks, and the pages say what the trials say."""

import builtins
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.config import compose, load
from pipeline.errors import ConfigError
from pipeline.evaluation.arm_contest import (
    OMPL_OURS,
    ORDINARY,
    ROBOPLAN,
    TABLE,
    ArmContest,
    arm_shard,
    arm_table,
    installed,
    ratio_lines,
)
from pipeline.evaluation.families import Setting
from pipeline.evaluation.hardware import hardware
from pipeline.evaluation.roboplan_peer import GEOMETRY, RoboplanParameters, RoboplanPeer, load_roboplan
from pipeline.evaluation.routes import Role
from pipeline.evaluation.soak import Load, Soak, soak_shard, soak_table, wrong
from pipeline.evaluation.upkeep import Maintained, Upkeep, maintain
from pipeline.reporting.arms_page import arms_page, glance
from pipeline.reporting.soak_page import soak_page
from pipeline.robots.bodies import body_of
from pipeline.tasks import build, set_up

UNPROVEN = "ours, projection, without proof"
UPKEPT = Maintained(pd.DataFrame({"part": ["a check"]}), "as it was", pd.DataFrame({"limit": [1]}), 7)


def contest(**changes) -> ArmContest:
    """The contest of conf/bench_arms.yaml, without roboplan, which need not be installed."""
    config = compose("bench_arms", ["contest.roboplan=null"])
    return replace(load(config.contest, ArmContest), **changes)


def small(setting: Setting) -> Setting:
    """A family whose mazes have 24 cells, with time enough for a busy machine."""
    parameters = {"rows": 4, "columns": 6} if setting.kind == "maze" else {}
    return replace(setting, parameters=parameters, time_limit=30.0, peers=1)


@pytest.mark.slow
def test_all_routes_plan_and_are_verified():
    """Ours verify what they claim, OMPL with our constraint solves upright transport, and the page holds all routes."""
    few = contest(tasks=2, seed=1001)
    chosen = ("transport_panda", "door_panda", "maze")
    families = {label: small(few.families[label]) for label in chosen}
    few = replace(few, families=families, tried_families=[])
    parts = few.shards()
    assert [name for name, _ in parts] == [f"{label}-0" for label in chosen]
    trials = pd.concat([arm_shard(few, part) for _, part in parts], ignore_index=True)
    ours = trials[trials["role"] != Role.PEER.value]
    assert set(ours["environment"]) == set(few.families) and ours["solved"].mean() > 0.8
    assert (ours["solved"] == ours["claimed"]).all() and (trials["max_violation"].dropna() < 1.01e-3).all()
    assert trials[(trials["environment"] == "transport_panda") & (trials["method"] == OMPL_OURS)]["claimed"].all()
    assert (trials[trials["method"] == ORDINARY].groupby("environment").size() == 1).all()
    page = arms_page(trials, trials, UPKEPT, few, "the command", hardware())
    assert all(route in page for route in trials["method"].unique()) and "the command" in page
    assert all(f"### {label}" in page for label in few.families) and "as it was" in page


def test_variants_change_one_thing():
    """What was tried plans tasks of its own seed with one thing changed: more checks where walks are checked finer."""
    few = contest(tasks=2, tried_families=["transport_panda"])
    finer = "walks checked at 0.01 rad"
    few = replace(few, tried={finer: few.tried[finer]})
    assert few.shards()[-1] == ("tried-transport_panda-0", ("transport_panda", range(2), True))
    trials = arm_shard(few, few.shards()[-1][1])
    assert trials["tried"].all()
    assert trials["method"].unique().tolist() == ["as chosen", finer]
    checks = trials.groupby("method")["collision_checks"].median()
    assert checks[finer] > 2 * checks["as chosen"]


def test_soak_of_a_few(tmp_path):
    """A shard has a row per task, method and seed, verified raw and shortened; the page counts what the rows say."""
    config = load(compose("soak").soak, Soak)
    families = {label: small(config.families[label]) for label in ("door_panda", "maze")}
    soak = replace(config, families=families, loads={label: Load(2, 2, 20_000) for label in families}, shard=1)
    shards = soak.shards()
    assert [name for name, _ in shards] == ["door_panda-0", "door_panda-1", "maze-0", "maze-1"]
    rows = pd.concat([soak_shard(soak, item) for _, item in shards], ignore_index=True)
    assert len(rows) == 2 * 2 * 2 * 3  # families, tasks, seeds, methods
    again = soak_shard(soak, shards[0][1])
    pd.testing.assert_frame_equal(again, rows[: len(again)])  # the same paths come out again
    assert rows["claimed"].sum() > 12 and not wrong(rows)
    assert (rows["short_length"].dropna() <= rows["path_length"].dropna() + 1e-9).all()
    table = soak_table(rows)
    assert table.iloc[-1][["tasks", "plans", "paths", "wrong paths"]].tolist() == [4, 24, rows["claimed"].sum(), 0]
    spoilt = rows.assign(failure=["collision", *rows["failure"][1:]])
    assert len(wrong(spoilt)) == 1 and soak_table(spoilt).iloc[-1]["wrong paths"] == 1
    page = soak_page(spoilt, soak, "the command")
    assert ": 1 wrong." in page and "## Wrong" in page and ": 0 wrong." in soak_page(rows, soak, "the command")


def test_maze_walks_pass_no_wall():
    """As `TorusMaze` asks for, the margin of mazes is at least half the spacing of every method's checks."""
    setting = contest().families["maze"]
    assert set(setting.adherences) == {"projection", "atlas", "tangent_bundle"}
    spacings = [choice.parameters["resolution"] for choice in setting.adherences.values()]
    assert 2 * setting.margin >= max(spacings) * (1 - 1e-9)
    build(setting.family().task(0, 0).leg).validity(setting.margin)  # and at most half a pixel: a wider one is refused


def test_upkeep_measures_what_it_says():
    """Checks and projections cost microseconds, the memory is a process', and overruns are not negative."""
    few = contest()
    families = {"transport_panda": few.families["transport_panda"]}
    found = maintain(Upkeep(200, 5, 20, [0.001], 2), families, 3)
    assert found.costs["part"].tolist()[0] == "check, free, 5 obstacles" and len(found.costs) == 3
    assert (found.costs["n"].iloc[:2].sum() <= 200) and found.costs["median [us]"].between(0.5, 1000).all()
    assert "MB resident after 2 plans" in found.memory
    assert (found.overruns["overrun largest [ms]"] >= 0).all() and found.overruns["n"].tolist() == [2]


def synthetic() -> pd.DataFrame:
    """Trials of two routes: the peer takes ten times as long, and half of its paths are refused."""
    rows = []
    for problem in range(10):
        for route, scale in (("ours, projection", 1.0), ("peer", 10.0)):
            passed = route != "peer" or problem % 2 == 0
            told = {"claimed": True, "solved": passed, "failure": "" if passed else "collision"}
            told |= {"solved_own": passed or problem != 1, "failure_own": "" if passed or problem != 1 else "jump"}
            counts = {"max_violation": 5e-4, "collision_checks": 100, "projections": 50}
            counts |= {"chords_proven": 20 * passed, "chords_sampled": problem, "path_length": scale + problem}
            names = {"environment": "transport_panda", "method": route, "planner": route, "problem": problem}
            names["role"] = (Role.PEER if route == "peer" else Role.OURS).value
            rows.append({**names, "planning_time": scale * (problem + 1) / 1000, **told, **counts})
    return pd.DataFrame(rows)


def peer(label: str, planner: str) -> pd.DataFrame:
    """The same trials with the peer under another label and of another kind."""
    trials = synthetic()
    trials.loc[trials["method"] == "peer", ["method", "planner"]] = label, planner
    return trials


def test_table_and_sentence_say_what_the_trials_say():
    """Medians, shares and ratios are those of the rows."""
    table = arm_table(synthetic()).set_index("route")
    assert tuple(arm_table(synthetic()).columns) == TABLE
    own, by_ours = (table[f"verified by {geometry} [%]"] for geometry in ("its own geometry", "ours"))
    assert (own["peer"], by_ours["peer"], own["ours, projection"], by_ours["ours, projection"]) == (90, 50, 100, 100)
    assert table.loc["ours, projection", "time median [ms]"] == pytest.approx(5.5)
    assert table.loc["peer", "length median"] == pytest.approx(15)  # of those verified by its own geometry
    assert table.loc["ours, projection", ["chords proven", "chords sampled"]].tolist() == [200, 45]
    assert glance(synthetic()).to_numpy().tolist() == [
        ["Panda, a level hand among 15 to 40 bodies", "5.50 ms (100 %)", "55.0 ms (90 %), peer", "–", 10]
    ]
    fewer = synthetic().query("method != 'peer' or problem < 4")
    assert glance(fewer)["best peer"].tolist() == ["25.0 ms (75 % of 4), peer"]
    (line,) = ratio_lines(synthetic())
    assert line.startswith("transport_panda: 10x faster than peer at the median, 10x at p95, n = 10")
    unproven = synthetic()[::2].assign(method=UNPROVEN, role=Role.UNPROVEN.value)
    (line,) = ratio_lines(pd.concat([peer(ORDINARY, ORDINARY), unproven]))
    assert "10x at p95 (20x: not met); without proof 10x and 10x, n = 10" in line
    (line,) = ratio_lines(peer("roboplan, 1", ROBOPLAN))
    assert "(2x of both: met)" in line
    none = synthetic().assign(claimed=synthetic()["method"] != "peer")
    assert "10x at p95 (at least: it solved none within the limit), n = 10" in ratio_lines(none)[0]
    said = "passes 90 % of its trials by the geometry it planned with and 50 % by ours, and 100 % of ours"
    assert said in line
    machine = hardware()
    machine["packages"] |= {"ompl": "2.0", "roboplan": "0.1.2"}
    page = arms_page(synthetic(), synthetic(), UPKEPT, contest(), "c", machine)
    assert "### door_panda" not in page and "measured: OMPL 2.0, roboplan 0.1.2. Newer ones" in page
    refused = [re.split(r"\s*\|\s*", row)[1:-1] for row in page.splitlines() if row.startswith("| transport_panda |")]
    assert refused == [
        ["transport_panda", "peer", "its own", "jump", "1"],
        ["transport_panda", "peer", "ours", "collision", "5"],
    ]


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
    asked = load(compose("bench_arms").contest, ArmContest)
    assert asked.roboplan and installed(asked) == replace(asked, roboplan=None)


@pytest.mark.parametrize("label", ["transport_panda", "transport_baxter", "tray_baxter"])
def test_roboplans_verdicts_are_those_of_its_own_geometry(label):
    """Where roboplan is installed, its limits are ours, and what is in collision to it is so for meshes, no margin."""
    pytest.importorskip("roboplan.core")
    setting, rng = contest().families[label], np.random.default_rng(0)
    task, meshes = (build(setting.family(geometry).task(1000, 1).leg) for geometry in (None, GEOMETRY))
    peer = RoboplanPeer(setting.description(), task.robot, RoboplanParameters())
    peer.furnish(task)
    own = set_up(replace(task.statement, robot=meshes.statement.robot)).validity()
    robot = task.robot
    np.testing.assert_array_equal(peer.scene.getPositionLimitVectors("planned"), (robot.lower, robot.upper))
    near = task.start + 0.3 * rng.normal(size=(200, robot.dimension))
    Q = np.concatenate([near, rng.uniform(robot.lower, robot.upper, near.shape)])
    # What is held may touch the hand beside it; how deep, roboplan does not ask.
    beside = {(held.body.name, body) for held in task.statement.carried for body in held.beside}

    def clear(q: np.ndarray) -> bool:
        contacts = [tuple(map(body_of, pair)) for pair in own.contacts(q)]
        return own.free(q) or bool(contacts and all({pair, pair[::-1]} & beside for pair in contacts))

    free = [clear(q) for q in Q]
    assert free == [not peer.collides(q) for q in Q] and 20 < sum(free) < 380


def test_bad_contests_are_refused():
    """No task, no family, a measured seed for settings, families and loads that do not fit are refused."""
    setting = contest().families["transport_panda"]
    for changes, message in (
        ({"tasks": 0}, "tasks is 0"),
        ({"families": {}, "tried_families": []}, "no family"),
        ({"tried_seed": 0}, "tried_seed is 0"),
        ({"tried_families": ["door"]}, "'door'; there are transport_panda"),
    ):
        with pytest.raises(ConfigError, match=message):
            contest(**changes)
    for changes, message in (
        ({"kind": "dor"}, "'dor'; choices"),
        ({"adherences": {}}, "no adherence"),
        ({"margin": -1.0}, "margin is -1"),
        ({"time_limit": 0.0}, "time_limit is 0"),
        ({"ompl_delta": 0.0}, "ompl_delta is 0"),
    ):
        with pytest.raises(ConfigError, match=message):
            replace(setting, **changes)
    soak = load(compose("soak").soak, Soak)
    for changes, message in (({"loads": {}}, "the families are"), ({"shard": 0}, "shard is 0")):
        with pytest.raises(ConfigError, match=message):
            replace(soak, **changes)
    for load_, message in ((lambda: Load(0, 1, 1), "tasks is 0"), (lambda: Load(1, 1, 0), "max_iterations is 0")):
        with pytest.raises(ConfigError, match=message):
            load_()
    with pytest.raises(ConfigError, match="at least 20"):
        Upkeep(1, 1, 5, [0.1], 1)
