"""The verifier passes sound paths and rejects every kind of broken one, judged by closed forms on a unit sphere."""

import ast
import inspect

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint, sphere_constraint
from pipeline.errors import ConfigError
from pipeline.evaluation import Failure, Verdict, VerifierParameters, verifier, verify
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.robots import Obstacle, Shape, Validity, point_robot

RADIUS = 0.002  # of the point robot [m]
START, GOAL = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def robot(high: float = 1.5):
    return point_robot(RADIUS, [-1.5] * 3, [1.5, 1.5, high])


def sphere() -> Constraint:
    return sphere_constraint(robot(), "point")


def arc(spacing: float, first: float = 0.0, last: float = np.pi / 2) -> np.ndarray:
    """Great circle in the plane z = 0 from angle `first` to `last`, waypoints `spacing` radians apart."""
    angle = np.linspace(first, last, round((last - first) / spacing) + 1)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def check(path: np.ndarray, obstacles=(), parameters: VerifierParameters | None = None, **ends) -> Verdict:
    ends = {"start": START, "goal": GOAL, **ends}
    return verify(path, ends["start"], ends["goal"], sphere(), Validity(robot(), obstacles), parameters)


def box(position, size, quaternion=(0.0, 0.0, 0.0, 1.0)) -> Obstacle:
    return Obstacle(Shape.BOX, tuple(position), quaternion, tuple(size))


def assert_rejected(verdict: Verdict, failure: Failure, segment: int | None) -> None:
    assert not verdict.passed
    assert verdict.failure is failure
    assert verdict.segment == segment
    assert len(verdict.message.split()) > 3


def test_great_circle_passes_with_its_length():
    """A quarter of a great circle passes; its length is that of its chords, 2 sin(spacing / 2) each."""
    spacing = np.pi / 2 / 60
    verdict = check(arc(spacing))
    assert verdict.passed and verdict.failure is None and verdict.segment is None and verdict.message == ""
    assert verdict.length == pytest.approx(60 * 2 * np.sin(spacing / 2), rel=1e-12)
    assert verdict.max_violation < 1e-12
    assert verdict.min_clearance is None


def test_checked_states_are_dense_and_on_the_sphere(monkeypatch):
    """States asked for collisions are at most two steps apart, on the sphere by its closed form, ends included."""
    seen = []
    monkeypatch.setattr(Validity, "free", lambda self, q: seen.append(q.copy()) or True)
    verdict = check(arc(np.pi / 2 / 17))
    states = np.array(seen)
    assert verdict.states_checked == len(states) > np.pi / 2 / 0.002
    assert np.linalg.norm(np.diff(states, axis=0), axis=1).max() <= 2 * 0.002
    assert np.abs(np.linalg.norm(states, axis=1) - 1).max() < 1e-5
    np.testing.assert_array_equal(states[[0, -1]], arc(np.pi / 2 / 17)[[0, -1]])


def test_paths_of_a_planning_walk_pass():
    """What Algorithm 2 walks on a free sphere is sound."""
    adherence = ProjectionAdherence(sphere(), Validity(robot(), ()), AdherenceParameters())
    rng = np.random.default_rng(0)
    for _ in range(5):
        start, goal = adherence.sample(rng, 2)
        path = np.vstack([start, adherence.traverse(start, goal).states])
        assert check(path, start=start, goal=path[-1]).passed


@pytest.mark.parametrize("waypoint", [0, 7, 60])
def test_waypoint_off_the_manifold(waypoint):
    """A waypoint a little more than the tolerance above the sphere is found, one a little less is not."""
    for radius, sound in ((1.0009, True), (1.0011, False), (0.9989, False)):
        path = arc(np.pi / 2 / 60)
        path[waypoint] *= radius
        verdict = check(path, start=path[0], goal=path[-1])
        assert verdict.max_violation == pytest.approx(abs(radius - 1), rel=1e-6)
        if sound:
            assert verdict.passed
        else:
            assert_rejected(verdict, Failure.OFF_MANIFOLD, min(waypoint, 59))


