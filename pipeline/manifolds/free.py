"""Free space: motion without a constraint, on straight lines."""

from dataclasses import replace

import numpy as np

from pipeline.manifolds.base import Adherence, Counters, Stop, Traversal, length
from pipeline.manifolds.screening import POINTS


class FreeSpace(Adherence):
    """Walks straight towards the target, in steps as on a manifold; nothing is projected, and no walk wanders off."""

    def traverse(
        self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None, land: bool = True
    ) -> Traversal:
        """Walk along the straight line."""
        self.counters.traversals += 1
        if self.turns is not None:
            q_to = self.turns.nearest(q_to, q_from)
        step, straight = self.parameters.step, length(q_to - q_from)
        limit = min(self.parameters.max_steps, max_states or self.parameters.max_steps)
        reached: list[np.ndarray] = []
        q, covered, left = q_from, False, straight
        pace = (q_to - q_from) * (step / max(straight, step))
        while left > step:
            self.deadline.look()
            following = q + pace
            if (following < self.lower).any() or (following > self.upper).any():
                return self._ended(reached, Stop.OUT_OF_BOUNDS)
            chord = [following, *(q + share * pace for share in self._shares)]
            passable, covered = self._passable(chord, step, covered)
            if not passable:
                return self._ended(reached, Stop.COLLISION)
            reached.append(following)
            q, left = following, left - step
            if left > step and len(reached) >= limit:
                return self._ended(reached, Stop.STEP_LIMIT)
        return self._finish(reached, q_from, q_to, covered, land)

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return configurations that are uniform within the bounds (count, n)."""
        return self.project(rng.uniform(*self.validity.robot.box, (count, self.dimension)))

    def screen(self, q_from: np.ndarray, q_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Adherence.screen`: points of edges, rows of q_from and q_to (m, n), at the spacing of walks' checks."""
        if self.turns is not None:
            q_to = self.turns.nearest(q_to, q_from)
        lengths = np.linalg.norm(q_to - q_from, axis=1)
        pieces = np.minimum(np.ceil(lengths / self.parameters.resolution).astype(int), POINTS + 1)
        promising = np.zeros(len(q_from), bool)
        for i, (begin, end, count) in enumerate(zip(q_from, q_to, pieces.tolist(), strict=True)):
            self.deadline.look()
            shares = sorted((k / count for k in range(1, count)), key=lambda share: abs(share - 0.5))
            promising[i] = all(self.validity.free(begin + share * (end - begin)) for share in shares)
        return promising, np.where(promising, lengths, np.inf)

    def counted(self) -> Counters:
        """Return the counters since the last reset: what was brought onto the manifold is nothing."""
        return replace(super().counted(), projections=0)

    def prepare_screen(self) -> None:
        """Do nothing: there is nothing to make."""
