"""FMT*'s tree is what brute force says, one sample after the other or in groups, and as late samples join."""

import numpy as np
import pytest

from pipeline.planners.fmt import _CLOSED, _OPEN, _UNVISITED, _Wave
from tests.manifolds.spaces import sphere_space
from tests.robots.worlds import block, on_sphere


def marched(space, points, wave, heuristic=False) -> tuple[dict[int, float], dict[int, int]]:
    """Costs and parents by FMT*, as its paper has it, over the wave's neighbours: one sample after the other."""
    ahead = np.linalg.norm(points - points[1], axis=1) if heuristic else np.zeros(len(points))
    near = [set(row.tolist()) for row in wave.neighbours]
    cost, parent, reached, blocked = {0: 0.0}, {}, {0}, set()
    front = {0}
    while front:
        z = min(front, key=lambda i: cost[i] + ahead[i])
        fresh = set()
        for x in sorted(near[z] - reached):
            y = min(near[x] & front or {z}, key=lambda i: cost[i] + np.linalg.norm(points[i] - points[x]))
            free, way = (a[0] for a in space.screen(points[y][None], points[x][None]))
            if free and (y, x) not in blocked:
                cost[x], parent[x] = cost[y] + way, y
                fresh.add(x)
            else:
                blocked.add((y, x))
        reached |= fresh
        front = front - {z} | fresh
    return cost, parent


@pytest.mark.parametrize("heuristic", [False, True])
def test_tree_of_fmt(heuristic):
    """With no width of the front the tree is that of FMT* to the last edge; with one it reaches as much, as cheaply."""
    rng = np.random.default_rng(4)
    space = sphere_space("projection", [block(p, (0.2, 0.2, 0.2)) for p in on_sphere(rng, 60)])
    points = np.array([q for q in on_sphere(rng, 900) if space.validity.free(q)][:300])
    trees = {}
    for group in (0.0, 0.25, 0.5):
        wave = _Wave(space, points, 1.1, heuristic, group)
        while wave.alive:
            wave.advance()
        trees[group] = wave
        assert (wave.state[:300] != _OPEN).all()
        assert (np.isfinite(wave.cost) == (wave.state[:300] == _CLOSED)).all()
    cost, parent = marched(space, points, trees[0.0], heuristic)
    assert 150 < len(cost) and len({y for y in parent.values()}) > 50
    assert {x: int(y) for x, y in enumerate(trees[0.0].parent) if y >= 0} == parent
    np.testing.assert_allclose([trees[0.0].cost[x] for x in cost], list(cost.values()))
    for group in (0.25, 0.5):
        wave = trees[group]
        both = [x for x in cost if np.isfinite(wave.cost[x])]
        assert len(both) > 0.98 * len(cost)
        assert np.mean([wave.cost[x] / cost[x] for x in both if x]) < 1.02


@pytest.mark.parametrize("size", [1, 7, 60])
@pytest.mark.parametrize("begun", [3, 10, 40])
def test_tables_grow_with_late_samples(begun, size):
    """Every sample knows its k nearest at the time it came and all later ones it was nearest to, with distances, also
    where there are fewer than k."""
    rng = np.random.default_rng(0)
    space = sphere_space("projection")
    first, late = on_sphere(rng, begun), on_sphere(rng, 120)
    wave = _Wave(space, first, 1.1, False, 0.25)
    assert wave.k < begun or begun < 40
    while wave.alive:
        wave.advance()
    closed = np.flatnonzero(wave.state[:begun] == _CLOSED)
    known = {i: set(wave.neighbours[i].tolist()) for i in range(begun)}
    for begin in range(0, len(late), size):
        wave.join(late[begin : begin + size])
    for x in range(begun, wave.count):
        distances = np.linalg.norm(wave.q[:x] - wave.q[x], axis=1)
        near = np.argsort(distances)[: wave.k].tolist()
        known[x] = set(near)
        for i in near:
            known[i].add(x)
    for i in range(wave.count):
        row, gaps = wave.neighbours[i], wave.distances[i]
        filled = row >= 0
        assert set(row[filled].tolist()) == known[i]
        np.testing.assert_allclose(gaps[filled], np.linalg.norm(wave.q[row[filled]] - wave.q[i], axis=1))
        assert np.isinf(gaps[~filled]).all()
    assert wave.state[-1] == _CLOSED
    assert np.isinf(wave.reach[-1])
    assert (wave.state[wave.count : -1] == _UNVISITED).all()
    if begun == 40:  # dense enough that nobody is left out or out of reach
        assert len(closed) == 40 and wave.count == 160
        assert (wave.state[40:160] == _OPEN).all()
    assert wave.count > begun + 20


def test_late_samples_hang_from_the_cheapest_neighbour_they_reach():
    """Among obstacles a late sample's parent is, of its cheapest closed neighbours, the first with a free edge."""
    rng = np.random.default_rng(2)
    space = sphere_space("projection", [block(p, (0.2, 0.2, 0.2)) for p in on_sphere(rng, 60)])
    points = [q for q in on_sphere(rng, 900) if space.validity.free(q)]
    wave = _Wave(space, np.array(points[:200]), 1.1, False, 0.25)
    while wave.alive:
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
