"""Values within bounds: the one place where an interval becomes rows of something that is solved or checked."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from pipeline.errors import ConstraintError
from pipeline.robots import Numbers


@dataclass(frozen=True, eq=False)
class Within:
    """Expressions that must be within bounds; equal bounds make an equation of one.

    Three forms are made of it: rows that are 0 inside (`outside`), for Gauss-Newton; rows that are at least 0 inside
    (`slack`), for a `Condition`; and the values with their bounds as they are, for nonlinear programs.
    None of them is a manifold to walk on, because rows come and go at the bounds: there an interval is a further
    variable with limits (`chain`).

    Attributes:
        values: as an expression (m, 1).
        lower, upper: bounds (m,), infinite where there is none.

    Raises:
        ConstraintError: another number of bounds than of values, or bounds that no value is within.
    """

    values: ca.SX
    lower: np.ndarray
    upper: np.ndarray

    def __post_init__(self) -> None:
        m = self.values.numel()
        if not np.shape(self.lower) == np.shape(self.upper) == (m,):
            raise ConstraintError(f"{m} values have {np.size(self.lower)} lower and {np.size(self.upper)} upper bounds")
        for low, high in zip(self.lower, self.upper, strict=True):
            if not low <= high or low == np.inf or high == -np.inf:
                raise ConstraintError(f"a value has bounds {low} and {high}; the lower one must not be above the upper")

    @classmethod
    def zero(cls, values: ca.SX) -> "Within":
        """Return values (m, 1) that must be 0: equations."""
        return cls(values, np.zeros(values.numel()), np.zeros(values.numel()))

    @classmethod
    def together(cls, *parts: "Within") -> "Within":
        """Return all values of several, in their order."""
        values = ca.vertcat(ca.SX(0, 1), *(part.values for part in parts))
        lower, upper = ([getattr(part, side) for part in parts] for side in ("lower", "upper"))
        return cls(values, np.concatenate([np.empty(0), *lower]), np.concatenate([np.empty(0), *upper]))

    def inset(self, by: float) -> "Within":
        """Return intervals that are smaller by `by` at both ends, as far as they are that wide; equations stay."""
        kept = np.minimum(by, (self.upper - self.lower) / 2)
        return Within(self.values, self.lower + kept, self.upper - kept)

    def outside(self, numbers: Numbers) -> ca.SX:
        """Return rows (m, 1) that are how far values are outside, with their sign, and 0 inside; bounds are numbers."""
        rows = []
        for value, low, high in zip(ca.vertsplit(self.values), self.lower, self.upper, strict=True):
            if low == high:
                rows.append(value - numbers(low))
                continue
            above = ca.fmax(value - numbers(high), 0) if high < np.inf else ca.SX(0)
            below = ca.fmin(value - numbers(low), 0) if low > -np.inf else ca.SX(0)
            rows.append(above + below)
        return ca.vertcat(ca.SX(0, 1), *rows)

    def slack(self, numbers: Numbers) -> tuple[ca.SX, list[tuple[int, str]]]:
        """Return rows (k, 1) that are at least 0 inside: a row a finite bound; and which value and bound each is of.

        Raises:
            ConstraintError: equal bounds: what holds at one value only is an equation.
        """
        rows, which = [], []
        for i, (value, low, high) in enumerate(zip(ca.vertsplit(self.values), self.lower, self.upper, strict=True)):
            if low == high:
                raise ConstraintError(f"value {i} has equal bounds {low}: that is an equation, not a condition")
            if low > -np.inf:
                rows.append(value - numbers(low))
                which.append((i, f"at least {low:.4g}"))
            if high < np.inf:
                rows.append(numbers(high) - value)
                which.append((i, f"at most {high:.4g}"))
        return ca.vertcat(ca.SX(0, 1), *rows), which
