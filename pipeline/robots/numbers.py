"""Numbers that expressions take as arguments: tasks that differ in these alone share their compiled functions."""

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.robots.symbolic import DECIMALS, Pose

_KEPT = (0.0, 1.0, -1.0)  # what makes an expression shorter stays part of it


class Numbers:
    """Collects the numbers of an expression: a height, a direction, where a hinge stands.

    0, 1 and -1 stay constants, because they make expressions shorter. So tasks of which one has such a number where the
    other has not do not share functions.
    """

    def __init__(self) -> None:
        self._symbols: list[ca.SX] = []
        self._values: list[float] = []
        self._said: list[float] = []

    def __call__(self, values: np.ndarray | float) -> ca.SX:
        """Return numbers, a scalar, vector (r,) or matrix (r, c), as an expression of the same shape."""
        array = np.atleast_1d(np.asarray(values, float))
        array = array[:, None] if array.ndim == 1 else array
        found = ca.SX(*array.shape)
        for place, value in np.ndenumerate(array):
            self._said.append(float(value))
            if value in _KEPT:
                if value:
                    found[place] = value
                continue
            found[place] = self._symbol(value)
        return found

    def pose(self, placement: pin.SE3) -> Pose:
        """Return a fixed pose as an expression; rounded as by `constant`."""
        rotation, position = (np.round(part, DECIMALS) for part in (placement.rotation, placement.translation))
        return Pose(self(rotation), self(position))

    def arguments(self, values: np.ndarray, said: np.ndarray | None = None) -> ca.SX:
        """Return as many arguments as there are values (m,), whatever these are.

        Args:
            values: of the arguments.
            said: what `said` was where they come from; None where all of them are arguments.
        """
        self._said += (values if said is None else said).tolist()
        return ca.vertcat(*(self._symbol(value) for value in values.tolist()))

    @property
    def symbols(self) -> ca.SX:
        """The arguments so far (p, 1)."""
        return ca.vertcat(ca.SX(0, 1), *self._symbols)

    @property
    def values(self) -> np.ndarray:
        """Their values (p,)."""
        return np.array(self._values)

    @property
    def said(self) -> np.ndarray:
        """All numbers that were given, in their order (s,), those that stayed constants among them.

        Where expressions are made in the same way, tasks whose numbers are equal here are equal.
        """
        return np.array(self._said)

    def _symbol(self, value: float) -> ca.SX:
        symbol = ca.SX.sym(f"p{len(self._values)}")
        self._symbols.append(symbol)
        self._values.append(float(value))
        return symbol
