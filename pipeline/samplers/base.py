"""The sampler protocol: where a planner looks next."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from pipeline.manifolds import Adherence, Counters


@dataclass(frozen=True)
class Asked:
    """What a sampler may know of a problem.

    Attributes:
        adherence: the manifold to sample.
        start, goal: configurations (n,).
        scene: key of the scene, for samplers that condition on it; None where it has none.
    """

    adherence: Adherence
    start: np.ndarray
    goal: np.ndarray
    scene: str | None = None


class Sampler(ABC):
    """Proposes configurations. Bound to one problem by `begin`, then asked by the planner.

    What it gives is counted here, once, whoever draws it: samplers are made of others (`samplers.combined`), which
    implement `draw` and `draw_cover`.

    Attributes:
        batch: K, how many configurations a batch planner should ask for at a time.
        lands: whether proposals are on the manifold, as `sample` says; where not, a planner may only walk towards them.
        informed: whether proposals depend on `current` and `target`, which may end; otherwise a planner need not select
            them, and may ask for more than K.
        network_time: spent in a network since `begin` [s].
    """

    batch: int = 1
    lands: bool = True
    informed: bool = False
    network_time: float = 0.0

    def begin(self, asked: Asked, rng: np.random.Generator) -> None:
        """Bind to a problem and its own random stream; what was kept of the last one is forgotten."""
        self.asked, self.adherence, self.rng, self.network_time = asked, asked.adherence, rng, 0.0

    @property
    def counters(self) -> Counters:
        """The counters of the running plan."""
        return self.adherence.counters

    def sample(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return configurations on the manifold (m, n) for K current and K target ones (K, n) each.

        At most K, of a sampler with several points per proposal at most so many times K; fewer where some could not be
        brought onto the manifold within the bounds. Collisions are not checked here.
        """
        found = self.draw(current, target)
        self.counters.samples += len(found)
        return found

    def cover(self, count: int) -> np.ndarray:
        """Return configurations for a planner that connects many and has walked nowhere yet (m, n).

        Called again until there are enough; `count` are missing still, of which some may be in collision.
        """
        found = self.draw_cover(count)
        self.counters.samples += len(found)
        return found

    def near(self, Q: np.ndarray, distance: float) -> np.ndarray:
        """Return configurations on the manifold (m, n), each about within a distance [rad or m] of a row of Q (k, n).

        Uniform in the ball around it, then projected; those that do not converge or leave the bounds are left out.
        """
        n = Q.shape[1]
        offsets = self.rng.normal(size=Q.shape)
        lengths = distance * self.rng.random((len(Q), 1)) ** (1 / n)
        found = self.adherence.project(Q + lengths / np.linalg.norm(offsets, axis=1, keepdims=True) * offsets)
        self.counters.samples += len(found)
        return found

    @abstractmethod
    def draw(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """What `sample` returns, not counted."""

    def draw_cover(self, count: int) -> np.ndarray:
        """What `cover` returns, not counted; samples for start and goal by turns unless a sampler knows better."""
        ends = np.stack([self.asked.start, self.asked.goal])
        side = np.arange(max(self.batch, count)) % 2
        return self.draw(ends[side], ends[1 - side])
