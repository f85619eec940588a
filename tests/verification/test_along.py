"""What holds at points of a path is proven between them exactly where closed forms say that it holds there."""

import numpy as np
import pytest
from arms import BAXTER, PANDA, known

from pipeline.verification.along import bend_of_mass, equations, inequality


def circle(count: int, first: float = 0.0, last: float = 1.5) -> np.ndarray:
    angle = np.linspace(first, last, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def radius(Q: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(Q, axis=1)[:, None] - 1)


@pytest.mark.parametrize("spacing", [0.02, 0.05, 0.3, 1.0])
def test_chords_of_a_circle(spacing):
    """A chord of a unit circle is 1 - cos(spacing / 2) inside it at most: within a tolerance a little above that."""
    path = circle(int(1.5 / spacing) + 2)
    angle = 1.5 / (len(path) - 1)
    off = 1 - np.cos(angle / 2)
    sound, broken = equations(radius, path, 1.01 * off), equations(radius, path, 0.99 * off)
    assert sound.chord is None and not sound.sampled
    assert broken.chord == 0 and broken.worst == pytest.approx(off, rel=0.02)


def test_the_first_chord_that_leaves_is_named():
    """Of several chords that leave the manifold, the first is named, also where it leaves by less."""
    path = np.concatenate([circle(60, 0, 1.0), circle(4, 1.2, 2.5)])
    assert equations(radius, path, 1e-3).chord == 59


def test_a_kink_between_points_is_not_overlooked():
    """What is cut off at 0, and bends as a point 2 m from an axis does, is seen however short its way out is."""
    path = np.array([[0.0], [0.08]])
    for at in np.linspace(0.003, 0.077, 41):
        for tolerance in (1e-3, 1e-5):
            held = equations(lambda Q, at=at, t=tolerance: np.maximum(0.0, 1.05 * t - (Q - at) ** 2), path, tolerance)
            assert held.chord == 0 or held.sampled == {0}


def test_inequality_with_its_bow():
    """A parabola that dips below 0 between two points is found; one that stays above by a hair is proven."""
    path = np.array([[0.0], [1.0]])
    for low, holds in ((1e-5, True), (-1e-5, False)):
        held = inequality(lambda Q, low=low: (Q[:, 0] - 0.37) ** 2 + low, lambda steps: 2 * steps[:, 0] ** 2, path)
        assert (held.chord is None) == holds
        assert not held.sampled


@pytest.mark.parametrize("robot", [PANDA, BAXTER], ids=lambda robot: robot.name)
def test_bow_of_the_centre_of_mass(robot):
    """The bound of |c''| is above second differences of the centre of mass along random chords."""
    kinematics = known(robot)[0]
    bend, rng = bend_of_mass(kinematics), np.random.default_rng(0)
    for step in (0.05, 0.5):
        for _ in range(20):
            q = rng.uniform(kinematics.lower, kinematics.upper)
            way = step * rng.normal(size=len(q)) / np.sqrt(len(q))
            c = kinematics.centre_of_mass(q + np.linspace(0, 1, 101)[:, None] * way)
            measured = np.linalg.norm(np.diff(c, n=2, axis=0), axis=1).max() * 100**2
            assert measured <= bend(way[None])[0] * (1 + 1e-6)
