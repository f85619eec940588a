"""Intervals of what is measured on problems that lie in scenes: problems of one scene are alike.

A resample draws scenes, and then problems within each. Its deviation, times Student's quantile with one degree of
freedom less than scenes and times sqrt(S / (S - 1)), makes the interval; ratios are taken in logarithms, which makes
them symmetric. Resampling both stages counts what varies within scenes twice, so that intervals are too wide where
scenes do not differ; without it they are too narrow where they do (`pipeline.evaluation.coverage` has the numbers).
"""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from pipeline.errors import ConfigError
from pipeline.evaluation.statistics import (
    Center,
    Comparison,
    Interval,
    Method,
    Values,
    check_confidence,
    sample,
    wilson_bounds,
)

RESAMPLES = 2000  # only their deviation is used, which is within 2 % then
_NUMBERS = 2_000_000  # weights held in memory at a time
Labels = Sequence[object] | np.ndarray


def paired_interval(
    first: Values,
    second: Values,
    scenes: Labels,
    comparison: Comparison = Comparison.DIFFERENCE,
    center: Center = Center.MEDIAN,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval:
    """Return how the centres of paired samples (n,) compare, with the interval described above.

    Where all pairs lie in one scene only problems can vary: the interval says nothing about other scenes, and its
    method says so. Without two pairs the bounds are NaN.

    Args:
        first: values of the problems (n,).
        second: others of the same problems (n,).
        scenes: in which they lie (n,).
        comparison: how the centres are compared.
        center: which ones.
        confidence: how often such intervals shall hold the truth.
        resamples: of scenes and problems.
        seed: of the resamples.

    Raises:
        ConfigError: samples of different sizes, a value that is not finite, a ratio of values that are not positive,
            or a confidence or number of resamples out of range.
    """
    check_confidence(confidence)
    if resamples < 1:
        raise ConfigError(f"resamples is {resamples}; it must be at least 1")
    x, y, labels = sample("first", first), sample("second", second), np.asarray(scenes)
    if len(x) != len(y):
        raise ConfigError(f"first has {len(x)} values and second {len(y)}; pairs need as many of both")
    if len(labels) != len(x):
        raise ConfigError(f"scenes has {len(labels)} values for {len(x)} pairs; each pair lies in one scene")
    ratio = comparison is Comparison.RATIO
    if ratio and not ((x > 0).all() and (y > 0).all()):
        raise ConfigError(f"a ratio needs values above 0; the least is {min(x.min(), y.min())}")
    if len(x) == 0:
        return Interval(np.nan, np.nan, np.nan, confidence, Method.NONE)
    of = np.median if center is Center.MEDIAN else np.mean
    estimate = float(of(x) / of(y) if ratio else of(x) - of(y))
    if len(x) == 1:
        return Interval(estimate, np.nan, np.nan, confidence, Method.NONE)
    groups = np.unique(labels, return_inverse=True)[1]
    method = Method.SCENES
    if groups.max() == 0:
        groups, method = np.arange(len(x)), Method.ONE_SCENE
    rng, found = np.random.default_rng(seed), []
    centre = _weighted_medians if center is Center.MEDIAN else _weighted_means
    batch = max(1, _NUMBERS // len(x))
    for begin in range(0, resamples, batch):
        weights = _weights(groups, min(batch, resamples - begin), rng)
        a, b = centre(x, weights), centre(y, weights)
        found.append(np.log(a / b / estimate) if ratio else a - b)
    half = _expansion(int(groups.max()) + 1, confidence) * float(np.concatenate(found).std())
    low, high = (estimate * np.exp(-half), estimate * np.exp(half)) if ratio else (estimate - half, estimate + half)
    return Interval(estimate, float(low), float(high), confidence, method)


def success_interval(successes: Sequence[bool] | np.ndarray, scenes: Labels, confidence: float = 0.95) -> Interval:
    """Return a success rate with Wilson's interval for as many independent problems as those of scenes are worth.

    Their number is divided by how much more rates of scenes vary than they would with independent problems (at
    least 1), and the quantile is Student's, with one degree of freedom less than scenes. Where all or no problem was
    solved, or all lie in one scene, nothing tells how scenes differ: it is Wilson's own then.

    Args:
        successes: of each problem (n,).
        scenes: in which they lie (n,).
        confidence: how often such intervals shall hold the truth.

    Raises:
        ConfigError: samples of different sizes, or a confidence out of range.
    """
    check_confidence(confidence)
    solved, labels = np.asarray(successes, bool).astype(float), np.asarray(scenes)
    if len(solved) != len(labels):
        raise ConfigError(f"scenes has {len(labels)} values for {len(solved)} problems; each lies in one scene")
    n, quantile = len(solved), float(stats.norm.ppf((1 + confidence) / 2))
    if n == 0:
        return Interval(np.nan, 0.0, 1.0, confidence, Method.WILSON)
    rate = float(solved.mean())
    groups = np.unique(labels, return_inverse=True)[1]
    S = int(groups.max()) + 1
    if S == 1 or rate in (0.0, 1.0):
        return Interval(rate, *wilson_bounds(rate, n, quantile), confidence, Method.WILSON)
    residual = np.bincount(groups, solved - rate)  # (S,)
    variance = S / (S - 1) * float((residual**2).sum()) / n**2
    effect = max(1.0, variance * n / (rate * (1 - rate)))
    student = float(stats.t.ppf((1 + confidence) / 2, S - 1))
    return Interval(rate, *wilson_bounds(rate, n / effect, student), confidence, Method.SCENES)


def _weights(groups: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return how often each problem is in each resample of scenes, and of problems within them (count, n)."""
    S = int(groups.max()) + 1
    drawn = rng.multinomial(S, np.full(S, 1 / S), count)  # (count, S)
    weights = np.empty((count, len(groups)), np.int64)
    for scene in range(S):
        members = np.flatnonzero(groups == scene)
        m = len(members)
        # A scene that is drawn c times gives c m problems, all drawn from its own.
        weights[:, members] = rng.multinomial(drawn[:, scene] * m, np.full(m, 1 / m))
    return weights


def _weighted_medians(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the median (count,) of values (n,), each as often as its weight (count, n) says."""
    order = np.argsort(values)
    ranked, reached = values[order], np.cumsum(weights[:, order], axis=1)
    total = reached[:, -1:]
    low, high = ((reached > place).argmax(axis=1) for place in ((total - 1) // 2, total // 2))
    return np.asarray((ranked[low] + ranked[high]) / 2)


def _weighted_means(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.asarray(weights @ values / weights.sum(axis=1))


def _expansion(S: int, confidence: float) -> float:
    """Return by what to multiply the deviation of resamples of S scenes."""
    return float(np.sqrt(S / (S - 1)) * stats.t.ppf((1 + confidence) / 2, S - 1))
