"""Planning for joints that turn: the short way round, whatever turns start and goal are given at."""

from itertools import pairwise, product
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint, plane, turns_on
from pipeline.manifolds import Adherence
from pipeline.planners import (
    DynamicDomainRrtConnect,
    FmtStar,
    PlanResult,
    Query,
    RrtConnect,
    Termination,
    path_length,
    shortcut,
)
from pipeline.planners.ompl_adapter import OmplPlanner
from pipeline.robots import Obstacle, Shape, UrdfRobot, Validity
from pipeline.robots.turning import TURN
from pipeline.samplers import UniformSampler
from pipeline.spec.statement import Equation, OnPlane, Statement
from pipeline.verification.judge import Judge
from tests.manifolds.spaces import METHODS, make
from tests.planners.scenes import PLANNERS
from tests.robots.crane import CRANE
from tests.robots.named import named, settings

POST = Obstacle(Shape.BOX, (-0.75, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0), (0.1, 0.1, 0.4), name="post")
SEARCHES = {**PLANNERS, "fmt": FmtStar(samples=150), "dynamic domain": DynamicDomainRrtConnect()}
KINDS = list(product(SEARCHES, METHODS))


ON_BASE = OnPlane("tip", (0.0, 0.0, 1.0), 0.0)


def described(folder: Path, **settings) -> UrdfRobot:
    """What the crane is made of."""
    file = folder / "crane.urdf"
    file.write_text(CRANE)
    return UrdfRobot(str(file), ("first", "second", "lift"), "tip", "crane", **settings)


def crane(folder: Path, method: str, obstacles: tuple[Obstacle, ...] = (), **settings) -> Adherence:
    """The crane on the plane of its base, by an adherence method."""
    robot = described(folder, **settings).robot()
    return make(method, plane(robot, "tip", (0, 0, 0)), Validity(robot, obstacles, 0.005))


def planned(space: Adherence, kind: str, start: np.ndarray, goal: np.ndarray, seed: int = 0) -> PlanResult:
    """Plan from start to goal, both configurations (3,)."""
    return SEARCHES[kind].plan(Query(space, start, goal), UniformSampler(), Termination(max_iterations=5000), seed)


def assert_sound(
    space: Adherence, robot: UrdfRobot, path: np.ndarray, start: np.ndarray, goal: np.ndarray, says: Equation = ON_BASE
) -> None:
    """Verified from start to goal, continuous, and at the goal but for whole turns."""
    assert np.abs(np.diff(path, axis=0)).max() < 0.2
    away = (path[-1] - goal) / TURN
    np.testing.assert_allclose(away, np.rint(away), atol=1e-9)
    judge = Judge(Statement(robot, (says,), space.constraint.tolerance, tuple(space.validity.obstacles)))
    verdict = judge.verify(path, start, goal)
    assert verdict.passed, verdict.message


@pytest.mark.parametrize("kind, method", KINDS)
def test_across_half_a_turn(kind, method, tmp_path):
    """From 3.1 to -3.1 is 0.083 rad, however many turns later either is given."""
    space = crane(tmp_path, method)
    for one, other in ((0, 0), (0, 1), (-1, 0), (2, -3)):
        start, goal = np.array([3.1 + one * TURN, 0.0, 0.0]), np.array([-3.1 + other * TURN, 0.0, 0.0])
        path = planned(space, kind, start, goal).path
        assert_sound(space, described(tmp_path), path, start, goal)
        assert kind != "fmt" or path_length(path) == pytest.approx(TURN - 6.2, abs=1e-9)
        assert path_length(shortcut(space, path, np.random.default_rng(0), 200)) < 2 * (TURN - 6.2)


@pytest.mark.parametrize("kind, method", KINDS)
def test_the_same_plan_a_turn_later(kind, method, tmp_path):
    """Among obstacles the path to a goal is the same to rounding, at whatever turns start and goal are given."""
    space = crane(tmp_path, method, (POST,))
    start, goal = np.array([2.6, 0.3, 0.0]), np.array([-2.5, -0.8, 0.0])
    first = planned(space, kind, start, goal).path
    assert_sound(space, described(tmp_path), first, start, goal)
    for one, other in ((1, 0), (0, -2), (-1, 1)):
        moved, there = start + TURN * one * np.array([1, 0, 0]), goal + TURN * other * np.array([1, -1, 0])
        path = planned(space, kind, moved, there).path
        assert_sound(space, described(tmp_path), path, moved, there)
        assert path_length(path) == pytest.approx(path_length(first), abs=1e-6)


@pytest.mark.parametrize("kind, method", KINDS)
def test_all_sides_of_the_circle(kind, method, tmp_path):
    """Between any two free configurations a path is found past the post, sound, and shortcuts keep it so."""
    space, rng = crane(tmp_path, method, (POST,)), np.random.default_rng(3)
    ends = [q for q in rng.uniform((-9, -9, 0), (9, 9, 0), (40, 3)) if space.validity.free(q) and space.provable(q)]
    for seed, (start, goal) in enumerate(pairwise(ends[:6])):
        result = planned(space, kind, start, goal, seed)
        assert result.solved
        assert_sound(space, described(tmp_path), result.path, start, goal)
        shorter = shortcut(space, result.path, rng, 60)
        assert_sound(space, described(tmp_path), shorter, start, goal)
        assert path_length(shorter) <= path_length(result.path) + 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_walks_go_the_short_way_round(method, tmp_path):
    """A walk is continuous from where it begins and as long as the arc, to a goal at any turns."""
    space, rng = crane(tmp_path, method), np.random.default_rng(0)
    for a, b in rng.uniform((-12, -12, 0), (12, 12, 0), (40, 2, 3)):
        walk = space.traverse(a, b)
        way = np.concatenate([a[None], walk.states])
        assert walk.reached and np.abs(np.diff(way, axis=0)).max() < 0.11
        assert path_length(way) == pytest.approx(space.turns.distances(a, b), abs=1e-6)
        assert (np.abs(way[-1] - a) <= np.pi + 1e-9).all()


