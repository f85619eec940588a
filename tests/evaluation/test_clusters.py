"""Intervals over scenes: coverage in simulation, resamples against enumeration, and what is refused."""

import itertools
from math import nan, sqrt

import numpy as np
import pytest
from scipy.stats import norm, t

from pipeline.errors import ConfigError
from pipeline.evaluation import Center, Comparison, Method, paired_interval, success_interval, wilson
from pipeline.evaluation.coverage import WORLDS, coverage


@pytest.mark.parametrize("center", Center)
@pytest.mark.parametrize("name", ["alike", "differ", "differ strongly", "other ratios"])
def test_intervals_hold_the_truth_at_ten_scenes(name, center):
    """At least 93 % of the 95 % intervals hold the true ratio, whether scenes differ or not; 200 data sets."""
    share = coverage(WORLDS[name], center, sets=200, resamples=150)
    assert share >= 0.93 - 2 * sqrt(0.93 * 0.07 / 200)  # two standard errors; `coverage` has the larger run


def test_problems_drawn_from_all_scenes_would_not():
    """The simulation tells good intervals from bad ones: without scenes fewer than 85 % hold the truth."""
    rng, world, hits = np.random.default_rng(1), WORLDS["differ strongly"], 0
    for _ in range(150):
        first, second, scenes = world.draw(10, 20, rng)
        alone = np.arange(len(scenes))  # every problem a scene of its own
        found = paired_interval(first, second, alone, Comparison.RATIO, resamples=150)
        hits += found.low <= world.ratio(Center.MEDIAN) <= found.high
    assert hits / 150 < 0.85


@pytest.mark.parametrize("center", Center)
def test_resamples_are_all_scenes_and_then_all_problems(center):
    """The deviation is that of all ways to draw scenes, and then problems within each, taken one by one."""
    scenes, x = [0, 0, 1, 1, 1], [1.0, 2.0, 5.0, 3.0, 9.0]
    of = np.median if center is Center.MEDIAN else np.mean
    members = {s: [v for v, at in zip(x, scenes, strict=True) if at == s] for s in (0, 1)}
    values, weights = [], []
    for drawn in itertools.product((0, 1), repeat=2):
        ways = [list(itertools.product(members[s], repeat=len(members[s]))) for s in drawn]
        for parts in itertools.product(*ways):
            values.append(of(np.concatenate(parts)))
            weights.append(1 / len(ways[0]) / len(ways[1]))
    mean = np.average(values, weights=weights)
    deviation = sqrt(np.average((np.array(values) - mean) ** 2, weights=weights))
    half = sqrt(2) * t.ppf(0.975, 1) * deviation
    found = paired_interval(x, [0.0] * 5, scenes, center=center, resamples=40_000)
    assert found.method is Method.SCENES and found.estimate == of(x)
    assert (found.high - found.low) / 2 == pytest.approx(half, rel=0.02)


def test_a_ratio_turned_around_has_the_inverse_interval():
    """Second over first is one over first over second, bounds included; units change neither."""
    x, y = np.random.default_rng(0).lognormal(size=(2, 40))
    scenes = np.repeat(list("abcd"), 10)
    one, other, scaled = (
        paired_interval(*sides, scenes, Comparison.RATIO) for sides in ((x, y), (y, x), (1e3 * x, 1e3 * y))
    )
    assert (1 / other.estimate, 1 / other.high, 1 / other.low) == pytest.approx((one.estimate, one.low, one.high))
    assert (scaled.estimate, scaled.low, scaled.high) == pytest.approx((one.estimate, one.low, one.high))


def test_the_order_of_pairs_and_names_of_scenes_matter_little():
    """Shuffled pairs under other names of scenes are other resamples of the same data."""
    x, y = np.random.default_rng(1).lognormal(size=(2, 60))
    scenes = np.repeat(np.arange(6), 10)
    order = np.random.default_rng(2).permutation(60)
    names = np.array(list("fedcba"))[scenes]
    one = paired_interval(x, y, scenes, Comparison.RATIO, resamples=20_000)
    other = paired_interval(x[order], y[order], names[order], Comparison.RATIO, resamples=20_000)
    assert (other.low, other.high) == pytest.approx((one.low, one.high), rel=0.03)


