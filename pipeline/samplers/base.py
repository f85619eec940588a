"""The sampler protocol: where a planner looks next."""

from abc import ABC, abstractmethod

import numpy as np

from pipeline.manifolds import Adherence, Counters


class Sampler(ABC):
    """Proposes configurations. Bound to one problem by `start`, then asked by the planner.

    Attributes:
        batch: K, how many configurations a batch planner should ask for at a time.
        lands: whether proposals are on the manifold, as `sample` says; where not, a planner may only walk towards them.
        informed: whether proposals depend on `current` and `target`, which may end; otherwise a planner need not select
            them, and may ask for more than K.
        onward: of the last call of an informed sampler, where a chain of samples goes on from, for each row of
            `current` (K, n); near the manifold, not checked for collision.
    """

    batch: int = 1
    lands: bool = True
    informed: bool = False
    onward: np.ndarray

    def start(self, adherence: Adherence, rng: np.random.Generator, scene: str | None) -> None:
        """Bind to a problem: the manifold to sample, the problem's own random stream, the scene to condition on."""
        self.adherence, self.rng, self.scene = adherence, rng, scene

    @property
    def counters(self) -> Counters:
        """The counters of the running plan."""
        return self.adherence.counters

    @abstractmethod
    def sample(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return configurations on the manifold (m, n) for K current and K target ones (K, n) each.

        At most K, of a sampler with several points per proposal at most so many times K; fewer where some could not be
        brought onto the manifold within the bounds. Collisions are not checked here.
        """

    def first(self, current: np.ndarray, target: np.ndarray) -> np.ndarray:
        """As `sample`, for the first batch of a planner that has walked nowhere yet.

        A classical sampler draws it around `current`, where the adherence has charts: as OMPL's FMT does, whose atlas
        has only those of start and goal by then.
        """
        return self.sample(current, target)
