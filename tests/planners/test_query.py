"""Starts and goals that no path can have, and settings that make no sense, are refused with value and bound."""

import re

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, ProblemError
from pipeline.planners import Clock, FmtStar, PlanStatus, Query, Rrt, RrtConnect, Termination
from pipeline.robots import Validity
from pipeline.samplers import UniformSampler
from tests.manifolds.spaces import CHARTED, make, sphere_space
from tests.robots.worlds import ball, block

GOOD, TOP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def blocked():
    """A sphere with a block on top, and y at most 0.5."""
    return sphere_space("projection", [block(TOP, (0.2, 0.2, 0.2))], upper=(1.5, 0.5, 1.5))


@pytest.mark.parametrize(
    "bad, said",
    [
        (np.array([1.0, 0.0]), "has shape (2,), the robot has 3 joints"),
        (np.array([[[1.0, 0.0, 0.0]]]), "has shape (1, 3), the robot has 3 joints"),
        (np.array([1.0, np.nan, 0.0]), "is not finite: [1.0, nan, 0.0]"),
        (np.array([np.inf, 0.0, 0.0]), "is not finite: [inf, 0.0, 0.0]"),
        (np.array([0.6, 0.8, 0.0]), ": joint y is 0.8, outside its limits [-1.5, 0.5]"),
        (np.array([1.6, 0.0, 0.0]), ": joint x is 1.6, outside its limits [-1.5, 1.5]"),
        (np.array([1.002, 0.0, 0.0]), "is off the manifold 'sphere': ||F|| = 0.002, tolerance 0.001; project it first"),
        (TOP, "is in collision: point with obstacle 0 (0.102 m deep, with a margin of 0.005 m)"),
        (
            np.array([0.104, 0.0, np.sqrt(1 - 0.104**2)]),
            "is in collision: point with obstacle 0 (0.002 m apart, with a margin of 0.005 m)",
        ),
    ],
)
@pytest.mark.parametrize("planner", [Rrt(), RrtConnect(), FmtStar()], ids=lambda p: type(p).__name__)
def test_invalid_ends_are_refused(planner, bad, said):
    """A start or goal of the wrong size, undefined, out of bounds, off the manifold or in collision is refused."""
    for ends, name in (((bad, GOOD), "start"), ((GOOD, bad), "goal")):
        with pytest.raises(ProblemError, match=re.escape(f"{name}{said if said[0] == ':' else ' ' + said}")):
            planner.plan(Query(blocked(), *ends), UniformSampler(), Termination(max_iterations=1), 0)


def test_no_start_or_goal_is_refused():
    """A query without a start, or without a goal, is refused by name."""
    for ends, name in (((np.empty((0, 3)), GOOD), "start"), ((GOOD, np.empty((0, 3))), "goal")):
        with pytest.raises(ProblemError, match=f"there is no {name}"):
            Query(blocked(), *ends).check()


def test_good_ends_pass():
    """Ends on the limits, within the tolerance and at the margin are accepted."""
    edge = np.array([0.0, 0.5, -np.sqrt(0.75)])
    Query(blocked(), np.array([1.0009, 0.0, 0.0]), edge).check()
    near = np.array([0.108, 0.0, np.sqrt(1 - 0.108**2)])
    Query(blocked(), near, GOOD).check()


def test_termination_needs_a_limit():
    """A termination without a time limit and without an iteration limit is refused."""
    with pytest.raises(ConfigError, match=r"time_limit.*max_iterations"):
        Termination()
    with pytest.raises(ConfigError, match=r"time_limit.*max_iterations"):
        Termination(cost_below=1.0)


@pytest.mark.parametrize("name", ["time_limit", "max_iterations", "cost_below"])
@pytest.mark.parametrize("value", [0, -1, np.inf, np.nan])
def test_termination_values(name, value):
    """A limit that is zero, negative, infinite or undefined is refused with its name and value."""
    with pytest.raises(ConfigError, match=rf"termination\.{name} is {value}; it must be (finite and )?above 0"):
        Termination(**{"max_iterations": 5, name: value})


@pytest.mark.parametrize(
    "kind, name, value",
    [
        *[(kind, "range", value) for kind in (Rrt, RrtConnect) for value in (0.0, -1.0, np.nan)],
        *[(kind, "node_states", 0) for kind in (Rrt, RrtConnect)],
        *[(Rrt, "goal_bias", value) for value in (0.0, 1.1, np.nan)],
        *[(FmtStar, "samples", value) for value in (2, 0)],
        *[(FmtStar, "radius_multiplier", value) for value in (0.0, np.nan)],
        *[(FmtStar, "group", value) for value in (-0.1, np.nan)],
        (FmtStar, "late", -0.5),
    ],
)
def test_planner_parameters(kind, name, value):
    """A planner's parameter out of its range is refused with its name and value."""
    with pytest.raises(ConfigError, match=rf"planner\.{name} is {value}"):
        kind(**{name: value})


def test_clock_counts_to_its_limit():
    """A clock grants exactly max_iterations and then says why it stops, every time it is asked."""
    clock = Clock(Termination(max_iterations=4))
    assert [clock.tick() for _ in range(6)] == [None] * 4 + [PlanStatus.ITERATION_LIMIT] * 2
    assert clock.iterations == 4 and not clock.out_of_time()


def test_clock_runs_out():
    """After its time limit a clock grants nothing more; before it does."""
    clock = Clock(Termination(time_limit=100))
    assert clock.tick() is None and not clock.out_of_time()
    over = Clock(Termination(time_limit=1e-9))
    assert over.out_of_time() and over.tick() is PlanStatus.TIME_LIMIT and over.iterations == 0
    assert over.elapsed > 0


@pytest.mark.parametrize("method", CHARTED)
@pytest.mark.parametrize("planner", [Rrt(), RrtConnect()], ids=lambda p: type(p).__name__)
def test_ends_without_a_chart_are_a_failure_not_an_error(planner, method):
    """Where neither start nor goal has a tangent space, nothing can be sampled: the search ends at its limit."""
    q = ca.SX.sym("q", 3)
    cross = Constraint("cross", q, q[0] * q[1])  # two planes; no rank along the z axis
    problem = Query(make(method, cross, Validity(ball(), [])), np.zeros(3), np.array([0.0, 0.0, 0.5]))
    result = planner.plan(problem, UniformSampler(), Termination(max_iterations=50), 0)
    assert result.status is PlanStatus.ITERATION_LIMIT and result.counters.charts == 0
