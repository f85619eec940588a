"""OMPL through the adapter: sound paths by an independent check, repeatable, silent, and without crashes or leaks."""

import hashlib
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint, sphere_constraint
from pipeline.errors import ConfigError, ProblemError
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence, joined
from pipeline.planners import Planner, PlanStatus, Query, Termination, path_length
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner, available_planners
from pipeline.robots import Obstacle, Shape, Validity, point_robot
from pipeline.spec.statement import OnSphere, Point, Statement
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import VerifierParameters

SPACES = ("projection", "atlas", "tangent_bundle")
ROUTES = [(space, False) for space in SPACES] + [("projection", True)]
SOUTH, NORTH = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])


def wall(gap: float = 0.5) -> list[Obstacle]:
    """Four boxes around the equator that leave a gap of `gap` metres on the side of positive x."""
    side = (1.2 - gap / 2, gap / 2 + (1.2 - gap / 2) / 2)
    boxes = [((-1, 0), (0.6, 2.4)), ((0, 1), (1.4, 0.6)), ((0, -1), (1.4, 0.6))]
    boxes += [((1, sign * side[1]), (0.6, side[0])) for sign in (1, -1)]
    upright = (0.0, 0.0, 0.0, 1.0)
    return [Obstacle(Shape.BOX, (*centre, 0.0), upright, (*extent, 0.2)) for centre, extent in boxes]


def problem(obstacles=(), margin: float = 0.01, lower=-1.5, upper=1.5, start=SOUTH, goal=NORTH) -> Query:
    robot = point_robot(0.01, [lower] * 3, [upper] * 3)
    constraint = sphere_constraint(robot, "point")
    adherence = ProjectionAdherence(constraint, Validity(robot, obstacles, margin), AdherenceParameters())
    return Query(adherence, start, goal)


def planner(name: str = "RRTConnect", space: str = "projection", override: bool = False, **options) -> OmplPlanner:
    return OmplPlanner(name, space, OmplParameters(project_override=override, **options))


def assert_sound(path: np.ndarray, scene: Query, obstacles) -> None:
    robot = scene.adherence.validity.robot
    point = Point(0.01, tuple(robot.lower), tuple(robot.upper))
    statement = Statement(point, (OnSphere("point", 1.0),), 1e-3, tuple(obstacles))
    # OMPL looks at states, which are within the tolerance; the lines between them are off by delta^2 / 8 more.
    assert np.abs(np.linalg.norm(path, axis=1) - 1).max() < 1e-3
    verdict = Judge(statement, VerifierParameters(tolerance=1e-3 + 0.1**2 / 8)).verify(path, scene.start, scene.goal)
    assert verdict.passed, verdict.message


@pytest.mark.parametrize("space, override", ROUTES)
@pytest.mark.parametrize("name", ["RRTConnect", "FMT"])
def test_path_is_dense_and_sound(name, space, override):
    """Paths lead exactly from start to goal, in steps of about delta, on the sphere and through the gap of a wall."""
    scene = problem(wall(), start=np.array([0.6, 0.0, -0.8]), goal=np.array([0.6, 0.0, 0.8]))
    options = {"num_samples": 300, "rho": 0.5} if name == "FMT" else {}  # of rho see OmplParameters
    result = planner(name, space, override, **options).plan(scene, Termination(time_limit=20), seed=1)
    assert result.solved
    np.testing.assert_array_equal(result.path[[0, -1]], [scene.start, scene.goal])
    gaps = np.linalg.norm(np.diff(result.path, axis=0), axis=1)
    assert 0 < gaps.min() and 0.02 < np.median(gaps) < 0.06 and gaps.max() <= 0.1
    assert np.abs(np.linalg.norm(result.path, axis=1) - 1).max() < 1e-3
    assert result.path[np.abs(result.path[:, 2]).argmin(), 0] > 0.9
    assert_sound(result.path, scene, wall())


