"""The finer walk finds what a coarser one stepped over, says in which segment, and leaves sound states as they are."""

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.robots import Validity
from tests.manifolds.spaces import METHODS, arm_world, blocks, make, sphere_space
from tests.planners.scenes import chords
from tests.robots.worlds import ball, ball_clearance, block, on_sphere, plate


def arc(count: int = 29, last: float = 1.4) -> np.ndarray:
    """States on the equator, 0.05 apart."""
    angle = np.linspace(0, last, count)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


@pytest.mark.parametrize("method", METHODS)
def test_sound_states_pass_unchanged(method):
    """States on the manifold come back to the last bit, with no segment found; also a single one and a standstill."""
    space = sphere_space(method)
    for states in (arc(), arc()[:1], arc()[[3, 3, 3]]):
        refined = space.refine(states)
        assert refined.invalid is None
        np.testing.assert_array_equal(refined.states, states)


@pytest.mark.parametrize("method", METHODS)
def test_states_are_brought_onto_the_manifold(method):
    """States beside the manifold, as the tangent bundle walks them, come back to the nearest point, the ends stay."""
    space, rng = sphere_space(method), np.random.default_rng(0)
    off = np.append(rng.uniform(-0.01, 0.01, 28), 9e-4)
    off[0] = -9e-4
    states = arc() * (1 + off[:, None])
    refined = space.refine(states)
    assert refined.invalid is None
    assert np.abs(np.linalg.norm(refined.states, axis=1) - 1).max() < 1e-3
    moved = np.abs(off) >= 0.25e-3
    moved[[0, -1]] = False
    kept = refined.states[np.linalg.norm(refined.states[:, None] - arc()[None], axis=2).argmin(axis=0)]
    np.testing.assert_allclose(kept[moved], arc()[moved], atol=1e-9)
    np.testing.assert_array_equal(kept[~moved], states[~moved])


@pytest.mark.parametrize("method", METHODS)
def test_chords_are_within_the_tolerance(method):
    """Long steps get states put in until the straight lines between them are within the tolerance, also at the ends."""
    space = sphere_space(method, step=0.4, wander=3.0)
    states = arc(5, 1.6) * np.array([1 + 9.5e-4, 1, 1, 1, 1 - 9.5e-4])[:, None]
    refined = space.refine(states)
    assert refined.invalid is None and len(refined.states) > len(states)
    assert np.abs(np.linalg.norm(chords(refined.states, 1e-4), axis=1) - 1).max() < 1e-3
    np.testing.assert_array_equal(refined.states[[0, -1]], states[[0, -1]])


@pytest.mark.parametrize("segment", [0, 1, 14, 27])
def test_thin_plate_between_two_states(segment):
    """A plate across one segment, free at both its ends, is found in that segment, whatever the direction."""
    states = arc()
    p, q = states[segment : segment + 2]
    obstacle = plate((p + q) / 2, q - p, (0.2, 0.2, 0.002))
    space = sphere_space("projection", [obstacle])
    assert ball_clearance([obstacle], states).min() > 0.005
    assert space.refine(states).invalid == segment
    assert space.refine(states[::-1]).invalid == 27 - segment


def test_contact_on_the_chords_that_are_written():
    """A path is judged where it is written: a plate above a long chord, which its states then reach, is found."""
    states = np.array([[np.cos(a), np.sin(a), 0.0] for a in (-0.2, 0.2)])  # the chord's middle is 0.02 below the arc
    above, below = block([1.0, 0.0, 0.0], (0.05, 0.05, 0.004)), block([0.981, 0.0, 0.0], (0.05, 0.05, 0.004))
    for obstacle, found in ((above, 0), (below, None)):
        assert sphere_space("projection", [obstacle], step=0.4, wander=1.5).refine(states).invalid == found


