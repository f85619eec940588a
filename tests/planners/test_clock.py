"""Whatever a plan is doing, it looks at the clock: told by a clock that only moves when it is looked at."""

import time

import numpy as np
import pytest

from pipeline.constraints import plane
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.targets import with_values
from pipeline.errors import ConfigError
from pipeline.manifolds import AdherenceParameters, AtlasParameters, Deadline, OutOfTime
from pipeline.planners import PLANNERS, FmtStar, PlanStatus, Query, RrtConnect, Termination, path_length, shortcut
from pipeline.planners.ompl_adapter import OmplPlanner
from pipeline.samplers import UniformSampler
from tests.manifolds.spaces import METHODS, sphere_space
from tests.planners.scenes import Scene, scene, solve, space_of
from tests.robots.named import named

START, GOAL = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
CLOSED = scene(3, 0.0)  # a fence without a gap


class Ticking:
    """A clock that moves by a second whenever it is looked at, and counts how often that was."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.looks = 0
        monkeypatch.setattr(time, "perf_counter", self)

    def __call__(self) -> float:
        self.looks += 1
        return float(self.looks)


@pytest.mark.parametrize("kind", [kind for kind in PLANNERS if "rrtconnect" in kind])
@pytest.mark.parametrize("limits", [{"max_iterations": 50}, {"time_limit": 0.1}])
def test_a_cost_out_of_reach_ends_where_the_way_is_straight(kind, limits):
    """With `direct`, whose path costs no iteration, a path that is never short enough ends the search at its limit."""
    problem = Query(sphere_space("projection"), START, GOAL)
    for direct in (False, True):
        termination = Termination(**limits, cost_below=0.1)
        result = PLANNERS[kind](direct=direct).plan(problem, UniformSampler(), termination, 0)
        assert result.solved and path_length(result.path) > np.sqrt(2)
        assert result.iterations == limits.get("max_iterations", result.iterations)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", PLANNERS)
def test_no_plan_works_on_when_its_time_is_over(kind, method, monkeypatch):
    """Among limits of up to 200 looks at the clock, each ends its plan at most a few looks later, unsolved."""
    space = space_of(method, CLOSED)
    planner, problem = PLANNERS[kind](), Query(space, CLOSED.start, CLOSED.goal)
    for limit in (1, 2, 3, 5, 10, 30, 60, 200):
        clock = Ticking(monkeypatch)
        result = planner.plan(problem, UniformSampler(), Termination(time_limit=float(limit)), 0)
        monkeypatch.undo()
        assert result.status is PlanStatus.TIME_LIMIT and not len(result.path)
        assert limit <= clock.looks <= limit + 4


def test_between_two_looks_little_is_done(monkeypatch):
    """No piece of a plan by FMT* takes more than the points of 64 edges between two looks."""
    space, done = space_of("projection", CLOSED), []

    def looking() -> float:
        done.append(space.counters.projections + space.validity.checks)
        return 0.0

    monkeypatch.setattr(time, "perf_counter", looking)
    solve(FmtStar(samples=2000), space, CLOSED, max_iterations=40)
    assert max(done) > 10_000 and np.diff(done).max() <= 2 * 16 * 64


@pytest.mark.parametrize("method", METHODS)
def test_shortcuts_end_within_an_attempt(method, monkeypatch):
    """Shortcuts end at their time, with a path that is no longer than before."""
    s = Scene(START, GOAL, ())
    space = space_of(method, s)
    path = solve(RrtConnect(), space, s).path
    for limit in (1, 2, 5, 40):
        clock = Ticking(monkeypatch)
        shorter = shortcut(space, path, np.random.default_rng(0), 10**6, float(limit))
        monkeypatch.undo()
        assert clock.looks == limit and path_length(shorter) <= path_length(path)


def test_the_sooner_of_two_deadlines_counts(monkeypatch):
    """A deadline within another ends at the sooner of both, and afterwards the outer one is back."""
    deadline, now = Deadline(), [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    deadline.look()
    with deadline.until(2.0):
        for end in (1.0, 5.0):
            now[0] = 0.0
            with deadline.until(end):
                deadline.look()
                now[0] = min(end, 2.0)
                with pytest.raises(OutOfTime):
                    deadline.look()
        now[0] = 1.5
        deadline.look()
    now[0] = 100.0
    deadline.look()


@pytest.mark.parametrize("epsilon", [0.05, 0.06, 1.0])
def test_charts_that_would_stall_at_every_step_are_refused(epsilon):
    """An epsilon of a step or more, below which every step of a walk counts as stalled, is refused with both."""
    with pytest.raises(ConfigError, match=rf"adherence\.epsilon is {epsilon} and step 0\.05; epsilon must be below"):
        AtlasParameters(step=0.05, epsilon=epsilon)


def test_walks_that_could_never_arrive_are_refused():
    """A step may not be bound to less than a step, nor a way to less than the straight line."""
    for name, value, bound in (("leap", 1.0, "above 1"), ("leap", 0.5, "above 1"), ("wander", 0.9, "at least 1")):
        with pytest.raises(ConfigError, match=rf"adherence\.{name} is {value}; it must be {bound}"):
            AdherenceParameters(**{name: value})


@pytest.mark.parametrize("method", ["atlas", "tangent bundle"])
def test_charts_arrive_up_to_the_bound(method):
    """With an epsilon just below the step walks in charts do not stall."""
    assert sphere_space(method, step=0.05, epsilon=0.0499).traverse(START, GOAL).reached


@pytest.mark.parametrize("space", ["projection", "atlas", "tangent_bundle"])
@pytest.mark.parametrize("planner", ["RRTConnect", "RRTstar", "FMT"])
def test_ompl_asks_for_nothing_more_when_its_time_is_over(planner, space, monkeypatch):
    """After the time limit no constraint is evaluated and no contact asked for, however much OMPL still walks."""
    ours = space_of(space.replace("_", " "), CLOSED)
    late, clock, limit = [0], Ticking(monkeypatch), 3000.0

    def counted(ask):
        def counting(q):
            late[0] += begun and clock.looks > ended
            return ask(q)

        return counting

    begun, ended = False, 0.0
    problem = Query(ours, CLOSED.start, CLOSED.goal)
    problem.check()
    monkeypatch.setattr(problem.adherence.constraint, "value", counted(ours.constraint.value))
    begun, ended = True, clock.looks + limit + 3
    result = OmplPlanner(planner, space).plan(problem, Termination(time_limit=limit), 1)
    assert result.status is PlanStatus.TIME_LIMIT and late == [0] and clock.looks > ended


def test_inverse_kinematics_ends_at_its_time(monkeypatch):
    """Inverse kinematics tries once whatever the time is, and no more when it is over."""
    robot = named("panda")
    point = robot.pose(robot.rest, robot.tool).translation
    inverse = InverseKinematics(robot, plane(robot, robot.tool, point), with_values([(0, 0.2)]))
    for until, tries in ((0.0, 1), (3.0, 3), (np.inf, 20)):
        Ticking(monkeypatch)
        found = list(inverse.solutions(np.random.default_rng(0), 20, robot.rest, until=until))
        monkeypatch.undo()
        assert inverse.tried == tries and found
