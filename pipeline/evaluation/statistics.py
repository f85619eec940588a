"""Statistics of trials: success rates, tests and summaries; intervals over scenes are in `clusters`."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy import stats

from pipeline.errors import ConfigError

Values = Sequence[float] | np.ndarray


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
    SCENES = "scenes, then problems"  # see `pipeline.evaluation.clusters`
    ONE_SCENE = "problems of one scene"  # of other scenes it says nothing
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
    check_confidence(confidence)
    if not 0 <= successes <= trials:
        raise ConfigError(f"successes is {successes}; it must be at least 0 and at most trials = {trials}")
    if trials == 0:
        return Interval(np.nan, 0.0, 1.0, confidence, Method.WILSON)
    bounds = wilson_bounds(successes / trials, trials, float(stats.norm.ppf((1 + confidence) / 2)))
    return Interval(successes / trials, *bounds, confidence, Method.WILSON)


def wilson_bounds(rate: float, n: float, quantile: float) -> tuple[float, float]:
    """Return the bounds of Wilson's (1927) interval of a rate among n independent trials, n not necessarily whole."""
    shift = quantile**2 / n
    half = quantile * float(np.sqrt(rate * (1 - rate) / n + shift / n / 4))
    low, high = ((rate + shift / 2 + side) / (1 + shift) for side in (-half, half))
    return (0.0 if rate == 0 else low), (1.0 if rate == 1 else high)


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
    x = sample("values", values)
    if len(x) == 0:
        return Summary(0, np.nan, np.nan, np.nan, np.nan)
    sd = float(x.std(ddof=1)) if len(x) > 1 else np.nan
    return Summary(len(x), float(np.median(x)), float(x.mean()), sd, float(np.percentile(x, 95)))


def sample(name: str, values: Values) -> np.ndarray:
    """Return values as an array (n,).

    Raises:
        ConfigError: another number of dimensions, or a value that is not finite.
    """
    x = np.asarray(values, float)
    if x.ndim != 1:
        raise ConfigError(f"{name} has shape {x.shape}; a sample has one dimension")
    if not np.isfinite(x).all():
        raise ConfigError(f"{name} holds {int((~np.isfinite(x)).sum())} values of {len(x)} that are not finite")
    return x


def check_confidence(confidence: float) -> None:
    """Refuse a confidence that is not within 0 and 1."""
    if not 0 < confidence < 1:
        raise ConfigError(f"confidence is {confidence}; it must be above 0 and below 1")