def test_bounds_between_states():
    """Between two states within a limit the manifold bends beyond it: the path follows the limit where it can."""
    states = np.array([[np.sin(a), 0.0, np.cos(a)] for a in (-0.2, 0.2)])
    for high, found in ((0.99, 0), (1.01, None), (0.9995, None)):
        space = sphere_space("projection", upper=(1.5, 1.5, high), step=0.4)
        refined = space.refine(states)
        assert refined.invalid == found
        assert found is not None or refined.states[:, 2].max() <= high


def sheets(gap: float) -> ProjectionAdherence:
    """Two planes, z = 0 and z = gap."""
    q = ca.SX.sym("q", 3)
    return ProjectionAdherence(
        Constraint("sheets", q, q[2] * (q[2] - gap), tolerance=1e-6), Validity(ball(), []), AdherenceParameters()
    )


@pytest.mark.parametrize("gap", [0.03, 0.1])
def test_jump_between_two_sheets(gap):
    """States that change from one sheet of a manifold to another are found where they do."""
    x = 0.01 * np.arange(12)
    states = np.stack([x, np.zeros(12), np.where(np.arange(12) > 6, gap, 0.0)], axis=1)
    assert sheets(gap).refine(states).invalid == 6
    assert sheets(gap).refine(states[:7]).invalid is None
    assert sheets(gap).refine(states[7:]).invalid is None


@pytest.mark.parametrize("index, segment", [(0, 0), (5, 4), (28, 27)])
def test_state_that_finds_no_manifold(index, segment):
    """A state that no projection brings back, such as the sphere's centre, is found in the segment that ends in it."""
    states = arc()
    states[index] = 0.0
    assert sphere_space("projection").refine(states).invalid == segment


@pytest.mark.parametrize("method", METHODS)
def test_verdict_is_that_of_a_closed_form(method):
    """Among random blocks the first failing segment is the first that touches one."""
    rng, verdicts = np.random.default_rng(4), []
    obstacles = blocks(rng, on_sphere(rng, 10))
    space = sphere_space(method, obstacles)
    for _ in range(40):
        a, b = on_sphere(rng, 2)
        b = b - (a @ b) * a
        angle = np.arange(0, 1.5, 0.049)[:, None]
        states = np.cos(angle) * a + np.sin(angle) * b / np.linalg.norm(b)
        if ball_clearance(obstacles, states[0])[0] < 0.01:
            continue
        fine = np.arange(0, angle[-1, 0], 0.0005)[:, None]
        clearance = ball_clearance(obstacles, np.cos(fine) * a + np.sin(fine) * b / np.linalg.norm(b))
        # Contact must be found, up to what chords lie below their arcs; what is clear of contact must not.
        sure, possible = fine[clearance < -5e-4, 0], fine[clearance < 7e-4, 0]
        found = space.refine(states).invalid
        verdicts.append(found is None)
        if len(sure):
            assert found is not None and found <= sure[0] // 0.049
        if found is not None:
            assert len(possible) and possible[0] <= angle[found + 1, 0]
    assert 0.1 < np.mean(verdicts) < 0.9


@pytest.mark.parametrize("method", METHODS)
def test_walks_of_an_arm_hold_up(method):
    """The finer walk passes what a walk of an arm without obstacles has reached, onto the manifold and a leap apart."""
    constraint, validity, world, q0 = arm_world(6, tolerance=1e-3)
    space, rng, passed = make(method, constraint, validity, lookahead=3), np.random.default_rng(8), 0
    for _ in range(6):
        a, b = (constraint.project(q0 + rng.normal(scale=0.15, size=13)).q for _ in range(2))
        walk = space.traverse(a, b)
        if walk.reached:
            refined = space.refine(np.vstack([a, walk.states]))
            assert refined.invalid is None
            assert max(np.linalg.norm(world.value(q)) for q in chords(refined.states, 0.005)) < 1e-3
            assert np.linalg.norm(np.diff(refined.states, axis=0), axis=1).max() <= 0.1
            np.testing.assert_array_equal(refined.states[[0, -1]], [a, b])
            passed += 1
    assert passed >= 3
