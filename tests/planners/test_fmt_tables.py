"""FMT*'s tables of neighbours stay what brute force says while samples join, one by one or many at once."""

import numpy as np
import pytest

from pipeline.planners.fmt import _CLOSED, _OPEN, _UNVISITED, _Wave
from tests.manifolds.spaces import sphere_space
from tests.robots.worlds import block, on_sphere


@pytest.mark.parametrize("size", [1, 7, 60])
def test_tables_grow_with_late_samples(size):
    """Every sample knows its k nearest at the time it came and all later ones it was nearest to, with distances."""
    rng = np.random.default_rng(0)
    space = sphere_space("projection")
    first, late = on_sphere(rng, 40), on_sphere(rng, 120)
    wave = _Wave(space, first, 1.1, False)
    while wave.front:
        wave.advance()
    assert (wave.state[:40] == _CLOSED).all()
    known = {i: set(wave.neighbours[i].tolist()) for i in range(40)}
    for begin in range(0, len(late), size):
        wave.join(late[begin : begin + size])
    for x, q in enumerate(late, start=40):
        distances = np.linalg.norm(wave.q[:x] - q, axis=1)
        near = np.argsort(distances)[: wave.k].tolist()
        known[x] = set(near)
        for i in near:
            known[i].add(x)
    assert wave.count == 160
    for i in range(160):
        row, gaps = wave.neighbours[i], wave.distances[i]
        filled = row >= 0
        assert set(row[filled].tolist()) == known[i]
        np.testing.assert_allclose(gaps[filled], np.linalg.norm(wave.q[row[filled]] - wave.q[i], axis=1))
        assert np.isinf(gaps[~filled]).all()
    assert wave.state[-1] == _CLOSED
    assert np.isinf(wave.reach[-1])
    assert (wave.state[160:-1] == _UNVISITED).all()
    assert (wave.state[40:160] == _OPEN).all()


def test_late_samples_hang_from_the_cheapest_neighbour_they_reach():
    """Among obstacles a late sample's parent is, of its cheapest closed neighbours, the first with a free edge."""
    rng = np.random.default_rng(2)
    space = sphere_space("projection", [block(p, (0.2, 0.2, 0.2)) for p in on_sphere(rng, 60)])
    points = [q for q in on_sphere(rng, 900) if space.validity.free(q)]
    wave = _Wave(space, np.array(points[:200]), 1.1, False)
    while wave.front:
        wave.advance()
    closed, late = np.flatnonzero(wave.state[:200] == _CLOSED), np.array(points[200:])
    wave.join(late)
    tried, x = [0] * 6, 199
    for q in late:
        near = np.argsort(np.linalg.norm(wave.q[:200] - q, axis=1))[: wave.k]
        if not np.isin(near, closed).any():
            continue
        x += 1
        np.testing.assert_array_equal(wave.q[x], q)
        near = wave.neighbours[x][: wave.k]
        tree = near[np.isin(near, closed)]
        gaps = np.linalg.norm(wave.q[tree] - q, axis=1)
        order = tree[np.argsort(wave.cost[tree] + gaps, kind="stable")][:5]
        free = [bool(space.screen(wave.q[y][None], q[None])[0][0]) for y in order]
        if any(free):
            assert wave.parent[x] == order[free.index(True)]
            assert wave.cost[x] == pytest.approx(
                wave.cost[wave.parent[x]] + space.screen(wave.q[wave.parent[x]][None], q[None])[1][0]
            )
            tried[free.index(True)] += 1
        else:
            assert wave.state[x] == _UNVISITED and wave.parent[x] == -1
            tried[5] += 1
    assert x == wave.count - 1
    assert tried[0] > 20 and sum(tried[1:5]) > 20 and tried[5] > 20