@pytest.mark.parametrize("name", available_planners())
def test_every_planner_that_is_bound_plans(name):
    """Each planner of this OMPL that ends on a manifold solves an easy problem and its path is sound."""
    scene = problem(wall(0.8))
    options = {"num_samples": 300} if name in ("FMT", "BFMT") else {}
    result = planner(name, **options).plan(scene, Termination(time_limit=20), seed=2)
    assert result.solved
    assert_sound(result.path, scene, wall(0.8))


@pytest.mark.parametrize("space, override", ROUTES)
def test_one_seed_gives_one_path(space, override):
    """Plans repeat bit by bit whatever was planned before; another seed gives another path."""
    scene, limit = problem(wall()), Termination(max_iterations=20_000)
    first = planner("RRTConnect", space, override).plan(scene, limit, seed=3)
    other = planner("RRTConnect", space, override).plan(scene, limit, seed=4)
    planner("FMT", "projection", num_samples=50).plan(problem(), limit, seed=5)
    again = planner("RRTConnect", space, override).plan(scene, limit, seed=3)
    assert first.solved and other.solved
    np.testing.assert_array_equal(first.path, again.path)
    assert (first.counters, first.iterations, first.seed) == (again.counters, again.iterations, 3)
    assert first.path.shape != other.path.shape or (first.path != other.path).any()


def test_both_routes_walk_the_same_way():
    """OMPL's Newton iteration over our callbacks and our own projection are the same algorithm: equal paths."""
    results = [
        planner(override=override).plan(problem(wall()), Termination(time_limit=20), seed=6)
        for override in (False, True)
    ]
    np.testing.assert_allclose(results[0].path, results[1].path, atol=1e-9)


def test_calls_are_counted(monkeypatch):
    """Callbacks are counted as they reach the constraint and the validity; both routes project about as often."""
    calls = {"value": 0, "jacobian": 0, "project": 0}
    for name in calls:
        original = getattr(Constraint, name)

        def counting(self, q, name=name, original=original):
            calls[name] += 1
            return original(self, q)

        monkeypatch.setattr(Constraint, name, counting)
    projections = []
    for override in (False, True):
        scene, ours = problem(wall()), planner(override=override)
        calls.update(value=0, jacobian=0, project=0)
        result = ours.plan(scene, Termination(time_limit=20), seed=6)
        counted = ours.callbacks
        assert (counted.values, counted.jacobians, counted.projections) == tuple(calls.values())
        assert (counted.jacobians > 0) != override and (counted.projections > 0) == override
        assert result.counters.collision_checks == counted.states > 0  # none lies outside the limits
        assert result.iterations == counted.terminations > 0
        assert result.counters.charts == 0
        projections.append(result.counters.projections)
    assert projections[1] <= projections[0] < 1.5 * projections[1]


def test_charts_are_counted():
    """An atlas from pole to pole needs more than the charts at both."""
    result = planner(space="atlas").plan(problem(), Termination(time_limit=20), seed=1)
    assert result.solved and result.counters.charts > 2


@pytest.mark.parametrize("space", ["projection", "atlas", "tangent_bundle"])
def test_samples_before_a_walk(space):
    """Charts draw around both ends, no farther than their discs reach on the sphere; projection draws everywhere."""
    drawn = planner("FMT", space).samples(problem(), 400, seed=0)
    assert np.abs(np.linalg.norm(drawn, axis=1) - 1).max() < 2e-3
    to_start, to_goal = (np.linalg.norm(drawn - end, axis=1) for end in (SOUTH, NORTH))
    farthest = np.minimum(to_start, to_goal).max()
    radius = 0.25 / (1 - 0.75) ** 0.5  # of a disc: rho and exploration are OMPL's defaults, d = 2
    reach = 2 * np.sin(np.arcsin(radius) / 2)  # its rim, moved onto the sphere along the normal of the chart
    assert farthest > 1.3 if space == "projection" else 0.9 * reach < farthest < reach + 1e-3
    assert 0.35 < (to_start < to_goal).mean() < 0.65
    again = planner("FMT", space).samples(problem(), 400, seed=0)
    np.testing.assert_array_equal(drawn, again)


