"""CoMPNetX as a sampler (compnetx.txt, section V-E): the network first, the classical sampler after N_ismp."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.errors import ProblemError, require
from pipeline.learning import CompnetxNetwork
from pipeline.manifolds import Adherence
from pipeline.samplers.base import Sampler
from pipeline.samplers.uniform import UniformSampler


@dataclass(frozen=True)
class CompnetxParameters:
    """See `CompnetxSampler`."""

    batch: int = 20
    n_ismp: int = 500
    points: int = 1
    spread: float = 0.0

    def __post_init__(self) -> None:
        require("sampler.batch", self.batch, at_least=1)
        require("sampler.n_ismp", self.n_ismp, at_least=0)
        require("sampler.points", self.points, at_least=1)
        require("sampler.spread", self.spread, at_least=0)


class CompnetxSampler(Sampler):
    """Asks the network for configurations between current and target ones and projects them.

    The paper's network is taught the next waypoint, a step of 0.05 away, so that a chain of its proposals fills the
    way; one that is taught to look farther leaves gaps, and clusters where its proposals are. Points drawn on the way
    to a proposal and beside it fill them, at the cost of no further call.

    With K = 1 and moving targets this is Algorithm 7's sampling, with K > 1 that of Algorithm 6. After `n_ismp` calls
    the classical sampler answers, so that the whole manifold is explored in the end; how many of the samples came
    from it is counted as fallback samples.

    Args:
        network: the trained network; it keeps the encodings of scenes, so that the first plan in a scene pays for it.
        voxels: grids by scene.
        batch: K.
        n_ismp: calls answered by the network; the paper gives no number.
        points: samples per proposal: itself (1 is the paper's), the others anywhere on the straight line to it.
        spread: standard deviation of what is added to each sample before it is projected [rad or m] (0: the paper's).
    """

    informed = True  # until the network has answered its last call

    def __init__(
        self,
        network: CompnetxNetwork,
        voxels: Mapping[str, np.ndarray],
        batch: int,
        n_ismp: int,
        points: int = 1,
        spread: float = 0.0,
    ) -> None:
        parameters = CompnetxParameters(batch, n_ismp, points, spread)
        self.network, self.voxels = network, voxels
        self.batch, self.n_ismp, self.points, self.spread = batch, n_ismp, points, parameters.spread
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
        """Return up to K configurations on the manifold, of the network up to K `points` (m, n)."""
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
            self.counters.fallback_samples += len(found)
            return found
        begin = time.perf_counter()
        proposals = self.network.sample(self.scene, current, target, self.rng)
        self.network_time += time.perf_counter() - begin
        self.counters.network_calls += 1
        self.onward = proposals
        found = self.adherence.project(self._points(current, proposals))
        self.counters.samples += len(found)
        return found

    def _points(self, current: np.ndarray, proposals: np.ndarray) -> np.ndarray:
        """Return `points` per proposal, the proposals first (K points, n)."""
        if self.points > 1:
            share = self.rng.random((self.points - 1, len(proposals), 1))
            turns = self.adherence.turns
            way = proposals - current
            between = current + share * (way if turns is None else turns.wrapped(way))
            proposals = np.concatenate([proposals, *between])
        return proposals + self.spread * self.rng.standard_normal(proposals.shape) if self.spread else proposals
