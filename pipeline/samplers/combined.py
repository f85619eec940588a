"""Samplers made of others: one after the other, mixed, or drawn ahead."""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.errors import ConfigError, require
from pipeline.samplers.base import Asked, Sampler


class Then(Sampler):
    """The first sampler answers a number of calls, the second all after them.

    So a learned sampler gives way to the classical one, and the whole manifold is explored in the end. What the second
    gives is counted as fallback samples.

    Args:
        first: asked at the beginning.
        calls: that it answers, of `sample` and `cover` together.
        second: asked from then on.
    """

    def __init__(self, first: Sampler, calls: int, second: Sampler) -> None:
        require("sampler.calls", calls, at_least=0)
        self.first, self.calls, self.second = first, calls, second
        self._left = calls
        self._answered: Sampler | None = None

    @property
    def batch(self) -> int:  # type: ignore[override]  # a property where the base has a value
        """K of the first sampler: planners ask it before they walk."""
        return self.first.batch

    @property
    def lands(self) -> bool:  # type: ignore[override]
        """Whether what was given last is on the manifold; before that, whether all will be."""
        return self.first.lands and self.second.lands if self._answered is None else self._answered.lands

    @property
    def informed(self) -> bool:  # type: ignore[override]
        """Whether the one that answers looks at current and target configurations."""
        return self._answering.informed

    @property
    def _answering(self) -> Sampler:
        return self.first if self._left else self.second

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind both to a problem."""
        super().begin(asked, rng)
        self._left, self._answered = self.calls, None
        self.first.begin(asked, rng)
        self.second.begin(asked, rng)
        self.network_time = self.first.network_time + self.second.network_time

    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """See `Sampler`."""
        return self._called(lambda sampler: sampler.draw(current, target))

    def draw_cover(self, count: int) -> np.ndarray:
        """See `Sampler`."""
        return self._called(lambda sampler: sampler.draw_cover(count))

    def _called(self, draw: Callable[[Sampler], np.ndarray]) -> np.ndarray:
        answering, fallback = self._answering, not self._left
        self._answered = answering
        self._left = max(self._left - 1, 0)
        found = draw(answering)
        if fallback:
            self.counters.fallback_samples += len(found)
        self.network_time = self.first.network_time + self.second.network_time
        return found


class Mixture(Sampler):
    """Each call is answered by one of several samplers, drawn by their shares.

    Args:
        samplers: that are mixed; all or none of them land.
        shares: of the calls, which add up to 1.
    """

    def __init__(self, samplers: Sequence[Sampler], shares: Sequence[float]) -> None:
        if len(samplers) != len(shares) or not samplers:
            raise ConfigError(f"a mixture has {len(samplers)} samplers and {len(shares)} shares")
        for share in shares:
            require("sampler.shares", share, at_least=0, at_most=1)
        if abs(sum(shares) - 1) > 1e-9:
            raise ConfigError(f"sampler.shares are {list(shares)}; they must add up to 1")
        if len({sampler.lands for sampler in samplers}) > 1:
            raise ConfigError("of the samplers of a mixture some are on the manifold and some are not")
        self.samplers, self.shares = tuple(samplers), tuple(shares)
        self.batch, self.lands = max(sampler.batch for sampler in samplers), samplers[0].lands

    @property
    def informed(self) -> bool:  # type: ignore[override]
        """Whether any of them looks at current and target configurations."""
        return any(sampler.informed for sampler in self.samplers)

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind all to a problem."""
        super().begin(asked, rng)
        for sampler in self.samplers:
            sampler.begin(asked, rng)

    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """See `Sampler`."""
        return self._called(lambda sampler: sampler.draw(current, target))

    def draw_cover(self, count: int) -> np.ndarray:
        """See `Sampler`."""
        return self._called(lambda sampler: sampler.draw_cover(count))

    def _called(self, draw: Callable[[Sampler], np.ndarray]) -> np.ndarray:
        found = draw(self.samplers[int(self.rng.choice(len(self.samplers), p=self.shares))])
        self.network_time = sum(sampler.network_time for sampler in self.samplers)
        return found


class Queue(Sampler):
    """Draws many at once and hands them out one by one, refilled when empty: a call costs little more for many.

    For samplers that look neither at current nor at target configurations.

    Args:
        source: whose samples are handed out.
        length: how many are drawn at a time.
    """

    def __init__(self, source: Sampler, length: int) -> None:
        require("sampler.length", length, at_least=1)
        self.source, self.length = source, length
        self.batch, self.lands = source.batch, source.lands

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind to a problem and forget the samples drawn for the last one."""
        super().begin(asked, rng)
        self.source.begin(asked, rng)
        self._drawn = np.empty((0, asked.adherence.dimension))

    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """See `Sampler`."""
        count = len(current)
        if len(self._drawn) < count:
            missing = max(self.length, count - len(self._drawn))
            ends = np.resize(current, (missing, current.shape[1])), np.resize(target, (missing, target.shape[1]))
            self._drawn = np.concatenate([self._drawn, self.source.draw(*ends)])
        found, self._drawn = self._drawn[:count], self._drawn[count:]
        self.network_time = self.source.network_time
        return found

    def draw_cover(self, count: int) -> np.ndarray:
        """See `Sampler`: those of the source, which has its own way to cover the manifold."""
        found = self.source.draw_cover(count)
        self.network_time = self.source.network_time
        return found
