"""Telling of many edges at once whether they look free, for planners that walk only the few they need (FMT*)."""

from itertools import pairwise

import casadi as ca
import numpy as np

from pipeline.constraints import Compiled, Constraint
from pipeline.robots import Validity

POINTS = 15  # of an edge, one every sixteenth: a query of `Validity.all_free` holds them all
_MIDDLE = POINTS // 2
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
        lines = [q_from + share / (POINTS + 1) * (q_to - q_from) for share in range(1, POINTS + 1)]
        found = [constraint.projected(q, min(newton_steps, 3)) for q in lines]
        stations = [q_from, *(q for q, _ in found), q_to]
        way = sum((ca.norm_2(b - a) for a, b in pairwise(stations)), ca.SX(0))
        reached, missed = (ca.vertcat(*(pair[i] for pair in found)) for i in (0, 1))
        single = ca.Function("between", [q_from, q_to], [ca.densify(x) for x in (reached, missed, way)])
        self._between = Compiled(single.map(_EDGES), native)
        points, violations, ways = self._between.results  # views of what every call overwrites
        self._points = points.reshape(_EDGES, POINTS, constraint.n)
        self._violations, self._ways = violations.reshape(_EDGES, POINTS), ways.reshape(_EDGES)
        self._ends = [ends.reshape(_EDGES, constraint.n) for ends in self._between.arguments]

    def look(self, q_from: np.ndarray, q_to: np.ndarray, validity: Validity) -> tuple[np.ndarray, np.ndarray]:
        """Return of rows of q_from and q_to (m, n) whether their edges look free (m,), and how long they are (m,).

        Points that do not reach the manifold tell nothing. The length is that of the way through the points [rad or m].

        Args:
            q_from: where edges begin, free.
            q_to: where they end.
            validity: of the scene.
        """
        verdicts: list[bool] = []
        lengths = np.empty(len(q_from))
        free, all_free, points = validity.free, validity.all_free, self._points
        for first in range(0, len(q_from), _EDGES):
            size = min(_EDGES, len(q_from) - first)
            block = slice(first, first + size)
            self._ends[0][:size], self._ends[1][:size] = q_from[block], q_to[block]
            self._between.evaluate()
            lengths[block] = self._ways[:size]
            off = ~(self._violations[:size] < self._constraint.tolerance**2)  # also for a NaN
            if off.any():
                points[:size][off] = np.broadcast_to(q_from[block, None], points[:size].shape)[off]
            # Half of all edges among obstacles fail in their middle, which is cheaper to ask for by itself.
            verdicts += [free(points[i, _MIDDLE]) and all_free(points[i]) for i in range(size)]
        return np.array(verdicts, bool), lengths
