"""Conditions g(q) >= 0 that hold on a side of a boundary, not on a manifold: checked where collisions are checked."""

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property

import casadi as ca
import numpy as np

from pipeline.constraints.compiled import Compiled
from pipeline.constraints.structure import Expressions, structure_of
from pipeline.constraints.within import Within
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers

_BLOCK = 16  # configurations that one call takes
_HALVINGS = 8  # of a chord at most: what is left to prove falls to a quarter each time


class Condition:
    """Inequalities g(q) >= 0 that a configuration must meet.

    Args:
        name: how errors call it.
        q: the configuration symbol (n, 1).
        expression: g as an expression of q (k, 1).
        labels: what each row says (k,).
        bend: bounds |g''| of every row along chords with steps dq (C, n), as (C,); None where no bound is known: then
            chords are looked at in their ends and their middle only.
        numbers: those that `expression` takes as arguments (see `Constraint`).

    Raises:
        ConstraintError: free symbols other than q and numbers, or another number of labels than rows.
    """

    def __init__(
        self,
        name: str,
        q: ca.SX,
        expression: ca.SX,
        labels: Sequence[str],
        bend: Callable[[np.ndarray], np.ndarray] | None = None,
        numbers: Numbers | None = None,
    ) -> None:
        if len(labels) != expression.numel():
            raise ConstraintError(f"condition {name!r} has {expression.numel()} rows and {len(labels)} labels")
        numbers = numbers or Numbers()
        self.name, self.labels, self.n = name, tuple(labels), q.numel()
        self._margin, self._bend = 0.0, bend
        self._structure = structure_of(q, expression, numbers.symbols, f"condition {name!r}")
        self._numbers = numbers.values
        self._least = self._compiled("least", lambda q: ca.mmin(self._structure.rows(q)))
        self._slack = self._compiled("g", self._structure.rows)

    @classmethod
    def within(
        cls,
        name: str,
        q: ca.SX,
        within: Within,
        labels: Sequence[str],
        bend: Callable[[np.ndarray], np.ndarray] | None = None,
        numbers: Numbers | None = None,
    ) -> "Condition":
        """Return the condition that values are within bounds: a row a finite bound. `labels` name the values (m,)."""
        numbers = numbers or Numbers()
        rows, which = within.slack(numbers)
        return cls(name, q, rows, [f"{labels[i]} {bound}" for i, bound in which], bend, numbers)

    def rows(self, q: ca.SX, numbers: Numbers) -> ca.SX:
        """Return g as an expression (k, 1) of q (n,), for an expression that takes `numbers` as arguments."""
        return self._structure.rows_with(q, numbers.arguments(self._numbers))

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return dg/dq (k, n)."""
        return self._jacobian(q)[0].reshape(len(self.labels), self.n).copy()

    def slack_rows(self, Q: np.ndarray) -> np.ndarray:
        """Return g of every row of Q (N, n) as (N, k)."""
        found = np.empty((len(Q), len(self.labels)))
        for first in range(0, len(Q), _BLOCK):
            block = Q[first : first + _BLOCK]
            self._slack_block.arguments[0][: len(block)] = block
            result = self._slack_block.evaluate()[0].reshape(_BLOCK, -1)
            found[first : first + _BLOCK] = result[: len(block)]
        return found

    @cached_property
    def _jacobian(self) -> Compiled:
        return self._compiled("dg", lambda q: self._structure.rows_and_jacobian(q)[1].T)

    @cached_property
    def _slack_block(self) -> Compiled:
        return self._compiled("g", self._structure.rows, _BLOCK)

    def _compiled(self, key: str, result: Callable[[ca.SX], ca.SX], columns: int = 1) -> Compiled:
        def make() -> Expressions:
            q = ca.SX.sym("q", self.n)
            return Expressions([q], [result(q)])

        return self._structure.compiled((key,), make, self._numbers, columns)

    @property
    def proven(self) -> bool:
        """True when `first_gap` looks at all of a chord, not only at points of it."""
        return self._bend is not None

    @property
    def margin(self) -> float:
        """What every row of g must be at least."""
        return self._margin

    def kept(self, margin: float) -> "Condition":
        """Return the same condition, met only where every row is at least `margin`."""
        other = copy(self)
        other._margin = margin
        return other

    def holds(self, q: np.ndarray) -> bool:
        """True when every row of g(q) is at least 0, or the margin."""
        return bool(self._least(q)[0][0] >= self._margin)

    def reason(self, q: np.ndarray) -> str:
        """Return why q (n,) does not meet it: its worst row, by how much, and the bound."""
        slack = self.slack(q)
        worst = int(np.argmin(slack))
        return f"not meeting {self.name}: {self.labels[worst]} by {slack[worst]:.3g}, at least {self._margin:.3g}"

    def slack(self, q: np.ndarray) -> np.ndarray:
        """Return g(q) (k,)."""
        return self._slack(q)[0].copy()

    def first_gap(self, states: np.ndarray) -> int | None:
        """Return the first i for which g >= 0 does not hold all along the chord from states[i] to states[i + 1].

        Without the margin. On a chord g is at least the smaller value at its ends less an eighth of |g''|; a chord that
        this does not prove is halved.

        Args:
            states: of a path (T, n).
        """
        least = np.array([self._least(q)[0][0] for q in states])
        steps = np.diff(states, axis=0)
        sags = (np.zeros(len(steps)) if self._bend is None else self._bend(steps)) / 8
        low = np.minimum(least[:-1], least[1:])
        if self._bend is None:
            middles = np.array([self._least(q)[0][0] for q in states[:-1] + steps / 2])
            failing = np.flatnonzero(~(np.minimum(low, middles) >= 0))
            return int(failing[0]) if len(failing) else None
        for i in np.flatnonzero(~(low >= sags)):
            if not self._holds_along(states[i], steps[i], least[i], least[i + 1], sags[i], _HALVINGS):
                return int(i)
        return None

    def _holds_along(
        self, q: np.ndarray, step: np.ndarray, begin: float, end: float, sag: float, halvings: int
    ) -> bool:
        """Tell whether g >= 0 is proven from q to q + step (n,), with g's least rows at both ends given."""
        if not min(begin, end) >= 0:
            return False
        if min(begin, end) >= sag:
            return True
        if not halvings:
            return False
        middle = float(self._least(q + step / 2)[0][0])
        return self._holds_along(q, step / 2, begin, middle, sag / 4, halvings - 1) and self._holds_along(
            q + step / 2, step / 2, middle, end, sag / 4, halvings - 1
        )