def test_thin_obstacle_between_two_waypoints():
    """A wall of 1 mm halfway between two waypoints that are free themselves is found, in its segment."""
    path = arc(0.05, 0.0, 1.5)
    angle = 0.05 * 10.5
    wall = box((np.cos(angle), np.sin(angle), 0), (0.1, 0.001, 0.1), (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)))
    free = Validity(robot(), [wall])
    assert all(free.free(q) for q in path)
    assert_rejected(check(path, [wall], goal=path[-1]), Failure.COLLISION, 10)


def test_contact_is_judged_on_the_manifold_not_on_the_chord():
    """An obstacle that the arc touches and the chord misses is contact; one that only the chord touches is not."""
    path = np.array([[np.cos(a), np.sin(a), 0] for a in (-0.0499, 0.0499)])  # the chord's middle is 1.2 mm inside
    contact = RADIUS + 0.0005
    for offset, touches in ((0.002, True), (-0.003, False)):  # of a ball's centre from the sphere
        ball = Obstacle(Shape.SPHERE, (1 + offset, 0, 0), (0.0, 0.0, 0.0, 1.0), (0.001, 0.001, 0.001))
        assert (abs(offset) < contact) == touches
        assert (abs(1 + offset - np.cos(0.0499)) < contact) != touches
        assert check(path, [ball], start=path[0], goal=path[-1]).passed != touches


def test_contact_at_the_ends():
    """Contact of the first and of the last state alone is found."""
    path = arc(0.05, 0.0, 1.5)
    for q, segment in ((path[0], 0), (path[-1], 29)):
        ball = Obstacle(Shape.SPHERE, tuple(q), (0.0, 0.0, 0.0, 1.0), (0.001, 0.001, 0.001))
        assert_rejected(check(path, [ball], goal=path[-1]), Failure.COLLISION, segment)


def test_teleport():
    """Two missing waypoints make a gap of 0.15, more than the bound of 0.1."""
    path = np.delete(arc(0.05, 0.0, 1.5), [8, 9], axis=0)
    assert_rejected(check(path, goal=path[-1]), Failure.LEAP, 7)


def _planes() -> Constraint:
    """Two planes z = +-0.04, nearer to each other than a leap."""
    q = ca.SX.sym("q", 3)
    return Constraint("planes", q, q[2] ** 2 - 0.04**2, tolerance=1e-5)


def test_jump_between_two_sheets():
    """Changing between sheets that are nearer than a leap is a jump although all waypoints are fine."""
    path = np.array([[0, 0, 0.04], [0.03, 0, 0.04], [0.04, 0, -0.04], [0.07, 0, -0.04]])
    validity = Validity(robot(), ())
    assert verify(path[:2], path[0], path[1], _planes(), validity).passed
    assert_rejected(verify(path, path[0], path[-1], _planes(), validity), Failure.JUMP, 1)


def test_no_manifold_between_waypoints():
    """A constraint that is not defined between two of its solutions has no way between them."""
    q = ca.SX.sym("q", 3)
    gap = Constraint("gap", q, ca.sqrt(q[0] ** 2 - 0.03**2) + q[1], tolerance=1e-5)
    path = np.array([[-0.03, 0, 0], [0.03, 0, 0]])
    assert_rejected(verify(path, path[0], path[1], gap, Validity(robot(), ())), Failure.NO_MANIFOLD, 0)


def test_joint_limit_of_a_waypoint():
    """A waypoint beyond a limit is named with its joint."""
    path = arc(0.05, 0.0, 1.5)
    low = point_robot(RADIUS, [-1.5] * 3, [1.5, 0.5, 1.5])
    verdict = verify(path, path[0], path[-1], sphere(), Validity(low, ()))
    assert_rejected(verdict, Failure.OUT_OF_BOUNDS, int(np.argmax(path[:, 1] > 0.5)))
    assert "joint y" in verdict.message


