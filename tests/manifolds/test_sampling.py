"""Samples of a manifold are on it, within bounds, everywhere, and the same for the same seed."""

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.robots import Validity
from tests.manifolds.spaces import CHARTED, METHODS, arm_world, make, sphere_space
from tests.robots.worlds import ball


def anchored(method: str, **settings):
    space = sphere_space(method, **settings)
    space.anchor(np.array([0.0, 0.0, -1.0]))
    return space


@pytest.mark.parametrize("method", METHODS)
def test_on_the_manifold_and_within_bounds(method):
    """Every sample satisfies the constraint by its closed form and keeps the limits, also where these cut it off."""
    space = anchored(method, upper=(0.5, 1.5, 0.3))
    samples = space.sample(np.random.default_rng(0), 300)
    assert 30 < len(samples) <= 300
    assert np.abs(np.linalg.norm(samples, axis=1) - 1).max() < 1e-3
    assert (samples <= [0.5, 1.5, 0.3]).all() and (samples >= -1.5).all()


@pytest.mark.parametrize("method", METHODS)
def test_arm_samples(method):
    """Samples of an arm that holds its tool hold it, by pinocchio, and keep its joint limits."""
    constraint, validity, world, q0 = arm_world(6, tolerance=1e-3)
    space = make(method, constraint, validity, lookahead=1, **({"rho": 0.5} if method in CHARTED else {}))
    space.anchor(q0)
    samples = space.sample(np.random.default_rng(1), 60)
    assert 4 <= len(samples) <= 60
    assert max(np.linalg.norm(world.value(q)) for q in samples) < 1e-3
    assert (np.abs(samples) <= np.pi).all()


@pytest.mark.parametrize("method", METHODS)
def test_seed_decides(method):
    """A seed gives the same samples to the last bit, in a fresh space and after a reset; another gives others."""
    space = anchored(method)
    first = space.sample(np.random.default_rng(5), 50)
    again = anchored(method).sample(np.random.default_rng(5), 50)
    space.reset()
    space.anchor(np.array([0.0, 0.0, -1.0]))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, space.sample(np.random.default_rng(5), 50))
    assert not np.array_equal(first, anchored(method).sample(np.random.default_rng(6), 50))


@pytest.mark.parametrize("method", METHODS)
def test_everywhere(method):
    """From one chart on, samples come to lie in all 26 directions of the sphere's cells."""
    space, rng = anchored(method), np.random.default_rng(2)
    samples = np.concatenate([space.sample(rng, 100) for _ in range(10)])
    cells = {tuple(cell) for cell in np.round(samples).astype(int)} - {(0, 0, 0)}
    assert len(cells) == 26


@pytest.mark.parametrize("method", CHARTED)
def test_samples_of_one_chart_are_a_ball_lifted(method):
    """Samples of a chart fill its tangent ball of radius rho / (1 - exploration)^(1/d) evenly, lifted orthogonally."""
    space = anchored(method, rho=0.3, exploration=0.5, max_charts=2)
    space.anchor(np.array([1.0, 0.0, 0.0]))
    samples, radius = space.sample(np.random.default_rng(3), 600), 0.3 / 0.5**0.5
    near = np.minimum(
        np.hypot(samples[:, 0], samples[:, 1]), np.hypot(samples[:, 1], samples[:, 2])
    )  # |u| in its chart
    assert radius * 0.97 < near.max() <= radius * (1 + 1e-9)
    quantiles = np.quantile(near, [0.25, 0.5, 0.75])
    np.testing.assert_allclose(quantiles, radius * np.sqrt([0.25, 0.5, 0.75]), atol=0.03)
    assert {int(abs(q[2]) > 0.8) for q in samples} == {0, 1}


@pytest.mark.parametrize("method", CHARTED)
def test_samples_around_configurations(method):
    """However far charts have spread, samples around configurations fill the balls there, each as often as it stands.

    Only charts at these are made; 700 samples take several blocks.
    """
    space, rng = sphere_space(method, rho=0.3, exploration=0.5), np.random.default_rng(4)
    ends, radius = np.eye(3)[:2], 0.3 / 0.5**0.5
    space.anchor(np.array([0.0, 0.0, -1.0]))
    for _ in range(10):
        space.sample(rng, 64)
    charts = len(space.atlas)
    samples = space.sample_around(rng, ends[[0] * 500 + [1] * 200])
    assert len(samples) == 700 and len(space.atlas) <= charts + 2
    heights = samples @ ends.T  # (700, 2): over the tangent planes at the ends
    near = (np.linalg.norm(samples[:, None] - heights[:, :, None] * ends, axis=2) <= radius + 1e-9) & (heights > 0)
    assert near[:500, 0].all() and near[500:, 1].all()
    distances = np.linalg.norm(samples[:500] - heights[:500, :1] * ends[0], axis=1)
    np.testing.assert_allclose(
        np.quantile(distances, [0.25, 0.5, 0.75]), radius * np.sqrt([0.25, 0.5, 0.75]), atol=0.03
    )
    assert np.abs(np.linalg.norm(samples, axis=1) - 1).max() < 1e-3


def test_without_charts_around_is_everywhere():
    """Projection has no charts: its samples around configurations are those of the whole manifold."""
    space = sphere_space("projection")
    expected = space.sample(np.random.default_rng(5), 40)
    np.testing.assert_array_equal(space.sample_around(np.random.default_rng(5), np.eye(3)[[0] * 40]), expected)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [0, 4000])
def test_as_many_as_asked_for(method, count):
    """None or thousands: on the open sphere as many samples come back as were asked for."""
    space = anchored(method, **({"rho": 0.3} if method in CHARTED else {}))
    assert space.sample(np.random.default_rng(6), count).shape == (count, 3)


@pytest.mark.parametrize("method", CHARTED)
def test_nothing_to_sample(method):
    """Without a chart, or where all samples are out of bounds, none come back and nothing is raised."""
    assert sphere_space(method).sample(np.random.default_rng(0), 5).shape == (0, 3)
    q = ca.SX.sym("q", 3)
    cross = make(method, Constraint("cross", q, q[0] * q[1]), Validity(ball(), []))
    cross.anchor(np.zeros(3))  # no rank, no chart
    assert cross.sample(np.random.default_rng(0), 5).shape == (0, 3)
    assert cross.sample_around(np.random.default_rng(0), np.zeros((5, 3))).shape == (0, 3)
    outside = sphere_space(method, upper=(1.5, 1.5, -1.2))
    outside.anchor(np.array([0.0, 0.0, 1.0]))
    assert outside.sample(np.random.default_rng(0), 5).shape == (0, 3)


@pytest.mark.parametrize("method", METHODS)
def test_projection_leaves_out_what_does_not_fit(method):
    """Of given configurations those come back, in order, that project to within the bounds."""
    space = sphere_space(method, upper=(1.5, 1.5, 0.6))
    Q = np.array([[2.0, 0, 0], [0, 0, 0], [0.1, 0, 1.0], [np.nan, 0, 0], [0, -0.5, 0]])
    np.testing.assert_allclose(space.project(Q), [[1, 0, 0], [0, -1, 0]], atol=1e-9)
