"""CoMPNetX as a sampler (compnetx.txt, section V-E): the network first, the classical sampler after N_ismp."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, ProblemError, require
from pipeline.learning.compnetx.inference import CompnetxNetwork
from pipeline.learning.task_kinds import kind_of, task_vector
from pipeline.robots import Robot
from pipeline.samplers.base import Asked, Sampler
from pipeline.samplers.combined import Then
from pipeline.samplers.uniform import UniformSampler

_BARREN = 100  # draws in a row without a free configuration after which there is none to begin at


@dataclass(frozen=True)
class CompnetxParameters:
    """See `CompnetxSampler`."""

    batch: int = 20
    n_ismp: int = 500
    points: int = 1
    spread: float = 0.0
    from_start: float = 0.0
    from_goal: float = 0.0
    arrive: float = 0.0
    directions: bool = False

    def __post_init__(self) -> None:
        require("sampler.batch", self.batch, at_least=1)
        require("sampler.n_ismp", self.n_ismp, at_least=0)
        require("sampler.points", self.points, at_least=1)
        require("sampler.spread", self.spread, at_least=0)
        for name in ("from_start", "from_goal"):
            require(f"sampler.{name}", getattr(self, name), at_least=0, at_most=1)
        if self.from_start + self.from_goal > 1:
            raise ConfigError(
                f"sampler.from_start is {self.from_start} and sampler.from_goal {self.from_goal}; together at most 1"
            )
        require("sampler.arrive", self.arrive, at_least=0)


class CompnetxSampler(Then):
    """Asks the network, then the classical sampler.

    With K = 1 and moving targets this is Algorithm 7's sampling, with K > 1 that of Algorithm 6. After `n_ismp` calls
    the classical sampler answers, so that the whole manifold is explored in the end.

    Args:
        network: the trained network; it keeps the encodings of scenes, so that the first plan in a scene pays for it.
        voxels: grids by scene.
        parameters: see `Proposals`; `n_ismp` is how many calls the network answers, for which the paper has no number;
            with `directions` the classical sampler gives directions, see `UniformSampler`.
    """

    first: "Proposals"

    def __init__(
        self, network: CompnetxNetwork, voxels: Mapping[str, np.ndarray], parameters: CompnetxParameters
    ) -> None:
        first = Proposals(network, voxels, parameters)
        super().__init__(first, parameters.n_ismp, UniformSampler(parameters.batch, directions=parameters.directions))


class Proposals(Sampler):
    """Asks the network for configurations between current and target ones and projects them.

    The paper's network is taught the next waypoint, a step of 0.05 away, so that a chain of its proposals fills the
    way; one that is taught to look farther leaves gaps, and clusters where its proposals are. Points drawn on the way
    to a proposal and beside it fill them, at the cost of no further call.

    A first batch is made of K chains, each of which goes on from the network's last answer. Section V-E of compnetx.txt
    begins them at the start and at random configurations, section VII-A at random ones; to begin at both ends, as
    Algorithm 7 does, is ours.

    Args:
        network: the trained network.
        voxels: grids by scene.
        parameters: `batch` is K; `points` the samples per proposal: itself (1 is the paper's), the others anywhere on
            the straight line to it; `spread` the standard deviation of what is added to each sample before it is
            projected [rad or m] (0: the paper's); `from_start` and `from_goal` the shares of the chains that go from
            there to the other end, of which the others begin at random free configurations and go to the goal; a chain
            within `arrive` of where it goes begins again at a random free configuration [rad or m], as the batch would
            end up as clusters around goal and start otherwise.
    """

    informed = True

    def __init__(
        self, network: CompnetxNetwork, voxels: Mapping[str, np.ndarray], parameters: CompnetxParameters
    ) -> None:
        self.network, self.voxels, self.parameters = network, voxels, parameters
        self.batch = parameters.batch

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind to a problem."""
        if asked.scene is None or asked.scene not in self.voxels:
            raise ProblemError(f"CoMPNetX has no voxels of scene {asked.scene!r}; it has {sorted(self.voxels)[:5]}")
        super().begin(asked, rng)
        self._chains: tuple[np.ndarray, np.ndarray] | None = None
        begin = time.perf_counter()
        self.key = self._encoded(asked.scene)
        self.network_time = time.perf_counter() - begin

    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return up to K configurations on the manifold, times `points` (m, n)."""
        return self._projected(current, self._answer(current, target))

    def draw_cover(self, count: int) -> np.ndarray:
        """Take every chain a proposal further; return up to K configurations on the manifold, times `points` (m, n)."""
        del count
        current, target = self._begun() if self._chains is None else self._begun_again(*self._chains)
        onward = self._answer(current, target)
        self._chains = onward, target
        return self._projected(current, onward)

    def _begun_again(self, onward: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where K chains go on, of which those that have arrived begin again, and where they go (K, n)."""
        ended = np.flatnonzero(self.adherence.apart(onward - target) <= self.parameters.arrive)
        spread = self._random_free(len(ended))
        current = onward.copy()
        current[ended[: len(spread)]] = spread
        return current, target

    def _begun(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where K chains begin, and where they go (K, n)."""
        asked, K, parameters = self.asked, self.batch, self.parameters
        current, target = np.repeat([asked.start], K, axis=0), np.repeat([asked.goal], K, axis=0)
        first = round(parameters.from_start * K)
        last = K - min(round(parameters.from_goal * K), K - first)
        current[last:], target[last:] = asked.goal, asked.start
        spread = self._random_free(last - first)
        current[first : first + len(spread)] = spread
        return current, target

    def _random_free(self, count: int) -> np.ndarray:
        """Return up to `count` free configurations of the manifold, spread over it (m, n)."""
        space = self.adherence
        found: list[np.ndarray] = []
        barren = 0
        while len(found) < count and barren < _BARREN:
            space.deadline.look()
            missing = count - len(found)
            # More than are missing, as some will not be free: a call for a few costs as much as one for many.
            drawn = space.sample(self.rng, 2 * missing + 4)
            fresh = drawn[space.free_rows(drawn)][:missing]
            barren = 0 if len(fresh) else barren + 1
            found += list(fresh)
        return np.array(found).reshape(-1, space.dimension)

    def _encoded(self, scene: str) -> tuple[str, Robot, Constraint]:
        """Return what the network knows scene and task by; robots and constraints are compared by identity."""
        robot, constraint = self.adherence.validity.robot, self.adherence.constraint
        key = scene, robot, constraint
        voxels = self.voxels[scene]
        if not self.network.knows(key, voxels):
            kinds = self.network.model.kinds
            kind = kind_of(kinds, robot, constraint)
            task = task_vector(kinds, kind, constraint.said)
            self.network.encode(key, voxels, task, kind)
        return key

    def _answer(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return the network's proposals (K, n), near the manifold, not checked for collision."""
        begin = time.perf_counter()
        proposals = self.network.sample(self.key, current, target, self.rng)
        self.network_time += time.perf_counter() - begin
        self.counters.network_calls += 1
        return proposals

    def _projected(self, current: np.ndarray, proposals: np.ndarray) -> np.ndarray:
        """Return `points` per proposal on the manifold, the proposals first (up to K points, n)."""
        points, spread = self.parameters.points, self.parameters.spread
        if points > 1:
            share = self.rng.random((points - 1, len(proposals), 1))
            turns = self.adherence.turns
            way = proposals - current
            between = current + share * (way if turns is None else turns.wrapped(way))
            proposals = np.concatenate([proposals, *between])
        if spread:
            proposals = proposals + spread * self.rng.standard_normal(proposals.shape)
        return self.adherence.project(proposals)
