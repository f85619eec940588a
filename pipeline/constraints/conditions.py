"""Conditions g(q) >= 0 that hold on a side of a boundary, not on a manifold: checked where collisions are checked."""

from collections.abc import Sequence
from copy import copy

import casadi as ca
import numpy as np

from pipeline.constraints.compiled import compiled
from pipeline.errors import ConstraintError


class Condition:
    """Inequalities g(q) >= 0 that a configuration must meet.

    Args:
        name: how errors call it.
        q: the configuration symbol (n, 1).
        expression: g as an expression of q (k, 1).
        labels: what each row says (k,).

    Raises:
        ConstraintError: free symbols other than q, or another number of labels than rows.
    """

    def __init__(self, name: str, q: ca.SX, expression: ca.SX, labels: Sequence[str]) -> None:
        free = [str(s) for s in ca.symvar(expression) if not ca.depends_on(q, s)]
        if free:
            raise ConstraintError(f"condition {name!r} depends on symbols other than its configuration: {free}")
        if len(labels) != expression.numel():
            raise ConstraintError(f"condition {name!r} has {expression.numel()} rows and {len(labels)} labels")
        self.name, self.labels, self.n = name, tuple(labels), q.numel()
        self._margin = 0.0
        self._least = compiled("least", [q], [ca.mmin(expression)])
        self._slack = compiled("g", [q], [ca.vec(expression)])

    def kept(self, margin: float) -> "Condition":
        """Return the same condition, met only where every row is at least `margin`."""
        other = copy(self)
        other._margin = margin
        return other

    def holds(self, q: np.ndarray) -> bool:
        """True when every row of g(q) is at least 0, or the margin."""
        return bool(self._least(q)[0][0] >= self._margin)

    def slack(self, q: np.ndarray) -> np.ndarray:
        """Return g(q) (k,)."""
        return self._slack(q)[0].copy()
