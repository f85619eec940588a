"""Shortcuts make paths shorter, never longer, and keep them sound."""

import numpy as np
import pytest

from pipeline.planners import path_length, shortcut
from tests.manifolds.spaces import METHODS, sphere_space
from tests.planners.scenes import LONG, PLANNERS, assert_sound, plated, scene, solve, space_of


@pytest.mark.parametrize("method", METHODS)
def test_shorter_and_sound(method):
    """Shortcut paths have the ends of the old ones and are as sound; more attempts leave them no longer than fewer."""
    shortened = 0
    for seed in (0, 1, 2):
        s = scene(seed, 1.2)
        space = space_of(method, s)
        path = solve(PLANNERS["rrt"], space, s).path
        lengths = [path_length(path)]
        for attempts in (5, 40):
            after = shortcut(space, path, np.random.default_rng(1), attempts)
            assert_sound(after, s)
            assert np.linalg.norm(np.diff(after, axis=0), axis=1).min() > 0
            lengths.append(path_length(after))
        # The first five of forty attempts are the same ones.
        assert (np.diff(lengths) <= 1e-12).all()
        shortened += lengths[2] < 0.95 * lengths[0]
    assert shortened >= 2


@pytest.mark.parametrize("method", METHODS)
def test_detour_becomes_the_geodesic(method):
    """A detour over the pole of an empty sphere comes down to within 2 % of the great circle below it."""
    a, b, pole = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    space = sphere_space(method)
    path = np.vstack([a, space.traverse(a, pole).states, space.traverse(pole, b).states])
    path = space.refine(path).states
    after = shortcut(space, path, np.random.default_rng(0), 150)
    assert path_length(path) > 1.9 * np.pi / 2
    assert path_length(after) < 1.02 * np.pi / 2
    np.testing.assert_array_equal(after[[0, -1]], [a, b])


def test_nothing_to_shorten():
    """No attempts, or a path of three states or fewer, leave the path as it is; the same seed makes the same cuts."""
    s = scene(0, 1.2)
    space = space_of("projection", s)
    path = solve(PLANNERS["rrt"], space, s).path
    np.testing.assert_array_equal(shortcut(space, path, np.random.default_rng(0), 0), path)
    np.testing.assert_array_equal(shortcut(space, path[:3], np.random.default_rng(0), 50), path[:3])
    one, two = (shortcut(space, path, np.random.default_rng(3), 20) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_shortcuts_that_do_not_hold_are_left_out():
    """Where walks pass under plates that the way on the sphere hits, shortcut paths are as free as before."""
    s = plated()
    space, walks = space_of("projection", s, **LONG), []
    path = solve(PLANNERS["rrt"], space, s).path
    refine = space.refine
    space.refine = lambda states: walks.append(refine(states)) or walks[-1]
    after = shortcut(space, path, np.random.default_rng(0), 100)
    assert any(walk.invalid is not None for walk in walks) and any(walk.invalid is None for walk in walks)
    assert_sound(after, s, leap=0.8)
    assert path_length(after) < path_length(path)