def test_charts_are_those_of_the_circle(tmp_path):
    """Walks round and round need no more charts than one round, and samples stand within one turn."""
    space = crane(tmp_path, "atlas")
    q = np.zeros(3)
    for i in range(60):
        q = space.traverse(q, q + np.array([2.0, 1.0, 0.0])).states[-1]
        if i == 29:
            charts = len(space.atlas)
    assert q[0] == pytest.approx(120.0) and len(space.atlas) == charts
    found = space.sample(np.random.default_rng(0), 200)
    assert len(found) == 200 and np.abs(found[:, :2]).max() <= np.pi


def test_screened_edges_cross_too(tmp_path):
    """The screen sees an edge across half a turn, as long as its arc, and what stands in its way."""
    a, b = np.array([[3.0, 0.0, 0.0]]), np.array([[-3.0, 0.0, 0.0]])
    free, lengths = crane(tmp_path, "projection").screen(a, b)
    assert free[0] and lengths[0] == pytest.approx(TURN - 6.0, abs=1e-6)
    assert not crane(tmp_path, "projection", (POST,)).screen(a, b)[0][0]


def test_limits_are_no_way_round(tmp_path):
    """A continuous joint that is given limits does not come round: between them the way is the long one."""
    space = crane(tmp_path, "projection", continuous=3.2)
    assert space.turns is None
    start, goal = np.array([3.1, 0.0, 0.0]), np.array([-3.1, 0.0, 0.0])
    result = planned(space, "rrtconnect", start, goal)
    assert result.solved and path_length(result.path) >= 6.2
    np.testing.assert_array_equal(result.path[-1], goal)


def test_a_constraint_may_tell_turns_apart(tmp_path):
    """Where one joint follows another, geared down, a turn of either is another place."""
    robot = crane(tmp_path, "projection").validity.robot
    q = ca.SX.sym("q", 3)
    geared = Constraint("geared", q, q[1] - q[0] / 3)
    assert turns_on(geared, robot) is None
    assert turns_on(Constraint("whole", q, ca.sin(q[1] - 2 * q[0])), robot).mask.tolist() == [True, True, False]
    assert turns_on(Constraint("half", q, ca.sin(q[1] - q[0] / 2)), robot).mask.tolist() == [False, True, False]
    space = make("projection", geared, Validity(robot, []))
    start, goal = np.array([3.0, 1.0, 0.0]), np.array([-3.0, -1.0, 0.0])
    path = RrtConnect().plan(Query(space, start, goal), UniformSampler(), Termination(max_iterations=500), 0).path
    np.testing.assert_array_equal(path[-1], goal)


@pytest.mark.parametrize("space", ["projection", "atlas", "tangent_bundle"])
def test_ompl_gets_the_goal_at_its_nearest_turn(space, tmp_path):
    """OMPL, which plans in R^n, crosses half a turn as well."""
    ours = crane(tmp_path, space.replace("_", " "), (POST,))
    start, goal = np.array([2.6, 0.3, 0.0]), np.array([-2.5 - TURN, -0.8, 0.0])
    result = OmplPlanner("RRTConnect", space).plan(Query(ours, start, goal), Termination(time_limit=20.0), 1)
    assert result.solved
    np.testing.assert_allclose(result.path[-1], goal + TURN * np.array([2, 0, 0]), atol=1e-9)


@pytest.mark.parametrize("kind", ["rrtconnect", "fmt"])
def test_an_arm_of_continuous_joints(kind):
    """Kinova's arm, three joints of which turn, crosses half a turn of them, with its hand at one height."""
    robot = named("kinova")
    np.testing.assert_array_equal(robot.turning, [True, False, False, True, False, True])
    q = np.array(robot.rest)
    q[[0, 3, 5]] = 2.9, 3.0, 3.05
    constraint = plane(robot, robot.tool, robot.pose(q, robot.tool).translation)
    space = make("projection", constraint, Validity(robot, [], 0.005))
    goal = q * np.where(robot.turning, -1, 1)
    goal = constraint.project(goal).q
    assert space.validity.free(q) and space.validity.free(goal)
    planner = FmtStar(samples=200) if kind == "fmt" else RrtConnect(direct=True)
    result = planner.plan(Query(space, q, goal), UniformSampler(), Termination(max_iterations=2000), 0)
    assert result.solved
    path = shortcut(space, result.path, np.random.default_rng(0), 100)
    level = OnPlane(robot.tool, (0.0, 0.0, 1.0), float(robot.pose(q, robot.tool).translation[2]))
    assert_sound(space, settings("kinova"), path, q, goal, level)
    assert (np.abs(path - q)[:, [0, 3, 5]] < np.pi).all()
