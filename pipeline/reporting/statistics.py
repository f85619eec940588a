"""Intervals and tests behind the tables: Wilson, paired bootstrap, exact McNemar."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 2000  # the ends of a 95 % interval then rest on 50 resamples each
BCA_LIMIT = 2000  # BCa costs n^2 (jackknife), and from here on its correction is far below the interval's width
_SEED = 0  # fixed: a report made twice from the same trials is the same
_BATCH = 50  # resamples held in memory at a time


@dataclass(frozen=True)
class Estimate:
    """A statistic with its interval; NaN where it is not defined.

    Attributes:
        value: of the statistic.
        low, high: ends of the 95 % interval.
        method: 'BCa', 'percentile', or '' where there is no interval (fewer than two pairs).
    """

    value: float
    low: float = np.nan
    high: float = np.nan
    method: str = ""


def wilson(successes: int, n: int) -> Estimate:
    """Return the fraction with its Wilson interval; all NaN for n = 0."""
    if n == 0:
        return Estimate(np.nan)
    interval = stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(successes / n, float(interval.low), float(interval.high), "Wilson")


def median_ratio(numerator: np.ndarray, denominator: np.ndarray) -> Estimate:
    """Return median(numerator) / median(denominator) of paired values (n,) with its bootstrap interval."""
    return _paired(numerator, denominator, lambda x, y, axis=-1: np.median(x, axis=axis) / np.median(y, axis=axis))


def median_difference(first: np.ndarray, second: np.ndarray) -> Estimate:
    """Return median(first) - median(second) of paired values (n,) with its bootstrap interval."""
    return _paired(first, second, lambda x, y, axis=-1: np.median(x, axis=axis) - np.median(y, axis=axis))


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the two-sided p-value of exact McNemar's test from the discordant pairs; 1 without any."""
    n = only_first + only_second
    return 1.0 if n == 0 else float(stats.binomtest(only_first, n).pvalue)


def _paired(x: np.ndarray, y: np.ndarray, statistic: Callable[..., np.ndarray]) -> Estimate:
    x, y = np.asarray(x, float), np.asarray(y, float)
    if len(x) == 0:
        return Estimate(np.nan)
    value = float(statistic(x, y))
    if len(x) < 2:
        return Estimate(value)
    for method in ("BCa", "percentile"):
        if method == "BCa" and len(x) > BCA_LIMIT:
            continue
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # a degenerate BCa shows as NaN and is answered by the percentile interval
            interval = stats.bootstrap(
                (x, y), statistic, paired=True, vectorized=True, n_resamples=RESAMPLES, batch=_BATCH,
                confidence_level=CONFIDENCE, method=method, rng=np.random.default_rng(_SEED),
            ).confidence_interval  # fmt: skip
        if np.isfinite([interval.low, interval.high]).all():
            return Estimate(value, float(interval.low), float(interval.high), method)
    return Estimate(value)
