"""FMT*'s tables of neighbours stay what brute force says while samples join one by one."""

import numpy as np

from pipeline.planners.fmt import _CLOSED, _UNVISITED, _Wave
from tests.manifolds.spaces import sphere_space
from tests.robots.worlds import on_sphere


def test_tables_grow_with_late_samples():
    """Every sample knows its k nearest at the time it came and all later ones it was nearest to, with distances."""
    rng = np.random.default_rng(0)
    space = sphere_space("projection")
    first, late = on_sphere(rng, 40), on_sphere(rng, 120)
    wave = _Wave(space, first, 1.1, False)
    while wave.front:
        wave.advance()
    assert (wave.state[:40] == _CLOSED).all()
    known = {i: set(wave.neighbours[i].tolist()) for i in range(40)}
    for x, q in enumerate(late, start=40):
        distances = np.linalg.norm(wave.q[:x] - q, axis=1)
        near = np.argsort(distances)[: wave.k].tolist()
        assert wave.join(q)
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
