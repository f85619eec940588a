"""Classical sampling: whatever the adherence method does to cover the manifold (IMACS, Kingston et al. 2019)."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import require
from pipeline.samplers.base import Asked, Sampler

_MOST_COVER = 1024  # samples of the first batch that are drawn at a time, between two looks at the clock


@dataclass(frozen=True)
class UniformParameters:
    """See `UniformSampler`."""

    batch: int = 64
    block: int = 32
    around: float = 0.75
    directions: bool = False

    def __post_init__(self) -> None:
        for name in ("batch", "block"):
            require(f"sampler.{name}", getattr(self, name), at_least=1)
        require("sampler.around", self.around, at_least=0, at_most=1)


class UniformSampler(Sampler):
    """Samples the whole manifold, whatever the problem; with charts, most of a first batch around start and goal.

    Args:
        batch: K for batch planners.
        block: samples drawn at a time and handed out one by one; projecting a block costs little more than one.
        around: share of a first batch that is drawn around the current configurations, where the adherence has charts.
            Of OMPL's FMT it is all, whose atlas has only the charts of start and goal by then.
        directions: draw directions instead, which need not be on the manifold (see `Adherence.directions`); for
            planners that extend towards samples, not for those that connect them.
    """

    def __init__(self, batch: int = 64, block: int = 32, around: float = 0.75, directions: bool = False) -> None:
        parameters = UniformParameters(batch, block, around, directions)
        self.batch, self.block, self.around, self.lands = batch, block, around, not parameters.directions

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind to a problem and forget the samples drawn for the last one."""
        super().begin(asked, rng)
        self._drawn = np.empty((0, asked.adherence.dimension))

    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return up to K samples of the manifold, or K directions (m, n)."""
        count = len(current)
        if len(self._drawn) < count:
            draw = self.adherence.sample if self.lands else self.adherence.directions
            fresh = draw(self.rng, max(self.block, count - len(self._drawn)))
            self._drawn = np.concatenate([self._drawn, fresh])
        found, self._drawn = self._drawn[:count], self._drawn[count:]
        return found

    def draw_cover(self, count: int) -> np.ndarray:
        """Return samples of the manifold (m, n), half as many again as are missing, the share `around` at the ends."""
        count = max(self.batch, min(3 * count // 2, _MOST_COVER))
        near = round(self.around * count)
        ends = np.stack([self.asked.start, self.asked.goal])
        close = self.adherence.sample_around(self.rng, ends[np.arange(count)[:near] % 2])
        return np.concatenate([close, self.adherence.sample(self.rng, count - near)])
