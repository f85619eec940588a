"""Whether a path is free between its points too: balls around configurations that bodies cannot leave."""

import numpy as np

from pipeline.robots import Validity

_RADII = (0.0125, 0.025, 0.05)  # of balls, see `Validity.vouching`
_LEAST = 0.002  # the radius that a free configuration counts for without a margin


class Certificate:
    """Checks paths in one scene.

    A configuration that keeps more distance from everything than bodies can travel within a ball around it vouches for
    that ball, and so for all of a path inside. Balls are made as large as the scene allows; where even a small one does
    not fit, the path is looked at so closely that the margin to obstacles covers what is between. Where pairs have no
    margin (self-collision, as a rule) that last look can miss a graze. Conditions are asked at the given points only.

    Args:
        validity: of the scene.
    """

    def __init__(self, validity: Validity) -> None:
        arms, between = validity.robot.lever_arms
        rows = np.concatenate([arms, between])
        lengths = np.linalg.norm(rows, axis=1)
        rows, lengths = rows[lengths > 0], lengths[lengths > 0]
        # No body travels farther than its lever arm's length times the largest of these weighted sums.
        self._weights = np.unique((rows / lengths[:, None]).round(9), axis=0).T  # (n, rows)
        self.validity = validity
        self._balls = [(radius, validity.vouching(radius)) for radius in _RADII]
        self._least = max(validity.margin / max(float(np.linalg.norm(arms, axis=1).max()), 1e-9), _LEAST)

    @property
    def checks(self) -> int:
        """Collision queries of the balls so far; the others are counted by the validity checker."""
        return sum(checker.checks for _, checker in self._balls)

    def first_gap(self, points: np.ndarray) -> int | None:
        """Return the first i for which the way from points[i] to points[i + 1], rows of (m, n), is not free."""
        conditions = self.validity.conditions
        ways = (np.abs(np.diff(points, axis=0)) @ self._weights).max(axis=1)
        along = np.concatenate([[0.0], np.cumsum(ways)])
        i, last, most = 0, len(points) - 1, len(_RADII) - 1
        level = most
        while i < last:
            j = i
            while True:  # the largest ball that fits
                radius, checker = self._balls[level]
                j = int(np.searchsorted(along, along[i] + 2 * radius, "right")) - 1
                if j > i and checker.free(self._between(points, along, i, j)):
                    break
                if j <= i or not level:
                    j = i + 1
                    if not self._closely(points[i], points[j], ways[i]):
                        return i
                    break
                level -= 1
            if conditions:
                for k in range(i + 1, j + 1):
                    if not all(condition.holds(points[k]) for condition in conditions):
                        return k - 1
            i, level = j, min(level + 1, most)
        return None

    def _between(self, points: np.ndarray, along: np.ndarray, i: int, j: int) -> np.ndarray:
        """The configuration half way from point i to point j."""
        half = (along[i] + along[j]) / 2
        k = min(int(np.searchsorted(along, half, "right")) - 1, j - 1)
        share = (half - along[k]) / max(along[k + 1] - along[k], 1e-12)
        return np.asarray(points[k] + share * (points[k + 1] - points[k]))

    def _closely(self, q_from: np.ndarray, q_to: np.ndarray, way: float) -> bool:
        """Tell whether configurations so close to each other that the margin covers the rest are free."""
        pieces = max(int(np.ceil(way / (2 * self._least))), 1)
        return all(self.validity.free(q_from + (k + 0.5) / pieces * (q_to - q_from)) for k in range(pieces))
