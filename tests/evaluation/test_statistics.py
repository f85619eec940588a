"""Intervals, tests and summaries against closed forms, enumeration and the standard library."""

import statistics
from math import comb, nan, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.errors import ConfigError
from pipeline.evaluation import Method, mcnemar, summary, wilson


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
