"""How often intervals of paired ratios hold the truth, by simulation: why `clusters` takes the interval it takes.

A time is log-normal: a scene's effect on both methods, one on the first method alone, the problem's on both, and noise.
Nominal 95 %, 10 scenes of 20 problems, 1500 data sets per cell (standard error 0.6 %), 300 resamples; in per cent, for
ratios of medians / of means. `python -m pipeline.evaluation.coverage` makes the first column anew.

    scenes          taken here      problems drawn from all   scenes, then problems: percentile
    alike           99.8 / 99.7     96.0 / 94.7               99.3 / 98.5
    slower together 100.0 / 99.7    97.2 / 93.6               99.9 / 98.8
    differ a little 99.4 / 99.2     93.9 / 88.3               99.2 / 97.0
    differ          98.9 / 97.0     77.6 / 64.3               95.4 / 92.8
    differ strongly 98.5 / 93.9     67.8 / 47.2               96.5 / 88.7
    other ratios    96.6 / 94.3     53.6 / 42.6               93.3 / 87.7

Scenes alone, without their problems, with the same quantile: 94.7 to 98.2 and 91.2 to 94.3.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.evaluation.clusters import paired_interval
from pipeline.evaluation.statistics import Center, Comparison

RATIO = 1.5  # of the first method's times to the second's, in the median


@dataclass(frozen=True)
class World:
    """Standard deviations of the logarithm of a time.

    Attributes:
        scene: what a scene does to both methods.
        method: what it does to the first method alone.
        problem: what a problem does to both.
        noise: of each plan.
    """

    scene: float
    method: float
    problem: float = 0.5
    noise: float = 0.4

    def ratio(self, center: Center) -> float:
        """Return the true ratio of the centres; all is log-normal."""
        return RATIO * (1.0 if center is Center.MEDIAN else float(np.exp(self.method**2 / 2)))

    def draw(self, scenes: int, problems: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return times of both methods (n,), (n,) and their scenes (n,)."""
        shape = (scenes, problems)
        both = rng.normal(0, self.scene, (scenes, 1)) + rng.normal(0, self.problem, shape)
        first = np.log(RATIO) + both + rng.normal(0, self.method, (scenes, 1)) + rng.normal(0, self.noise, shape)
        second = both + rng.normal(0, self.noise, shape)
        return np.exp(first).ravel(), np.exp(second).ravel(), np.repeat(np.arange(scenes), problems)


WORLDS = {
    "alike": World(0.0, 0.0),
    "slower together": World(0.6, 0.0),
    "differ a little": World(0.2, 0.1),
    "differ": World(0.3, 0.3),
    "differ strongly": World(0.8, 0.4, 0.4, 0.3),
    "other ratios": World(0.0, 0.5, 0.3, 0.3),
}


def coverage(
    world: World, center: Center, sets: int, resamples: int, scenes: int = 10, problems: int = 20, seed: int = 0
) -> float:
    """Return the share of simulated data sets whose 95 % interval holds the true ratio."""
    rng, hits = np.random.default_rng(seed), 0
    for _ in range(sets):
        first, second, labels = world.draw(scenes, problems, rng)
        seeds = int(rng.integers(2**31))
        found = paired_interval(first, second, labels, Comparison.RATIO, center, resamples=resamples, seed=seeds)
        hits += found.low <= world.ratio(center) <= found.high
    return hits / sets


if __name__ == "__main__":
    for name, world in WORLDS.items():
        shares = [coverage(world, center, 1500, 300) for center in (Center.MEDIAN, Center.MEAN)]
        print(f"{name:16}", *(f"{100 * share:.1f}" for share in shares))