def test_unreachable_goal_is_a_failure_with_its_reason():
    """Behind a closed wall OMPL reports an approximate solution, which is none: no path, and why it ended."""
    scene = problem(wall(0.0))
    for space in SPACES:
        by_count = planner(space=space).plan(scene, Termination(max_iterations=50), seed=0)
        assert (by_count.status, by_count.iterations, by_count.path.shape) == (PlanStatus.ITERATION_LIMIT, 50, (0, 3))
    by_clock = planner("RRT").plan(scene, Termination(time_limit=0.2), seed=0)
    assert by_clock.status is PlanStatus.TIME_LIMIT and 0.2 <= by_clock.planning_time < 1
    assert not by_clock.solved and by_clock.path.shape == (0, 3)


def test_singular_start_is_a_failure():
    """At the tip of a cone there is no chart; OMPL's exception is a failed plan."""
    q = ca.SX.sym("q", 3)
    robot = point_robot(0.01, [-1.5] * 3, [1.5] * 3)
    cone = Constraint("cone", q, q[2] ** 2 - q[0] ** 2 - q[1] ** 2)
    scene = Query(
        ProjectionAdherence(cone, Validity(robot, ()), AdherenceParameters()), np.zeros(3), np.array([1.0, 0, 1])
    )
    for space in ("atlas", "tangent_bundle"):
        result = planner(space=space).plan(scene, Termination(time_limit=0.5), seed=0)
        assert result.status is PlanStatus.FAILED and result.path.shape == (0, 3)


@pytest.mark.parametrize("space", SPACES)
def test_paths_keep_joint_limits(space):
    """Where limits cut off all of the sphere beyond 0.8, paths stay within; OMPL alone would not look."""
    scene = problem(lower=-0.8, upper=0.8, start=np.array([0.6, 0.0, -0.8]), goal=np.array([-0.6, 0.0, -0.8]))
    result = planner(space=space, override=False).plan(scene, Termination(time_limit=20), seed=0)
    assert result.solved
    assert np.abs(result.path).max() <= 0.8


def test_threaded_planners_end_by_the_clock_only():
    """PRM's second thread would deadlock on a count kept in Python, so that is an error."""
    for name in ("PRM", "PRMstar"):
        with pytest.raises(ConfigError, match=f"{name}.*max_iterations"):
            planner(name).plan(problem(), Termination(time_limit=1, max_iterations=10), seed=0)
    closed = planner("PRM").plan(problem(wall(0.0)), Termination(time_limit=0.3), seed=0)
    assert closed.status is PlanStatus.TIME_LIMIT


def test_improving_planners_stop_at_the_first_path_unless_told():
    """RRT* returns its first path at once, and with `cost_below` one shorter than that: half a circle is pi."""
    scene = problem(wall(0.8))
    first = planner("RRTstar").plan(scene, Termination(time_limit=20), seed=1)
    better = planner("RRTstar").plan(scene, Termination(time_limit=20, cost_below=3.5), seed=1)
    assert first.solved and first.planning_time < 19
    assert better.solved and np.pi - 0.01 < path_length(better.path) < 3.6  # dense chords, longer than OMPL's few


@pytest.mark.parametrize("space", SPACES)
def test_start_equal_to_goal(space):
    """A way from a state to itself, which OMPL may seek in a circle, is a sound path."""
    scene = problem(goal=SOUTH)
    result = planner(space=space).plan(scene, Termination(time_limit=1), seed=0)
    assert result.solved
    assert_sound(result.path, scene, ())


def test_unknown_names_and_values_list_what_there_is():
    """Names are checked when the planner is made, with the alternatives in the message; so are values."""
    with pytest.raises(ConfigError, match=r"'RRTConect'.*FMT.*RRTConnect"):
        OmplPlanner("RRTConect", "projection")
    with pytest.raises(ConfigError, match=r"'atlass'.*projection, atlas, tangent_bundle"):
        OmplPlanner("RRTConnect", "atlass")
    with pytest.raises(ConfigError, match=r"range.*FMT has no range"):
        planner("FMT", range=0.5)
    with pytest.raises(ConfigError, match="project_override"):
        planner(space="atlas", override=True)
    for name, value in (("delta", 0.0), ("leap", 1.0), ("alpha", 2.0), ("exploration", 1.0), ("num_samples", -1)):
        with pytest.raises(ConfigError, match=rf"ompl\.{name} is {value}"):
            OmplParameters(**{name: value})
    with pytest.raises(ConfigError, match="AORRTC"):
        planner("AORRTC")
    assert {"RRTConnect", "FMT", "RRTstar"} <= set(available_planners())
    assert not issubclass(OmplPlanner, Planner)  # no sampler of ours can be put into OMPL


