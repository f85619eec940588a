"""Classical sampling: whatever the adherence method does to cover the manifold (IMACS, Kingston et al. 2019)."""

import numpy as np

from pipeline.samplers.base import Sampler


class UniformSampler(Sampler):
    """Samples the whole manifold, whatever the start, goal and scene."""

    def __init__(self, batch: int = 64) -> None:
        self.batch = batch

    def sample(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return up to K samples of the manifold (m, n)."""
        found = self.adherence.sample(self.rng, len(current))
        self.counters.samples += len(found)
        return found
