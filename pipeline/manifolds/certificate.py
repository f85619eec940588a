"""Whether a path is free between its points too: balls around configurations that bodies cannot leave."""

from bisect import bisect_right

import numpy as np

from pipeline.robots import Validity

# Of balls, see `Validity.vouching`; halves, so that a ball that does not fit costs no more than those that do.
_RADII = (0.02, 0.01, 0.005, 0.0025, 0.00125, 0.000625)
# An allowance for the bend of the manifold between two points and for what they are off it [m], no bound. With
# it, the smallest ball wants 2 mm of clearance of a body that two metres of links carry.
_BEND = 0.0005
_NOTHING = 1e-12  # a way as short is none
_TRUSTED = 4  # balls of a size in a row, after which the next size is tried


class Certificate:
    """Checks paths in one scene.

    A configuration whose bodies are farther from each other and from the obstacles than they can travel within a ball
    around it vouches for that ball, and so for all of a path inside. Balls are as large as the scene allows; where not
    even the smallest fits, the path is refused: it touches, or nearly so. Margins of the scene are not asked
    for. Conditions are asked at the given points only.

    Args:
        validity: of the scene.
    """

    def __init__(self, validity: Validity) -> None:
        rows = np.concatenate(validity.robot.lever_arms)
        lengths = np.linalg.norm(rows, axis=1)
        rows, lengths = rows[lengths > 0], lengths[lengths > 0]
        # No body travels farther than its lever arm's length times the largest of these weighted sums.
        self._weights = np.unique((rows / lengths[:, None]).round(9), axis=0).T  # (n, rows)
        self.validity = validity
        self._balls = [validity.vouching(radius, _BEND) for radius in _RADII]

    def allows(self, q: np.ndarray) -> bool:
        """Tell whether a path can end at q (n,): the smallest ball fits."""
        return self._balls[-1].free(q)

    @property
    def checks(self) -> int:
        """Collision queries so far."""
        return sum(checker.checks for checker in self._balls)

    def first_gap(self, points: np.ndarray) -> int | None:
        """Return the first i for which the way from points[i] to points[i + 1], rows of (m, n), is not free."""
        unmet = self._first_unmet(points)
        steps = np.diff(points if unmet is None else points[:unmet], axis=0)
        ways = (np.abs(steps) @ self._weights).max(axis=1, initial=0.0)
        along = [0.0, *np.cumsum(ways).tolist()]
        end, last, smallest = along[-1], len(steps) - 1, len(_RADII) - 1
        if not np.isfinite(end):
            return 0
        asked, frees = 0.0, [checker.free for checker in self._balls]
        size = held = 0
        while asked < end:
            following = min(asked + 2 * _RADII[size], end)
            middle = (asked + following) / 2
            i = min(bisect_right(along, middle) - 1, last)
            share = (middle - along[i]) / max(along[i + 1] - along[i], _NOTHING)
            if frees[size](points[i] + share * steps[i]):
                asked = following
                held += 1
                if held == _TRUSTED and size:
                    size, held = size - 1, 0
            elif size == smallest:
                return i
            else:
                size, held = size + 1, 0
        return None if unmet is None else unmet - 1

    def _first_unmet(self, points: np.ndarray) -> int | None:
        """Return the first point after the first one at which a condition does not hold."""
        conditions = self.validity.conditions
        if not conditions:
            return None
        holds = (all(condition.holds(q) for condition in conditions) for q in points[1:])
        return next((i for i, held in enumerate(holds, 1) if not held), None)
