"""FMT*'s tree is what brute force says, one sample after the other or in groups, and as late samples join."""

import numpy as np
import pytest

from pipeline.planners import fmt
from pipeline.planners.fmt import _CLOSED, _OPEN, _Wave
from tests.manifolds.spaces import sphere_space
from tests.robots.worlds import block, on_sphere


def marched(space, points, wave, heuristic=False, tree=None) -> tuple[dict, dict, set, int]:
    """Costs and parents by FMT*, as its paper has it, over the wave's neighbours: one sample after the other.

    A `tree` of its own (costs, parents and blocked edges, which grow) is gone on with from the samples beside new ones.
    """
    ahead = np.linalg.norm(points - points[1], axis=1) if heuristic else np.zeros(len(points))
    near = [set(row.tolist()) for row in wave.neighbours]
    cost, parent, blocked, old = tree or ({0: 0.0}, {}, set(), 0)
    new = set(range(old, len(points)))
    front = {z for z in cost if near[z] & new or any(z in near[x] for x in new)} if old else {0}
    reached = set(cost)
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
    return cost, parent, blocked, len(points)


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
    cost, parent, _, _ = marched(space, points, trees[0.0], heuristic)
    assert 150 < len(cost) and len({y for y in parent.values()}) > 50
    assert {x: int(y) for x, y in enumerate(trees[0.0].parent) if y >= 0} == parent
    np.testing.assert_allclose([trees[0.0].cost[x] for x in cost], list(cost.values()))
    for group in (0.25, 0.5):
        wave = trees[group]
        both = [x for x in cost if np.isfinite(wave.cost[x])]
        assert len(both) > 0.98 * len(cost)
        assert np.mean([wave.cost[x] / cost[x] for x in both if x]) < 1.02


def test_edges_asked_along_leave_the_tree_as_it_is(monkeypatch):
    """However many edges of a sample are asked at once, it joins by the first that holds."""
    rng = np.random.default_rng(9)
    space = sphere_space("projection", [block(p, (0.2, 0.2, 0.2)) for p in on_sphere(rng, 60)])
    points = np.array([q for q in on_sphere(rng, 900) if space.validity.free(q)][:300])
    parents, calls = [], []
    for along in (1, 2, 4):
        monkeypatch.setattr(fmt, "_ALONG", along)
        wave, connect, asked = _Wave(space, points, 1.1, False, 0.5), _Wave._connect, []
        monkeypatch.setattr(
            _Wave, "_connect", lambda self, y, x, c=connect, n=asked: (n.append(len(x)), c(self, y, x))[1]
        )
        while wave.alive:
            wave.advance()
        monkeypatch.setattr(_Wave, "_connect", connect)
        parents.append(wave.parent.tolist())
        calls.append(len(asked))
    assert parents[0] == parents[1] == parents[2] and sum(y >= 0 for y in parents[0]) > 150
    assert calls[0] > calls[1] > calls[2]


@pytest.mark.parametrize("heuristic", [False, True])
def test_tree_goes_on_with_late_samples(heuristic):
    """Late samples continue FMT* from the samples beside them, to the last edge, and leave the tree there was."""
    rng = np.random.default_rng(7)
    space = sphere_space("projection", [block(p, (0.2, 0.2, 0.2)) for p in on_sphere(rng, 60)])
    points = np.array([q for q in on_sphere(rng, 900) if space.validity.free(q)][:320])
    wave, tree, counts = _Wave(space, points[:60], 1.1, heuristic, 0.0), None, []
    for end in (60, 61, 120, 320):
        if end > 60:
            before = {x: int(y) for x, y in enumerate(wave.parent) if y >= 0}
            assert not wave.alive
            wave.extend(points[wave.count : end])
        while wave.alive:
            wave.advance()
        tree = marched(space, points[:end], wave, heuristic, tree)
        found = {x: int(y) for x, y in enumerate(wave.parent) if y >= 0}
        assert found == tree[1]
        np.testing.assert_allclose([wave.cost[x] for x in tree[0]], list(tree[0].values()))
        assert end == 60 or before.items() <= found.items()
        counts.append(len(found))
    assert counts[0] < counts[2] < counts[3] and counts[3] > 150


@pytest.mark.parametrize("sizes", [(3, 1, 1), (10, 7, 60), (40, 60, 1)])
def test_everyone_knows_the_nearest_of_all(sizes):
    """After every batch each sample knows its k nearest, with their distances, or all where there are fewer."""
    rng = np.random.default_rng(0)
    points, end = on_sphere(rng, sum(sizes)), 0
    wave = None
    for size in sizes:
        end += size
        if wave is None:
            wave = _Wave(sphere_space("projection"), points[:end], 1.1, False, 0.25)
        else:
            wave.extend(points[end - size : end])
        k = min(int(np.ceil(2.2**2 * np.e / 2 * np.log(end))), end - 1)
        gaps = np.linalg.norm(points[:end, None] - points[None, :end], axis=2)
        np.fill_diagonal(gaps, np.inf)
        assert wave.neighbours.shape == wave.distances.shape == (end, k)
        np.testing.assert_allclose(np.sort(wave.distances, axis=1), np.sort(gaps, axis=1)[:, :k])
        np.testing.assert_allclose(np.take_along_axis(gaps, wave.neighbours, axis=1), wave.distances)
        np.testing.assert_array_equal(wave.q, points[:end])
