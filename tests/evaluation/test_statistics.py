"""Intervals, tests and summaries against closed forms, enumeration and the standard library."""

import itertools
import statistics
from math import comb, nan, sqrt

import numpy as np
import pytest
from scipy.stats import norm, t

from pipeline.errors import ConfigError
from pipeline.evaluation import Center, Comparison, Method, mcnemar, paired_interval, summary, wilson


@pytest.mark.parametrize("successes, trials", [(0, 10), (3, 10), (10, 10), (487, 500), (1, 1)])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_wilson_is_its_closed_form(successes, trials, confidence):
    """The bounds are the roots of Wilson's (1927) score equation."""
    z, p = norm.ppf((1 + confidence) / 2), successes / trials
    centre = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2))
    found = wilson(successes, trials, confidence)
    assert (found.low, found.high) == pytest.approx((centre - half, centre + half), abs=1e-12)
    assert found.estimate == p and found.confidence == confidence and found.method is Method.WILSON


def test_wilson_without_trials_knows_nothing():
    """No trials: any rate is possible."""
    found = wilson(0, 0)
    assert np.isnan(found.estimate) and (found.low, found.high) == (0, 1)


@pytest.mark.parametrize("successes, trials, confidence", [(-1, 3, 0.95), (4, 3, 0.95), (1, 3, 0.0), (1, 3, 1.0)])
def test_wilson_refuses_impossible_counts(successes, trials, confidence):
    """Counts and confidence are checked, with the value in the message."""
    with pytest.raises(ConfigError, match=str(successes) if confidence == 0.95 else str(confidence)):
        wilson(successes, trials, confidence)


def _centre(values, center: Center) -> float:
    return statistics.median(values) if center is Center.MEDIAN else statistics.fmean(values)


def _compare(pairs, comparison: Comparison, center: Center) -> float:
    a, b = (_centre([pair[side] for pair in pairs], center) for side in (0, 1))
    return a - b if comparison is Comparison.DIFFERENCE else a / b


@pytest.mark.parametrize("comparison", Comparison)
def test_interval_is_efrons_bca_on_all_resamples(comparison):
    """Six pairs have 6^6 resamples: BCa (Efron 1987, eq. 2.3) on all of them is what sampling them approaches."""
    pairs = [(2.1, 1.0), (3.7, 2.2), (1.9, 2.5), (8.4, 3.1), (4.4, 4.0), (2.6, 1.3)]
    n, center = len(pairs), Center.MEAN
    every = np.sort([_compare(chosen, comparison, center) for chosen in itertools.product(pairs, repeat=n)])
    estimate = _compare(pairs, comparison, center)
    below = ((every < estimate).sum() + (every <= estimate).sum()) / 2 / len(every)
    z0 = norm.ppf(below)
    left = np.array([_compare(pairs[:i] + pairs[i + 1 :], comparison, center) for i in range(n)])
    d = left.mean() - left
    a = (d**3).sum() / (6 * (d**2).sum() ** 1.5)
    bounds = []
    for z in norm.ppf([0.025, 0.975]):
        share = norm.cdf(z0 + (z0 + z) / (1 - a * (z0 + z)))
        bounds.append(every[int(share * len(every))])
    found = paired_interval(*zip(*pairs, strict=True), comparison, center, resamples=40_000)
    assert found.method is Method.BCA
    assert found.estimate == pytest.approx(estimate)
    assert (found.low, found.high) == pytest.approx(bounds, abs=0.03 * (bounds[1] - bounds[0]))


def test_interval_of_means_approaches_students():
    """For many normal differences the interval is Student's paired one, however much the pairs vary together."""
    rng = np.random.default_rng(3)
    common = rng.normal(0, 50, 400)
    x, y = common + rng.normal(1.0, 1.0, 400), common + rng.normal(0.0, 1.0, 400)
    d = x - y
    half = t.ppf(0.975, 399) * d.std(ddof=1) / sqrt(400)
    found = paired_interval(x, y, center=Center.MEAN)
    assert (found.low, found.high) == pytest.approx((d.mean() - half, d.mean() + half), abs=0.1 * half)


def test_interval_covers_the_truth_as_often_as_it_says():
    """Of 200 samples about 90 % of the 90 % intervals of a ratio of medians hold the true ratio, 2."""
    rng = np.random.default_rng(5)
    hits = 0
    for seed in range(200):
        x = rng.lognormal(0, 0.5, 40)
        found = paired_interval(
            2 * x * rng.lognormal(0, 0.2, 40), x, Comparison.RATIO, confidence=0.9, resamples=400, seed=seed
        )
        hits += found.low <= 2 <= found.high
    assert 160 <= hits <= 197  # four standard deviations around 180, and a little more below


