"""Samplers made of others ask each as they say, count once, and give what those give."""

import numpy as np
import pytest

from pipeline.errors import ConfigError
from pipeline.manifolds import Adherence
from pipeline.samplers import Asked, Mixture, Queue, Sampler, Then, UniformSampler
from tests.manifolds.spaces import sphere_space

POLES = np.eye(3)[2], -np.eye(3)[2]


class Marked(Sampler):
    """Gives what nobody else gives: rows of one number; and takes its time."""

    def __init__(self, mark: float, batch: int = 4, lands: bool = True, informed: bool = False) -> None:
        self.mark, self.batch, self.lands, self.informed, self.calls = mark, batch, lands, informed, []

    def draw(self, current, target):
        self.calls.append(len(current))
        self.network_time += 1.0
        return np.full_like(current, self.mark)


def bound(sampler: Sampler, seed: int = 0) -> tuple[Sampler, Adherence]:
    space = sphere_space("projection")
    sampler.begin(Asked(space, *POLES), np.random.default_rng(seed))
    return sampler, space


def ask(sampler: Sampler, count: int) -> np.ndarray:
    return sampler.sample(np.zeros((count, 3)), np.ones((count, 3)))


def test_then():
    """The first answers its calls, of both kinds, the second all others, which count as fallback samples."""
    for _ in range(2):
        first, second = Marked(1.0, batch=7, informed=True), Marked(2.0, lands=False)
        sampler, space = bound(Then(first, 3, second))
        assert not sampler.lands  # not all that it gives will
        marks = []
        for i in range(6):
            assert sampler.informed == (i < 3) and sampler.batch == 7  # both describe the one that is asked next
            marks.append(float((sampler.cover(7) if i % 2 else ask(sampler, 5))[0, 0]))
            assert sampler.lands == (i < 3)  # it describes what was given: planners look when they have it
        assert marks == [1.0] * 3 + [2.0] * 3
        assert (space.counters.samples, space.counters.fallback_samples) == (5 + 7 + 5 + 7 + 5 + 7, 7 + 5 + 7)
        assert sampler.network_time == 6.0
        sampler.begin(Asked(space, *POLES), np.random.default_rng(0))
        assert float(ask(sampler, 1)[0, 0]) == 1.0 and sampler.network_time == 1.0


def test_mixture_keeps_its_shares():
    """Calls go to each sampler by its share, by the problem's own stream; what they give is counted once."""
    samplers = [Marked(float(i)) for i in range(3)]
    mixture, space = bound(Mixture(samplers, (0.5, 0.3, 0.2)), seed=3)
    marks = [float(ask(mixture, 2)[0, 0]) for _ in range(2000)]
    counts = np.bincount(np.array(marks, int), minlength=3)
    np.testing.assert_allclose(counts / 2000, (0.5, 0.3, 0.2), atol=5 * 0.5 / 2000**0.5)
    assert space.counters.samples == 4000 and mixture.network_time == 2000
    again, _ = bound(Mixture([Marked(float(i)) for i in range(3)], (0.5, 0.3, 0.2)), seed=3)
    assert [float(ask(again, 2)[0, 0]) for _ in range(50)] == marks[:50]
    assert float(mixture.cover(1)[0, 0]) in (0.0, 1.0, 2.0)


@pytest.mark.parametrize(
    ("samplers", "shares", "message"),
    [
        ([Marked(0)], (0.5, 0.5), "1 samplers and 2 shares"),
        ([], (), "0 samplers"),
        ([Marked(0), Marked(1)], (0.5, 0.6), "must add up to 1"),
        ([Marked(0), Marked(1)], (1.5, -0.5), "sampler.shares is 1.5"),
        ([Marked(0), Marked(1, lands=False)], (0.5, 0.5), "some are not"),
    ],
)
def test_wrong_mixtures(samplers, shares, message):
    """Shares that do not fit, and samplers of which some land and some do not, are refused."""
    with pytest.raises(ConfigError, match=message):
        Mixture(samplers, shares)


def test_queue_hands_out_what_was_drawn():
    """A queue draws so many at once, hands them out in their order, none twice, and is refilled when empty."""
    source = UniformSampler(block=1)
    drawn = []
    draw = source.draw
    source.draw = lambda current, target: drawn.append(draw(current, target)) or drawn[-1]
    queue, space = bound(Queue(source, 10), seed=5)
    found = np.concatenate([ask(queue, count) for count in (1, 3, 6, 2, 25)])
    assert [len(part) for part in drawn] == [10, 10, 17]
    np.testing.assert_array_equal(found, np.concatenate(drawn))
    assert space.counters.samples == 37
    assert len(queue.cover(8)) == 64  # as its source covers


@pytest.mark.parametrize("distance", [0.05, 0.4])
def test_near_is_near(distance):
    """Samples near a configuration are on the manifold, in all directions, within the distance but for the bend."""
    sampler, space = bound(UniformSampler())
    Q = np.repeat(np.eye(3)[:1], 4000, axis=0)
    found = sampler.near(Q, distance)
    assert len(found) == 4000 == space.counters.samples
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-3
    apart = np.linalg.norm(found - Q, axis=1)
    assert apart.max() < 1.2 * distance and np.median(apart) > 0.4 * distance
    np.testing.assert_allclose((found - Q)[:, 1:].mean(axis=0), 0, atol=5 * distance / 4000**0.5)
