"""Telling of many edges at once whether they look free, for planners that walk only the few they need (FMT*)."""

from itertools import pairwise

import casadi as ca
import numpy as np

from pipeline.constraints import Compiled, Constraint, Expressions
from pipeline.robots import Validity

POINTS = 15  # of an edge at most, one every sixteenth
_MIDDLE = POINTS // 2
# Those that are asked beside the middle where an edge is looked at in 4, 8 and 16 pieces.
_BESIDE = [[i for i in range(first, POINTS, first + 1) if i != _MIDDLE] for first in (3, 1, 0)]
_EDGES = 8  # looked at by one call of the function
_MIDDLES = 32  # the same, where only the middle is


class Screen:
    """Points of straight lines between configurations, every sixteenth at the finest, projected onto one manifold.

    Args:
        constraint: of the manifold.
        newton_steps: of a projection; at most three are taken.
        resolution: the straight line is halved until its pieces are at most this long, or sixteenths [rad or m].
        native: evaluate as machine code where there is a C compiler; compiling takes a second.
    """

    def __init__(self, constraint: Constraint, newton_steps: int, resolution: float, native: bool | None) -> None:
        self._constraint = constraint
        self._halves = resolution * np.array([2.0, 4.0, 8.0])
        steps, squared = min(newton_steps, 3), constraint.tolerance**2
        between = constraint.compiled(
            ("between", steps), lambda: _between(constraint, steps), _EDGES, native, [squared]
        )
        middle = constraint.compiled(("middle", steps), lambda: _middle(constraint, steps), _MIDDLES, native, [squared])
        self._between, self._middle = _Rows(between, _EDGES), _Rows(middle, _MIDDLES)

    def look(self, q_from: np.ndarray, q_to: np.ndarray, validity: Validity) -> tuple[np.ndarray, np.ndarray, int]:
        """Return of rows of q_from and q_to (m, n) whether their edges look free (m,), and how long those are (m,).

        Points that do not reach the manifold tell nothing. The length is that of the way through all points
        [rad or m], and infinite where an edge is not free. The last value is how many points were projected.

        Args:
            q_from: where edges begin, free.
            q_to: where they end.
            validity: of the scene.
        """
        # Most of the edges that fail do so in their middle, which is cheaper to ask for by itself.
        middles, missed = self._middle(q_from, q_to)
        promising = validity.free_rows(self._or_begin(middles[:, None], missed, q_from)[:, 0])
        left = np.flatnonzero(promising)
        lengths = np.full(len(q_from), np.inf)
        q_from, q_to = q_from[left], q_to[left]
        found, missed, ways = self._between(q_from, q_to)
        points = self._or_begin(found.reshape(-1, POINTS, q_from.shape[1]), missed, q_from)
        # How often an edge is to be halved further; most want the same.
        straight = np.linalg.norm(q_to - q_from, axis=1)
        levels = np.searchsorted(self._halves, straight)
        for level in set(levels.tolist()) - {0}:
            asked = np.flatnonzero(levels == level)
            promising[left[asked]] = validity.all_free(points[asked].take(_BESIDE[level - 1], axis=1))
        lengths[left] = np.where(promising[left], ways[:, 0], np.inf)
        return promising, lengths, len(promising) + POINTS * len(left)

    @staticmethod
    def prepare(validity: Validity) -> None:
        """Make what `look` needs of a scene's checker."""
        validity.prepare(*map(len, _BESIDE))

    def _or_begin(self, points: np.ndarray, missed: np.ndarray, q_from: np.ndarray) -> np.ndarray:
        """Return points (m, p, n), where their violation (m, p) is too large where the edge begins, which is free."""
        off = ~(missed < self._constraint.tolerance**2)  # also for a NaN
        return np.where(off[:, :, None], q_from[:, None], points) if off.any() else points


def _between(constraint: Constraint, newton_steps: int) -> Expressions:
    """All points of a line: where they are projected to, ||F||^2 there, and the length of the way through them."""
    q_from, q_to, squared = _line_symbols(constraint)
    lines = [q_from + share / (POINTS + 1) * (q_to - q_from) for share in range(1, POINTS + 1)]
    found = [constraint.projected(q, newton_steps, squared) for q in lines]
    stations = [q_from, *(q for q, _ in found), q_to]
    way = sum((ca.norm_2(b - a) for a, b in pairwise(stations)), ca.SX(0))
    reached, missed = (ca.vertcat(*(pair[i] for pair in found)) for i in (0, 1))
    return Expressions([q_from, q_to, squared], [reached, missed, way])


def _middle(constraint: Constraint, newton_steps: int) -> Expressions:
    """The middle of a line: where it is projected to, and ||F||^2 there."""
    q_from, q_to, squared = _line_symbols(constraint)
    q = q_from + (_MIDDLE + 1) / (POINTS + 1) * (q_to - q_from)
    return Expressions([q_from, q_to, squared], list(constraint.projected(q, newton_steps, squared)))


def _line_symbols(constraint: Constraint) -> tuple[ca.SX, ca.SX, ca.SX]:
    n = constraint.n
    return ca.SX.sym("q_from", n), ca.SX.sym("q_to", n), ca.SX.sym("squared")


class _Rows:
    """Applies a function that takes `size` pairs of configurations at once to any number of them."""

    def __init__(self, function: Compiled, size: int) -> None:
        self._function, self._size = function, size
        self._ends = [ends.reshape(size, -1) for ends in function.arguments]
        self._results = [found.reshape(size, -1) for found in function.results]

    def __call__(self, q_from: np.ndarray, q_to: np.ndarray) -> list[np.ndarray]:
        """Return the results, a row for each pair."""
        found = [np.empty((len(q_from), rows.shape[1])) for rows in self._results]
        for first in range(0, len(q_from), self._size):
            block = slice(first, first + self._size)
            size = len(q_from[block])
            self._ends[0][:size], self._ends[1][:size] = q_from[block], q_to[block]
            self._function.evaluate()
            for all_rows, rows in zip(found, self._results, strict=True):
                all_rows[block] = rows[:size]
        return found
