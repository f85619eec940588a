"""The uniform sampler hands out the adherence method's samples, as many as asked for, from the problem's own stream."""

import numpy as np
import pytest

from pipeline.errors import ConfigError
from pipeline.manifolds import Adherence
from pipeline.samplers import Asked, Sampler, UniformSampler
from tests.manifolds.spaces import CHARTED, METHODS, sphere_space


def started(method: str, seed: int = 0, **settings) -> UniformSampler:
    space = sphere_space(method)
    space.anchor(np.array([0.0, 0.0, 1.0]))
    sampler = UniformSampler(**settings)
    return bound(sampler, space, seed)


def bound(sampler: UniformSampler, space: Adherence, seed: int, scene: str | None = None) -> UniformSampler:
    """Bind to a way from one pole to the other."""
    sampler.begin(Asked(space, np.eye(3)[2], -np.eye(3)[2], scene), np.random.default_rng(seed))
    return sampler


def ask(sampler: UniformSampler, count: int) -> np.ndarray:
    return sampler.sample(np.zeros((count, 3)), np.zeros((count, 3)))


@pytest.mark.parametrize("method", METHODS)
def test_as_many_as_asked_for_on_the_manifold(method):
    """One for one, K for K within a block, never more, on the sphere; all that were handed out are counted."""
    sampler, total = started(method), 0
    for count in (1, 1, 20, 3, 7, 33, 70):
        found = ask(sampler, count)
        assert len(found) == count or (method in CHARTED and 0 < len(found) < count and total >= 32)
        assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-3
        total += len(found)
        assert sampler.counters.samples == total


@pytest.mark.parametrize("method", METHODS)
def test_how_many_are_asked_for_at_a_time_does_not_matter(method):
    """Handed out one by one or by the dozen, the samples of a block are the same in the same order, none twice."""
    one = started(method, seed=3)
    single = np.concatenate([ask(one, 1) for _ in range(24)])
    dozens = started(method, seed=3)
    np.testing.assert_array_equal(single, np.concatenate([ask(dozens, 12) for _ in range(2)]))
    assert len(np.unique(single, axis=0)) == 24
    assert not np.array_equal(single[0], ask(started(method, seed=4), 1)[0])


def test_whatever_start_and_target():
    """The samples do not depend on where to go on from or to, and the sampler says so."""
    here, there = started("projection"), started("projection")
    np.testing.assert_array_equal(
        here.sample(np.ones((5, 3)), np.zeros((5, 3))), there.sample(np.zeros((5, 3)), -np.ones((5, 3)))
    )
    assert isinstance(here, Sampler) and not here.informed and here.batch == 64


@pytest.mark.parametrize("method", METHODS)
def test_start_forgets_the_last_problem(method):
    """Bound anew to the same problem and seed it begins from the start, dropping what was left of a block."""
    sampler = started(method, seed=5)
    first = ask(sampler, 3)
    sampler.adherence.reset()
    sampler.adherence.anchor(np.array([0.0, 0.0, 1.0]))
    bound(sampler, sampler.adherence, 5, "other scene")
    np.testing.assert_array_equal(ask(sampler, 3), first)
    assert sampler.asked.scene == "other scene" and sampler.counters.samples == 3


def test_covers_the_sphere_without_bias():
    """Projected samples of a centred cube lie in every octant equally often, and their mean is the centre."""
    samples = ask(started("projection", block=4000), 4000)
    octants = np.bincount(((samples > 0) @ [1, 2, 4]).astype(int), minlength=8)
    # Four standard deviations of a binomial distribution.
    assert np.abs(octants - 500).max() < 4 * np.sqrt(4000 * 7 / 64)
    assert np.abs(samples.mean(axis=0)).max() < 4 * np.sqrt(1 / 3 / 4000)


@pytest.mark.parametrize("method", CHARTED)
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_first_batch_around_current(method, share):
    """The share `around` of a first batch lies within reach of start and goal, by turns; all are counted.

    Of the others, from charts that have spread, most lie elsewhere.
    """
    space, ends = sphere_space(method, rho=0.3, exploration=0.5), np.eye(3)[[0, 1] * 500]
    space.anchor(np.array([0.0, 0.0, -1.0]))
    space.sample(np.random.default_rng(8), 2000)
    sampler = UniformSampler(around=share)
    sampler.begin(Asked(space, np.eye(3)[0], np.eye(3)[1]), np.random.default_rng(9))
    samples = sampler.cover(667)
    assert samples.shape == (1000, 3) and sampler.counters.samples == 1000
    heights = (samples * ends).sum(axis=1)  # over the tangent plane of the end that was given
    within = (np.sqrt(1 - np.minimum(heights, 1) ** 2) <= 0.3 / 0.5**0.5 + 1e-3) & (heights > 0)
    near = round(share * 1000)
    assert within[:near].all() and within[near:].sum() <= 0.3 * (1000 - near)


def test_without_charts_the_first_batch_is_as_any_other():
    """With projection a first batch is what `sample` gives of the same stream."""
    one, other = started("projection", seed=7), started("projection", seed=7)
    np.testing.assert_array_equal(one.cover(54), ask(other, 81))


@pytest.mark.parametrize("method", CHARTED)
def test_fewer_where_there_are_none(method):
    """Where the method finds no samples fewer come back, none at worst, and only those are counted."""
    sampler = UniformSampler()
    bound(sampler, sphere_space(method), 0)
    assert ask(sampler, 7).shape == (0, 3) and sampler.counters.samples == 0


@pytest.mark.parametrize("name", ["batch", "block"])
def test_parameters_are_checked(name):
    """A batch or block of none is refused with its name and value."""
    with pytest.raises(ConfigError, match=rf"sampler\.{name} is 0"):
        UniformSampler(**{name: 0})


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_share_is_checked(share):
    """A share outside 0 to 1 is refused with its name and value."""
    with pytest.raises(ConfigError, match=rf"sampler\.around is {share}"):
        UniformSampler(around=share)
