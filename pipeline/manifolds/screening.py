"""Telling of many edges at once whether they look free, for planners that walk only the few they need (FMT*)."""

from itertools import pairwise

import casadi as ca
import numpy as np

from pipeline.constraints import Compiled, Constraint
from pipeline.robots import Validity

SHARES = (8, 4, 12, 2, 6, 10, 14, *range(1, 16, 2))  # sixteenths of an edge: its middle, farthest from both ends, first
_EDGES = 8  # looked at by one call of the function


class Screen:
    """Points every sixteenth of straight lines between configurations, projected onto one manifold.

    Args:
        constraint: of the manifold.
        newton_steps: of a projection; at most three are taken.
        native: evaluate as machine code where there is a C compiler; compiling takes a second.
    """

    def __init__(self, constraint: Constraint, newton_steps: int, native: bool) -> None:
        self._constraint = constraint
        q_from, q_to = ca.SX.sym("q_from", constraint.n), ca.SX.sym("q_to", constraint.n)
        found = {
            share: constraint.projected(q_from + share / 16 * (q_to - q_from), min(newton_steps, 3)) for share in SHARES
        }
        stations = [q_from, *(found[share][0] for share in sorted(found)), q_to]
        way = sum((ca.norm_2(b - a) for a, b in pairwise(stations)), ca.SX(0))
        points, violations = (ca.vertcat(*(pair[i] for pair in found.values())) for i in (0, 1))
        single = ca.Function("between", [q_from, q_to], [ca.densify(x) for x in (points, violations, way)])
        self._between = Compiled(single.map(_EDGES), native)

    def look(
        self, q_from: np.ndarray, q_to: np.ndarray, validity: Validity, wide: Validity | None, near: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return of rows of q_from and q_to (m, n) whether their edges look free (m,), and how long they are (m,).

        The length is that of the way through the points [rad or m].

        Args:
            q_from: where edges begin.
            q_to: where they end.
            validity: of the scene.
            wide: the checker whose free configurations vouch for what is within `near`; None without one.
            near: a distance [rad or m].
        """
        verdicts: list[bool] = []
        lengths = np.empty(len(q_from))
        for first in range(0, len(q_from), _EDGES):
            size = min(_EDGES, len(q_from) - first)
            for argument, ends in zip(self._between.arguments, (q_from, q_to), strict=True):
                argument[:size] = ends[first : first + size]
            points, violations, ways = (result.reshape(_EDGES, -1)[:size] for result in self._between.evaluate())
            counted = (violations < self._constraint.tolerance**2).tolist()
            lengths[first : first + size] = ways[:, 0]
            rows = points.reshape(size, len(SHARES), -1).copy()
            for row, counts, way in zip(rows, counted, ways[:, 0].tolist(), strict=True):
                verdicts.append(_looks_free(row, counts, validity, wide if way / 16 <= near else None))
        return np.array(verdicts, bool), lengths


def _looks_free(points: np.ndarray, counted: list[bool], validity: Validity, wide: Validity | None) -> bool:
    """Tell whether an edge's points at SHARES are free; those that did not reach the manifold tell nothing.

    With `wide`, points lie so close that a free one of its vouches for the next.
    """
    free = validity.free
    vouched = [False] * 17  # at sixteenths; the ends vouch for nothing
    for share, q, counts in zip(SHARES, points, counted, strict=True):
        if not counts or (share % 2 and (vouched[share - 1] or vouched[share + 1])):
            continue
        if wide is not None and share % 2 == 0 and wide.free(q):
            vouched[share] = True
        elif not free(q):
            return False
    return True
