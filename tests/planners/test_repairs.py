"""A path that the finer walk fails is taken apart where it fails, and the search goes on to one that holds."""

import numpy as np
import pytest

from pipeline.manifolds import Refined
from pipeline.planners import PlanStatus, path_length
from tests.manifolds.spaces import METHODS
from tests.planners.scenes import LONG, PLANNERS, Scene, arcs, assert_sound, plated, solve, space_of
from tests.robots.worlds import ball_clearance, block, on_sphere


def blind(q_from, q_to):
    """A screen that lets every edge pass: on the sphere it would see the plates."""
    return np.ones(len(q_from), bool), np.linalg.norm(q_to - q_from, axis=1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", PLANNERS)
def test_walks_that_pass_under_plates_are_repaired(planner, method, monkeypatch):
    """Where chords pass under plates that the way on the sphere hits, paths are repaired until they are free."""
    s, repairs = plated(), 0
    space = space_of(method, s, **LONG)
    monkeypatch.setattr(space, "screen", blind)
    for seed in range(4):
        result = solve(PLANNERS[planner], space, s, seed)
        assert result.solved
        assert_sound(result.path, s, leap=0.8)
        repairs += result.counters.repairs
    assert repairs > 0


@pytest.mark.parametrize("planner", PLANNERS)
def test_without_repairs_the_paths_would_hit(planner, monkeypatch):
    """The same search that trusts its walks returns paths that hit plates: the finer walk is what prevents it."""
    s = plated()
    space = space_of("projection", s, **LONG)
    monkeypatch.setattr(space, "refine", lambda states: Refined(states, None))
    monkeypatch.setattr(space, "screen", blind)
    hits = [ball_clearance(s.obstacles, arcs(solve(PLANNERS[planner], space, s, seed).path)).min() for seed in range(4)]
    assert min(hits) < 0


@pytest.mark.parametrize("planner", PLANNERS)
def test_coarse_checks_and_thin_plates(planner):
    """With no margin and a resolution of a whole step, thin plates that walks step over are found, and repaired."""
    rng = np.random.default_rng(1)
    start, goal = on_sphere(rng, 2)
    walls = [block(p, (0.02, 0.3, 0.2)) for p in on_sphere(rng, 60)]
    s = Scene(start, goal, tuple(o for o in walls if ball_clearance([o], np.stack([start, goal])).min() > 0.02))
    repairs = 0
    for method in METHODS:
        space = space_of(method, s, resolution=0.05, margin=0.0)
        for seed in range(3):
            result = solve(PLANNERS[planner], space, s, seed)
            assert result.solved
            assert_sound(result.path, s)
            repairs += result.counters.repairs
    assert repairs > 0


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_failure_is_counted_and_none_comes_back(planner, monkeypatch):
    """When the finer walk rejects its first ten paths there are ten repairs, and no rejected segment comes back."""
    s = Scene(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), ())
    space, rejected = space_of("projection", s), []
    refine = space.refine

    def rejecting(states):
        found = refine(states)
        assert found.invalid is None
        for segment in rejected:
            pairs = np.stack([found.states[:-1], found.states[1:]], axis=1)
            assert not (pairs == segment).all(axis=(1, 2)).any()
        if len(rejected) == 10:
            return found
        i = (len(states) // 3 + len(rejected)) % (len(states) - 1)
        rejected.append(states[i : i + 2].copy())
        return Refined(found.states, i)

    monkeypatch.setattr(space, "refine", rejecting)
    result = solve(PLANNERS[planner], space, s)
    assert result.solved and result.counters.repairs == 10
    assert_sound(result.path, s)


@pytest.mark.parametrize("planner", PLANNERS)
def test_no_path_that_never_holds(planner, monkeypatch):
    """When the finer walk rejects every path, wherever it fails, the search ends at its limit without one."""
    s = Scene(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8]), ())
    space, rng = space_of("projection", s), np.random.default_rng(0)
    refine = space.refine
    monkeypatch.setattr(
        space, "refine", lambda states: Refined(refine(states).states, int(rng.integers(len(states) - 1)))
    )
    result = solve(PLANNERS[planner], space, s, max_iterations=700)
    assert result.status is PlanStatus.ITERATION_LIMIT and path_length(result.path) == 0
    assert result.counters.repairs > 3