def test_options_reach_ompl():
    """A finer delta gives a denser path, a shorter range more rounds, fewer samples fewer checks."""
    scene, limit = problem(wall()), Termination(time_limit=20)
    coarse, fine = (planner(delta=delta).plan(scene, limit, seed=2) for delta in (0.05, 0.02))
    assert np.median(np.linalg.norm(np.diff(fine.path, axis=0), axis=1)) < 0.025
    assert fine.counters.projections > coarse.counters.projections
    assert planner(range=0.1).plan(scene, limit, seed=2).iterations > coarse.iterations
    few, many = (planner("FMT", num_samples=count).plan(problem(), limit, seed=2) for count in (100, 400))
    assert few.counters.collision_checks < many.counters.collision_checks


def test_wrong_problems_and_errors_of_ours_are_raised(monkeypatch):
    """A start in collision is refused as by every planner, and an error in a callback comes out as it is."""
    with pytest.raises(ProblemError, match="start is in collision"):
        planner().plan(problem(wall(), start=np.array([0.0, 1.0, 0.0])), Termination(time_limit=1), seed=0)
    scene = problem()

    def broken(self, q):
        raise ValueError("broken on purpose")

    monkeypatch.setattr(Constraint, "jacobian", broken)
    with pytest.raises(ValueError, match="broken on purpose"):
        planner().plan(scene, Termination(time_limit=1), seed=0)
    monkeypatch.undo()
    assert planner().plan(scene, Termination(time_limit=10), seed=0).solved


_LOOP = """
import hashlib, sys
sys.path[:0] = [".", "tests/planners"]
from test_ompl_adapter import *

def pages():
    return int(open("/proc/self/statm").read().split()[1]) * 4096

digests, memory = [], []
scene, crowded = problem(), problem(wall())
for count in range(240):
    space, override = ROUTES[count % 4]
    name = "FMT" if count % 24 == 3 else "RRTConnect"
    result = planner(name, space, override, num_samples=30).plan(
        crowded if count % 5 else scene, Termination(max_iterations=60), seed=count % 40
    )
    digests.append(hashlib.sha256(result.path.tobytes()).hexdigest())
    memory.append(pages())
assert sum(len(set(digests[i::120])) > 1 for i in range(120)) == 0, "plans do not repeat"
print(hashlib.sha256("".join(digests).encode()).hexdigest(), memory[-1] - memory[79])
"""


@pytest.mark.slow
def test_many_plans_are_silent_repeatable_and_leak_nothing():
    """240 plans in a fresh process, twice: equal paths, nothing but ours printed, a clean exit, no growing memory."""
    outputs = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", _LOOP],
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""  # nanobind names at the exit what was never freed
        digest, growth = done.stdout.split()
        assert int(growth) < 4 * 2**20
        outputs.append(digest)
    assert outputs[0] == outputs[1]
    assert len(outputs[0]) == len(hashlib.sha256(b"").hexdigest())


def test_joined_paths_are_polylines_on_the_manifold():
    """A path of OMPL, joined, has all chords within the tolerance and the same ends, and is near what it was."""
    scene = problem(wall())
    found = planner().plan(scene, Termination(time_limit=20), seed=1).path
    path = joined(scene.adherence, found)
    shares = np.linspace(0, 1, 50)[:, None]
    chords = np.concatenate([a + shares * (b - a) for a, b in pairwise(path)])
    assert np.abs(np.linalg.norm(chords, axis=1) - 1).max() < 1e-3
    assert np.array_equal(path[[0, -1]], found[[0, -1]])
    assert np.linalg.norm(chords[:, None] - found[None], axis=2).min(axis=0).max() < 2e-3
