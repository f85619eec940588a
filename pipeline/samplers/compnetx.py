"""CoMPNetX as a sampler (compnetx.txt, section V-E): the network first, the classical sampler after N_ismp."""

import time
from collections.abc import Callable, Mapping

import numpy as np

from pipeline.errors import ProblemError, require
from pipeline.learning import CompnetxNetwork
from pipeline.manifolds import Adherence
from pipeline.samplers.base import Sampler
from pipeline.samplers.uniform import UniformSampler


class CompnetxSampler(Sampler):
    """Asks the network for configurations between current and target ones and projects them.

    With K = 1 and moving targets this is Algorithm 7's sampling, with K > 1 that of Algorithm 6. After `n_ismp` calls
    the classical sampler answers, so that the whole manifold is explored in the end; how many of the samples came
    from it is counted as fallback samples.

    Args:
        network: the trained network; it keeps the encodings of scenes, so that the first plan in a scene pays for it.
        voxels: grids by scene.
        batch: K.
        n_ismp: calls answered by the network; the paper gives no number.
    """

    informed = True  # until the network has answered its last call

    def __init__(self, network: CompnetxNetwork, voxels: Mapping[str, np.ndarray], batch: int, n_ismp: int) -> None:
        require("sampler.batch", batch, at_least=1)
        require("sampler.n_ismp", n_ismp, at_least=0)
        self.network, self.voxels, self.batch, self.n_ismp = network, voxels, batch, n_ismp
        self.fallback = UniformSampler()

    def start(self, adherence: Adherence, rng: np.random.Generator, scene: str | None) -> None:
        """Bind to a problem."""
        if scene is None or scene not in self.voxels:
            raise ProblemError(f"CoMPNetX has no voxels of scene {scene!r}; it has {sorted(self.voxels)[:5]}")
        super().start(adherence, rng, scene)
        self.fallback.start(adherence, rng, scene)
        self.calls, self.informed = 0, self.n_ismp > 0
        begin = time.perf_counter()
        self.network.encode(scene, self.voxels[scene])
        self.network_time = time.perf_counter() - begin  # [s]

    def sample(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return up to K configurations on the manifold (m, n)."""
        return self._asked(self.fallback.sample, current, target)

    def first(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """As `sample`; what the network does not answer is the first batch of the classical sampler."""
        return self._asked(self.fallback.first, current, target)

    def _asked(
        self, classical: Callable[[np.ndarray, np.ndarray], np.ndarray], current: np.ndarray, target: np.ndarray
    ) -> np.ndarray:
        answers = self.informed
        self.calls += 1
        self.informed = self.calls < self.n_ismp
        if not answers:
            found = classical(current, target)
            self.answered = self.fallback.answered
            self.counters.fallback_samples += len(found)
            return found
        begin = time.perf_counter()
        proposals = self.network.sample(self.scene, current, target, self.rng)
        self.network_time += time.perf_counter() - begin
        self.counters.network_calls += 1
        found, self.answered = self.adherence.project_rows(proposals)
        self.counters.samples += len(found)
        return found
