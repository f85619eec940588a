"""The verifier passes sound paths and rejects every kind of broken one, judged by closed forms on a unit sphere."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import ConfigError, ProblemError
from pipeline.robots import Obstacle, Shape
from pipeline.spec.statement import Mazed, OnSphere, OnTorus, Point, Statement
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Failure, Verdict, VerifierParameters

RADIUS = 0.002  # of the point robot [m]
START, GOAL = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
LOOSE = 2e-3  # tolerance, for coarse paths: a chord of 0.1 rad is 1.25e-3 inside the sphere


def sphere(obstacles=(), high: float = 1.5, tolerance: float = 1e-3) -> Statement:
    point = Point(RADIUS, (-1.5,) * 3, (1.5, 1.5, high))
    return Statement(point, (OnSphere("point", 1.0),), tolerance, tuple(obstacles))


def arc(spacing: float, first: float = 0.0, last: float = np.pi / 2) -> np.ndarray:
    """Great circle in the plane z = 0 from angle `first` to `last`, waypoints `spacing` radians apart."""
    angle = np.linspace(first, last, round((last - first) / spacing) + 1)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def check(path: np.ndarray, obstacles=(), parameters: VerifierParameters | None = None, **ends) -> Verdict:
    ends = {"start": START, "goal": GOAL, **ends}
    return Judge(sphere(obstacles), parameters).verify(path, ends["start"], ends["goal"])


def box(position, size, quaternion=(0.0, 0.0, 0.0, 1.0)) -> Obstacle:
    return Obstacle(Shape.BOX, tuple(position), quaternion, tuple(size))


def ball(position, diameter: float = 0.001) -> Obstacle:
    return Obstacle(Shape.SPHERE, tuple(position), (0.0, 0.0, 0.0, 1.0), (diameter,) * 3)


def assert_rejected(verdict: Verdict, failure: Failure, segment: int | None) -> None:
    assert not verdict.passed
    assert verdict.failure is failure
    assert verdict.segment == segment
    assert len(verdict.message.split()) > 3


def test_great_circle_passes_with_its_length():
    """A quarter of a great circle passes, all chords proven; its length is 2 sin(spacing / 2) for each of them."""
    spacing = np.pi / 2 / 60
    verdict = check(arc(spacing), [ball((0, 0, 1), 0.5)])
    assert verdict.passed and verdict.failure is None and verdict.segment is None and verdict.message == ""
    assert verdict.length == pytest.approx(60 * 2 * np.sin(spacing / 2), rel=1e-12)
    assert verdict.max_violation < 1e-12
    assert verdict.min_clearance is None
    assert (verdict.chords_proven, verdict.chords_sampled, verdict.note) == (60, 0, "")


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


@pytest.mark.parametrize("gap", [0.05, 0.0889, 0.0899, 0.5])
def test_chord_off_the_manifold(gap):
    """Between waypoints on the sphere the chord is 1 - cos(gap / 2) inside it, which the tolerance bounds, not a step.

    Tolerance 1e-3: a gap of 0.0894 rad.
    """
    path = np.concatenate([arc(0.05, 0.0, 0.5), arc(0.05, 0.5 + gap, 1.5)])
    verdict = check(path, goal=path[-1])
    if 1 - np.cos(gap / 2) < 1e-3:
        assert verdict.passed and not verdict.chords_sampled
    else:
        assert_rejected(verdict, Failure.OFF_MANIFOLD, 10)


@pytest.mark.parametrize("thickness", [0.001, 1e-5])
def test_thin_obstacle_between_two_waypoints(thickness):
    """A thin wall halfway between two waypoints that are free themselves is found, in its segment."""
    path = arc(0.05, 0.0, 1.5)
    angle = 0.05 * 10.5
    turned = (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))
    wall = box((np.cos(angle), np.sin(angle), 0), (0.1, thickness, 0.1), turned)
    assert_rejected(check(path, [wall], goal=path[-1]), Failure.COLLISION, 10)


def test_contact_is_judged_on_the_chord():
    """An obstacle that the chord touches is contact, one that only the arc touches is not: a path is its polyline."""
    path = np.array([[np.cos(a), np.sin(a), 0] for a in (-0.0499, 0.0499)])  # the chord's middle is 1.2 mm inside
    contact = RADIUS + 0.0005
    for offset in (0.002, -0.003):  # of a ball's centre from the sphere
        touches = abs(1 + offset - np.cos(0.0499)) < contact
        assert touches != (abs(offset) < contact)
        judge = Judge(sphere([ball((1 + offset, 0, 0))], tolerance=LOOSE))
        assert judge.verify(path, path[0], path[-1]).passed != touches


@pytest.mark.parametrize("clearance", [-2e-4, -1e-5, 1e-6, 1e-5, 2e-4, 1e-2])
def test_near_misses(clearance):
    """Contact is refused, however slight; a miss by more than 0.1 mm is proven; a nearer one passes, and is said."""
    path = np.array([[0.998, -0.06, 0.0], [0.998, 0.06, 0.0]])
    stick = box((0.998, 0.01, RADIUS + clearance + 0.0005), (0.3, 0.001, 0.001))
    verdict = Judge(sphere([stick], tolerance=1e-2)).verify(path, path[0], path[1])
    assert verdict.passed == (clearance > 0)
    if verdict.passed:
        assert verdict.chords_proven + verdict.chords_sampled == 1
        assert verdict.chords_sampled == 0 or clearance < 1e-4
        assert ("sampled" in verdict.note) == bool(verdict.chords_sampled)


def test_contact_at_the_ends():
    """Contact of the first and of the last state alone is found."""
    path = arc(0.05, 0.0, 1.5)
    for q, segment in ((path[0], 0), (path[-1], 29)):
        assert_rejected(check(path, [ball(q)], goal=path[-1]), Failure.COLLISION, segment)


def test_joint_limit_of_a_waypoint():
    """A waypoint beyond a limit is named with its joint; limits along chords follow from their ends."""
    path = arc(0.05, 0.0, 1.5)
    low = replace(sphere(), robot=Point(RADIUS, (-1.5,) * 3, (1.5, 0.5, 1.5)))
    verdict = Judge(low).verify(path, path[0], path[-1])
    assert_rejected(verdict, Failure.OUT_OF_BOUNDS, int(np.argmax(path[:, 1] > 0.5)))
    assert "joint y" in verdict.message
    over = np.array([[np.sin(a), 0, np.cos(a)] for a in (-0.04, 0.04)])  # over the pole: its middle is at the limit
    assert Judge(sphere(high=float(over[0, 2]))).verify(over, over[0], over[1]).passed


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
    assert_rejected(check(START[None], [ball(START)], goal=START), Failure.COLLISION, None)


def test_repeated_states_pass():
    """A path that waits is sound."""
    assert check(np.repeat(arc(np.pi / 2 / 60), 3, axis=0), [ball((0, 0, 1))]).passed


def test_clearance_is_the_least_of_the_waypoints():
    """Clearance to a ball is the distance of the centres less both radii."""
    path, centre = arc(np.pi / 2 / 20), np.array([0.9, 0.9, 0.3])
    expected = np.linalg.norm(path - centre, axis=1).min() - 0.1 - RADIUS
    verdict = check(path, [ball(centre, 0.2)], VerifierParameters(clearance=True))
    assert verdict.passed
    assert verdict.min_clearance == pytest.approx(expected, abs=1e-9)
    assert check(path, (), VerifierParameters(clearance=True)).min_clearance == np.inf


def test_wrong_parameters_are_refused():
    """Bounds are positive numbers."""
    for name in ("tolerance", "endpoint"):
        for value in (0.0, -1.0, np.nan, np.inf):
            with pytest.raises(ConfigError, match=f"verifier.{name}"):
                VerifierParameters(**{name: value})


def test_obstacles_that_cannot_be_are_refused(tmp_path):
    """Sizes and poses that make no body, and a mesh that is no file, are errors that name the body."""
    for obstacle, said in (
        (box((0, 0, 2), (0.1, 0.0, 0.1)), "above 0"),
        (box((0, np.nan, 2), (0.1, 0.1, 0.1)), "not finite"),
        (replace(box((0, 0, 2), (1, 1, 1)), shape=Shape.MESH, file=str(tmp_path / "none.obj")), "cannot be read"),
    ):
        with pytest.raises(ProblemError, match=said):
            Judge(sphere([obstacle]))


def maze(walls: np.ndarray) -> Judge:
    robot = Point(0.001, (-3.5,) * 3, (3.5,) * 3)
    return Judge(Statement(robot, (OnTorus(2.0, 1.0),), 1e-3, conditions=(Mazed(walls, 2.0, 1.0),)))


def test_walls_of_a_maze():
    """Around a torus a wall a pixel wide, however thin, is found; a way that runs beside it by a hair is proven."""
    for columns in (64, 4096):
        walls = np.zeros((32, columns), bool)
        walls[:, columns // 4] = True
        edge = 2 * np.pi * (columns // 4) / columns
        around = np.linspace(0.3, edge - 1e-6, 200)
        path = np.stack([3 * np.cos(around), 3 * np.sin(around), 0 * around], axis=1)
        verdict = maze(walls).verify(path, path[0], path[-1])
        assert verdict.passed, verdict.message
        around = np.append(around, around + (edge - 0.3) + 0.02)
        path = np.stack([3 * np.cos(around), 3 * np.sin(around), 0 * around], axis=1)
        assert_rejected(maze(walls).verify(path, path[0], path[-1]), Failure.CONDITION, 199)