def test_joint_limit_between_waypoints():
    """Over the pole, between waypoints at cos(0.049) = 0.9988, a limit of 0.9995 is exceeded and one of 1 is not."""
    path = np.array([[np.sin(a), 0, np.cos(a)] for a in (-0.049, 0.049)])
    for high, sound in ((0.9995, False), (1.0, True)):
        verdict = verify(path, path[0], path[1], sphere(), Validity(robot(high), ()))
        if sound:
            assert verdict.passed
        else:
            assert_rejected(verdict, Failure.OUT_OF_BOUNDS, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("waypoint", [0, 5, 30])
def test_not_finite(value, waypoint):
    """A NaN or an infinity anywhere is found and named."""
    path = arc(0.05, 0.0, 1.5)
    path[waypoint, 1] = value
    verdict = check(path, goal=path[-1])
    assert_rejected(verdict, Failure.NOT_FINITE, min(waypoint, 29))
    assert f"waypoint {waypoint}" in verdict.message


def test_wrong_ends():
    """A path of the sphere that begins or ends elsewhere is rejected, also when it is the right one backwards."""
    path = arc(0.05, 0.0, 1.5)
    assert_rejected(check(path[1:], goal=path[-1]), Failure.WRONG_START, 0)
    assert_rejected(check(path, goal=path[-2]), Failure.WRONG_GOAL, 29)
    assert_rejected(check(path[::-1], goal=path[-1]), Failure.WRONG_START, 0)
    assert_rejected(check(path, goal=np.array([np.nan] * 3)), Failure.WRONG_GOAL, 29)


@pytest.mark.parametrize("path", [np.empty((0, 3)), np.empty(0), [], np.empty((3, 0))])
def test_empty_path(path):
    """A path without states is rejected."""
    assert_rejected(check(path), Failure.EMPTY, None)


@pytest.mark.parametrize("path", [np.zeros(3), np.zeros((4, 2)), np.zeros((2, 2, 3)), [["a", "b", "c"]], [[1], [2, 3]]])
def test_malformed_path(path):
    """What is no array of waypoints is a verdict, not an exception."""
    assert_rejected(check(path), Failure.MALFORMED, None)


def test_single_state():
    """One state is a path only from itself to itself, and only where it is free."""
    assert check(START[None], goal=START).passed
    assert_rejected(check(START[None]), Failure.WRONG_GOAL, None)
    ball = Obstacle(Shape.SPHERE, tuple(START), (0.0, 0.0, 0.0, 1.0), (0.001, 0.001, 0.001))
    assert_rejected(check(START[None], [ball], goal=START), Failure.COLLISION, None)


def test_repeated_states_pass():
    """A path that waits is sound."""
    assert check(np.repeat(arc(np.pi / 2 / 60), 3, axis=0)).passed


def test_clearance_is_the_least_of_the_waypoints():
    """Clearance to a ball is the distance of the centres less both radii."""
    path, centre = arc(np.pi / 2 / 20), np.array([0.9, 0.9, 0.3])
    ball = Obstacle(Shape.SPHERE, tuple(centre), (0.0, 0.0, 0.0, 1.0), (0.2, 0.2, 0.2))
    expected = np.linalg.norm(path - centre, axis=1).min() - 0.1 - RADIUS
    verdict = check(path, [ball], VerifierParameters(leap=0.2, clearance=True))
    assert verdict.passed
    assert verdict.min_clearance == pytest.approx(expected, abs=1e-9)


def test_margin_and_wrong_parameters_are_refused():
    """Verdicts are about contact, so a margin is an error; bounds are positive numbers."""
    with pytest.raises(ConfigError, match=r"margin.*0\.01"):
        verify(arc(0.05), START, GOAL, sphere(), Validity(robot(), (), margin=0.01))
    for name in ("step", "leap", "tolerance", "inner", "jump", "overshoot", "endpoint"):
        for value in (0.0, -1.0, np.nan, np.inf):
            with pytest.raises(ConfigError, match=f"verifier.{name}"):
                VerifierParameters(**{name: value})


def test_shares_no_code_with_planning():
    """The verifier imports neither adherence methods nor planners, and of a constraint calls only the value."""
    source = inspect.getsource(verifier)
    modules = {node.module for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)}
    assert not any(module.startswith(("pipeline.manifolds", "pipeline.planners")) for module in modules)
    calls = {node.attr for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Attribute)}
    assert not calls & {"project", "project_batch", "jacobian", "projected", "newton", "refine", "traverse"}