@pytest.mark.parametrize("scenes, method", [(np.zeros(400), Method.ONE_SCENE), (np.arange(400), Method.SCENES)])
def test_means_of_independent_pairs_are_students(scenes, method):
    """In one scene, or each in its own, the interval of normal differences is Student's paired one."""
    rng = np.random.default_rng(3)
    common = rng.normal(0, 50, 400)
    x, y = common + rng.normal(1.0, 1.0, 400), common + rng.normal(0.0, 1.0, 400)
    d = x - y
    half = t.ppf(0.975, 399) * d.std(ddof=1) / sqrt(400)
    found = paired_interval(x, y, scenes, center=Center.MEAN)
    assert found.method is method
    assert (found.low, found.high) == pytest.approx((d.mean() - half, d.mean() + half), abs=0.1 * half)


def test_interval_is_repeatable_and_seeded():
    """One seed gives one interval; another seed another one."""
    x, y = np.random.default_rng(0).lognormal(size=(2, 30))
    scenes = np.arange(30) % 3
    first, again, other = (paired_interval(x, y, scenes, center=Center.MEAN, seed=seed) for seed in (1, 1, 2))
    assert first == again != other


def test_equal_pairs_are_a_point_and_too_few_have_no_bounds():
    """Where all resamples agree the interval is what they agree on; one pair has an estimate alone, none nothing."""
    same = paired_interval([3.0] * 4, [1.0] * 4, [0, 0, 1, 1], Comparison.RATIO)
    assert (same.estimate, same.low, same.high) == (3, 3, 3)
    one, none = paired_interval([3.0], [2.0], [0]), paired_interval([], [], [])
    assert one.estimate == 1 and np.isnan([one.low, one.high]).all() and one.method is Method.NONE
    assert np.isnan([none.estimate, none.low, none.high]).all()


@pytest.mark.parametrize(
    "first, second, scenes, options, message",
    [
        ([1.0, 2.0], [1.0], [0, 1], {}, "2 values and second 1"),
        ([1.0, 2.0], [1.0, 2.0], [0], {}, "scenes has 1 values for 2 pairs"),
        ([1.0, nan], [1.0, 2.0], [0, 1], {}, "first holds 1 values of 2"),
        ([1.0, 2.0], [1.0, 0.0], [0, 1], {"comparison": Comparison.RATIO}, "above 0"),
        ([[1.0, 2.0]], [[1.0, 2.0]], [0], {}, "one dimension"),
        ([1.0, 2.0], [1.0, 2.0], [0, 1], {"confidence": 95}, "95"),
        ([1.0, 2.0], [1.0, 2.0], [0, 1], {"resamples": 0}, "resamples is 0"),
    ],
)
def test_interval_refuses_what_it_cannot_compare(first, second, scenes, options, message):
    """Unequal sizes, gaps and impossible ratios are errors that name the value."""
    with pytest.raises(ConfigError, match=message):
        paired_interval(first, second, scenes, **options)


def test_rates_of_scenes_that_differ_are_known_less_well():
    """The same count is known less well where scenes differ, and as Wilson says, by Student, where they are alike."""
    scenes = np.repeat(np.arange(10), 20)
    even = np.tile([True] * 15 + [False] * 5, 10)
    uneven = np.repeat([True] * 7 + [False] * 3, 20)
    uneven[140:150] = True
    assert even.sum() == uneven.sum() == 150
    p, q, n = 0.75, t.ppf(0.975, 9), 200
    half = q / (1 + q**2 / n) * sqrt(p * (1 - p) / n + q**2 / 4 / n**2)
    alike, apart = success_interval(even, scenes), success_interval(uneven, scenes)
    assert alike.high - alike.low == pytest.approx(2 * half)
    assert apart.high - apart.low > 2 * (alike.high - alike.low)


def test_rates_hold_the_truth_where_scenes_differ():
    """Of 1000 data sets with rates of scenes around 80 % (sd 13 %) at least 93 % of the intervals hold it."""
    rng, hits, plain = np.random.default_rng(4), 0, 0
    scenes = np.repeat(np.arange(10), 20)
    for _ in range(1000):
        solved = rng.random(200) < np.repeat(rng.beta(7.2, 1.8, 10), 20)
        found, bare = success_interval(solved, scenes), wilson(int(solved.sum()), 200)
        hits += found.low <= 0.8 <= found.high
        plain += bare.low <= 0.8 <= bare.high
    assert hits >= 930 and plain < 850


def test_all_solved_is_wilsons():
    """Where nothing tells how scenes differ the problems count as independent; none of them are any rate."""
    scenes = np.repeat(np.arange(10), 20)
    found, z = success_interval([True] * 200, scenes), norm.ppf(0.975)
    assert (found.low, found.high) == pytest.approx((200 / (200 + z**2), 1.0))
    assert success_interval([], []).high == 1 and np.isnan(success_interval([], []).estimate)
    with pytest.raises(ConfigError, match="scenes has 1 values for 2 problems"):
        success_interval([True, False], [0])
