"""Statistics of trials: success rates, paired comparisons and summaries, each with its interval.

Planners are compared on the same problems, so comparisons are paired: a resample draws problems, not trials.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy import stats

from pipeline.errors import ConfigError

Values = Sequence[float] | np.ndarray

RESAMPLES = 9999  # scipy's default
_JACKKNIFE = 2000  # BCa leaves out every pair once, n^2 numbers; from here on its correction is far below the width
_NUMBERS = 2_000_000  # resampled values held in memory at a time


class Center(Enum):
    """Which centre of a sample is compared."""

    MEDIAN = "median"
    MEAN = "mean"


class Comparison(Enum):
    """How two centres are compared."""

    DIFFERENCE = "difference"  # first - second
    RATIO = "ratio"  # first / second


class Method(Enum):
    """How an interval was found."""

    WILSON = "Wilson"
    BCA = "BCa"
    PERCENTILE = "percentile"  # where BCa is degenerate or too large
    NONE = "none"  # fewer than two pairs


@dataclass(frozen=True)
class Interval:
    """An estimate between two bounds; NaN where it is not defined.

    Attributes:
        estimate: of the sample itself.
        low, high: bounds.
        confidence: how often such intervals hold the truth.
        method: how the bounds were found.
    """

    estimate: float
    low: float
    high: float
    confidence: float
    method: Method


@dataclass(frozen=True)
class McNemar:
    """Exact McNemar test of two planners on the same problems.

    Attributes:
        only_first, only_second: problems that only one of them solved.
        p_value: two-sided, of a difference at least as large when both solve a problem equally often; 1 without any.
    """

    only_first: int
    only_second: int
    p_value: float


@dataclass(frozen=True)
class Summary:
    """Of a sample of n values, in their unit. NaN for n = 0, and `sd` also for n = 1.

    Attributes:
        n: size.
        median, mean: centres.
        sd: standard deviation with n - 1 degrees of freedom.
        p95: 95th percentile, between the neighbouring values.
    """

    n: int
    median: float
    mean: float
    sd: float
    p95: float


def wilson(successes: int, trials: int, confidence: float = 0.95) -> Interval:
    """Return a success rate with Wilson's score interval; (NaN, 0, 1) without trials.

    Raises:
        ConfigError: successes not within 0 and trials, or a confidence not within 0 and 1.
    """
    _check_confidence(confidence)
    if not 0 <= successes <= trials:
        raise ConfigError(f"successes is {successes}; it must be at least 0 and at most trials = {trials}")
    if trials == 0:
        return Interval(np.nan, 0.0, 1.0, confidence, Method.WILSON)
    bounds = stats.binomtest(int(successes), int(trials)).proportion_ci(confidence, method="wilson")
    return Interval(successes / trials, float(bounds.low), float(bounds.high), confidence, Method.WILSON)


def paired_interval(
    first: Values,
    second: Values,
    comparison: Comparison = Comparison.DIFFERENCE,
    center: Center = Center.MEDIAN,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval:
    """Return how the centres of paired samples (n,) compare, with a bootstrap interval over the pairs.

    BCa (Efron 1987), or percentiles where BCa is not defined: all pairs equal, or too many of them for its jackknife.
    Without two pairs the bounds are NaN.

    Raises:
        ConfigError: samples of different sizes, a value that is not finite, a ratio of values that are not positive,
            or a confidence or number of resamples out of range.
    """
    _check_confidence(confidence)
    if resamples < 1:
        raise ConfigError(f"resamples is {resamples}; it must be at least 1")
    x, y = _sample("first", first), _sample("second", second)
    if len(x) != len(y):
        raise ConfigError(f"first has {len(x)} values and second {len(y)}; pairs need as many of both")
    if comparison is Comparison.RATIO and not ((x > 0).all() and (y > 0).all()):
        raise ConfigError(f"a ratio needs values above 0; the least is {min(x.min(), y.min())}")
    if len(x) == 0:
        return Interval(np.nan, np.nan, np.nan, confidence, Method.NONE)
    statistic = _statistic(comparison, center)
    estimate = float(statistic(x, y))
    if len(x) == 1:
        return Interval(estimate, np.nan, np.nan, confidence, Method.NONE)
    for method in (Method.BCA, Method.PERCENTILE):
        if method is Method.BCA and len(x) > _JACKKNIFE:
            continue
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)
            found = stats.bootstrap(
                (x, y),
                statistic,
                paired=True,
                vectorized=True,
                n_resamples=resamples,
                batch=max(1, _NUMBERS // len(x)),
                confidence_level=confidence,
                method=method.value,
                rng=np.random.default_rng(seed),
            ).confidence_interval
        if np.isfinite([found.low, found.high]).all():
            break
    return Interval(estimate, float(found.low), float(found.high), confidence, method)


def mcnemar(first: Sequence[bool] | np.ndarray, second: Sequence[bool] | np.ndarray) -> McNemar:
    """Test whether two planners solve the same problems equally often, from their successes (n,) by problem.

    Raises:
        ConfigError: samples of different sizes, or values other than True and False.
    """
    x, y = np.asarray(first), np.asarray(second)
    if x.shape != y.shape or x.ndim != 1:
        raise ConfigError(f"successes have shapes {x.shape} and {y.shape}; pairs need as many of both in one dimension")
    for name, values in (("first", x), ("second", y)):
        if values.size and values.dtype != bool:
            raise ConfigError(f"{name} holds {values.dtype}; successes must be True or False")
    x, y = x.astype(bool), y.astype(bool)
    only_first, only_second = int((x & ~y).sum()), int((~x & y).sum())
    discordant = only_first + only_second
    p_value = float(stats.binomtest(only_first, discordant).pvalue) if discordant else 1.0
    return McNemar(only_first, only_second, p_value)


def summary(values: Values) -> Summary:
    """Summarise a sample (n,).

    Raises:
        ConfigError: a value that is not finite.
    """
    x = _sample("values", values)
    if len(x) == 0:
        return Summary(0, np.nan, np.nan, np.nan, np.nan)
    sd = float(x.std(ddof=1)) if len(x) > 1 else np.nan
    return Summary(len(x), float(np.median(x)), float(x.mean()), sd, float(np.percentile(x, 95)))


def _statistic(comparison: Comparison, center: Center) -> Callable[..., np.ndarray]:
    of = np.median if center is Center.MEDIAN else np.mean

    def statistic(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
        a, b = of(x, axis=axis), of(y, axis=axis)
        return np.asarray(a - b if comparison is Comparison.DIFFERENCE else a / b)

    return statistic


def _sample(name: str, values: Values) -> np.ndarray:
    x = np.asarray(values, float)
    if x.ndim != 1:
        raise ConfigError(f"{name} has shape {x.shape}; a sample has one dimension")
    if not np.isfinite(x).all():
        raise ConfigError(f"{name} holds {int((~np.isfinite(x)).sum())} values of {len(x)} that are not finite")
    return x


def _check_confidence(confidence: float) -> None:
    if not 0 < confidence < 1:
        raise ConfigError(f"confidence is {confidence}; it must be above 0 and below 1")