def test_interval_is_repeatable_and_seeded():
    """One seed gives one interval; another seed another one."""
    x, y = np.random.default_rng(0).lognormal(size=(2, 30))
    first, again, other = (paired_interval(x, y, center=Center.MEAN, seed=seed) for seed in (1, 1, 2))
    assert first == again != other


def test_equal_pairs_fall_back_to_percentiles():
    """BCa is not defined where all resamples agree; the interval is then the point they agree on."""
    found = paired_interval([3.0, 3.0, 3.0], [1.0, 1.0, 1.0], Comparison.RATIO)
    assert (found.estimate, found.low, found.high, found.method) == (3, 3, 3, Method.PERCENTILE)


def test_large_samples_take_percentiles():
    """From 2000 pairs on the jackknife is left out, and the interval stays Student's."""
    rng = np.random.default_rng(1)
    d = rng.normal(0.2, 1, 2500)
    found = paired_interval(d, np.zeros(2500), center=Center.MEAN, resamples=2000)
    half = 1.96 * d.std(ddof=1) / 50
    assert found.method is Method.PERCENTILE
    assert (found.low, found.high) == pytest.approx((d.mean() - half, d.mean() + half), abs=0.1 * half)


def test_too_few_pairs_have_no_bounds():
    """One pair has an estimate without bounds; none has not even that."""
    one, none = paired_interval([3.0], [2.0]), paired_interval([], [])
    assert one.estimate == 1 and np.isnan([one.low, one.high]).all() and one.method is Method.NONE
    assert np.isnan([none.estimate, none.low, none.high]).all()


@pytest.mark.parametrize(
    "first, second, options, message",
    [
        ([1.0, 2.0], [1.0], {}, "2 values and second 1"),
        ([1.0, nan], [1.0, 2.0], {}, "first holds 1 values of 2"),
        ([1.0, 2.0], [1.0, 0.0], {"comparison": Comparison.RATIO}, "above 0"),
        ([[1.0, 2.0]], [[1.0, 2.0]], {}, "one dimension"),
        ([1.0, 2.0], [1.0, 2.0], {"confidence": 95}, "95"),
        ([1.0, 2.0], [1.0, 2.0], {"resamples": 0}, "resamples is 0"),
    ],
)
def test_interval_refuses_what_it_cannot_compare(first, second, options, message):
    """Unequal sizes, gaps and impossible ratios are errors that name the value."""
    with pytest.raises(ConfigError, match=message):
        paired_interval(first, second, **options)


@pytest.mark.parametrize("b, c", [(0, 0), (1, 0), (5, 5), (3, 11), (20, 4), (0, 7)])
def test_mcnemar_sums_binomial_probabilities(b, c):
    """p is the probability, at even odds, of all splits of the discordant pairs no likelier than the one seen."""
    n = b + c
    expected = sum(comb(n, k) for k in range(n + 1) if comb(n, k) <= comb(n, b)) / 2**n
    first = np.array([True] * b + [False] * c + [True] * 4 + [False] * 3)
    second = np.array([False] * b + [True] * c + [True] * 4 + [False] * 3)
    order = np.random.default_rng(0).permutation(len(first))
    found = mcnemar(first[order], second[order])
    assert (found.only_first, found.only_second) == (b, c)
    assert found.p_value == pytest.approx(min(1, expected))


def test_mcnemar_refuses_unpaired_and_uncertain_results():
    """Sizes agree, and a success is True or False."""
    assert mcnemar([], []).p_value == 1
    with pytest.raises(ConfigError, match="shapes"):
        mcnemar([True], [True, False])
    with pytest.raises(ConfigError, match="second holds"):
        mcnemar([True, False], [0.5, 1.0])


def test_summary_is_the_standard_librarys():
    """Median, mean, deviation and 95th percentile are those of the module `statistics`."""
    values = np.random.default_rng(2).lognormal(size=101).tolist()
    found = summary(values)
    assert found.n == 101
    assert found.median == pytest.approx(statistics.median(values))
    assert found.mean == pytest.approx(statistics.fmean(values))
    assert found.sd == pytest.approx(statistics.stdev(values))
    assert found.p95 == pytest.approx(statistics.quantiles(values, n=20, method="inclusive")[-1])


def test_summary_of_little():
    """One value has no deviation, no value nothing; a gap in the values is an error."""
    one, none = summary([4.0]), summary([])
    assert (one.n, one.median, one.mean, one.p95) == (1, 4, 4, 4) and np.isnan(one.sd)
    assert none.n == 0 and np.isnan([none.median, none.mean, none.sd, none.p95]).all()
    with pytest.raises(ConfigError, match="1 values of 2"):
        summary([1.0, nan])
