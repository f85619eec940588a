"""Balance and mazes along whole paths, against dense looks."""

import numpy as np
import pytest
from arms import PANDA, known

from pipeline.spec.statement import Balanced, Mazed, Point, Statement
from pipeline.verification.keeping import Balance, Walls
from pipeline.verification.reader import read

FAR = 5.0  # [m]


def half_plane(normal: np.ndarray, offset: float) -> tuple[tuple[float, ...], ...]:
    """A square of which one edge has the points p with normal @ p = offset, the inside where it is more."""
    along = np.array([-normal[1], normal[0]])
    near, far = normal * offset, normal * (offset + FAR)
    return tuple((*(point + side * FAR * along), 0.0) for point in (near, far) for side in (-1, 1))


@pytest.mark.parametrize("step", [0.1, 0.8])
@pytest.mark.parametrize("slack", [-1e-3, -1e-4, -1e-6, 1e-6, 1e-4, 5e-3])
def test_balance_near_an_edge(step, slack):
    """A centre of mass that comes within millimetres or microns of an edge, between states too, is judged rightly."""
    kinematics, rng = known(PANDA)[0], np.random.default_rng(0)
    for _ in range(10):
        ends = rng.uniform(kinematics.lower / 2, kinematics.upper / 2, (2, 7))
        path = np.linspace(ends[0], ends[0] + step * (ends[1] - ends[0]), 4)
        dense = kinematics.centre_of_mass(path[0] + np.linspace(0, 1, 3001)[:, None] * (path[-1] - path[0]))[:, :2]
        normal = np.array([np.cos(angle := rng.uniform(0, 2 * np.pi)), np.sin(angle)])
        place = (dense @ normal).min() - slack
        held = Balance(Balanced(half_plane(normal, place)), kinematics).held(path)
        assert (held.chord is None) == (slack > 0) or (held.sampled and 0 > slack > -1e-5)
        assert slack < 1e-5 or not held.sampled
        margin = Balance(Balanced(half_plane(normal, place), margin=0.01), kinematics).held(path)
        assert margin.chord is not None


def test_a_margin_moves_the_edge():
    """A margin is as good as a polygon that is smaller by it."""
    kinematics = known(PANDA)[0]
    q = np.array([[0, 0.3, 0, -1.5, 0, 1.5, 0]])
    square = tuple((x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5))
    plain, narrower = (Balance(Balanced(square, margin), kinematics).slack(q)[0] for margin in (0.0, 0.03))
    over = kinematics.centre_of_mass(q)[0, :2]
    assert plain == pytest.approx(0.5 - np.abs(over).max(), abs=1e-12)
    assert plain - narrower == pytest.approx(0.03, abs=1e-12)


def test_random_chords_in_random_pictures():
    """A chord over bright pixels only is proven, one over a dark pixel is not, as thousands of points on it show."""
    rng, seen = np.random.default_rng(1), {True: 0, False: 0}
    kinematics = read(Statement(Point(0.001, (-4.0,) * 3, (4.0,) * 3), (), 1e-3))
    for _ in range(200):
        dark = rng.random((24, 40)) < 0.02
        walls = Walls(Mazed(dark, 2.0, 1.0), kinematics)
        tube, around = rng.uniform(-np.pi, np.pi, 2)
        angles = np.stack([tube + np.linspace(0, rng.normal(), 30), around + np.linspace(0, rng.normal(), 30)], axis=1)
        ring = 2 + np.cos(angles[:, 0])
        path = np.stack([ring * np.cos(angles[:, 1]), ring * np.sin(angles[:, 1]), np.sin(angles[:, 0])], axis=1)
        dense = path[:-1] + np.linspace(0, 1, 200)[:, None, None] * np.diff(path, axis=0)
        x, y, z = np.moveaxis(dense, -1, 0)
        row = np.arctan2(z, np.hypot(x, y) - 2) / (2 * np.pi) * 24
        column = np.arctan2(y, x) / (2 * np.pi) * 40
        bright = ~dark[np.floor(row).astype(int) % 24, np.floor(column).astype(int) % 40]  # (200, 29)
        held = walls.held(path)
        if bright.all():
            assert held.chord is None and not held.sampled
        else:
            first = int(np.argmin(bright.all(axis=0)))
            assert held.chord is not None and held.chord <= first
        seen[held.chord is None] += 1
    assert min(seen.values()) > 20
