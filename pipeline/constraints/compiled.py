"""CasADi functions called through buffers that are allocated once: a fifth of the price of an ordinary call."""

from collections.abc import Sequence

import casadi as ca
import numpy as np


class Compiled:
    """A CasADi function with fixed argument and result arrays.

    A matrix of shape (r, c) in CasADi is an array (c, r) here, because CasADi stores columns and numpy rows: batches
    are columns there and rows here. Vectors are (r,). Results are the same arrays at every call: copy what must stay.

    Args:
        function: of dense arguments and results.
        bound: values of its last arguments, which stay; they are not among `arguments`. One value serves all columns.
    """

    def __init__(self, function: ca.Function, bound: Sequence[np.ndarray | float] = ()) -> None:
        self.function = function
        self._buffer, self._evaluate = self.function.buffer()
        count_in, count_out = self.function.n_in(), self.function.n_out()
        arguments = tuple(_array(self.function.size_in(i)) for i in range(count_in))
        self.results = tuple(_array(self.function.size_out(i)) for i in range(count_out))
        self.arguments, self._bound = arguments[: count_in - len(bound)], arguments[count_in - len(bound) :]
        for array, value in zip(self._bound, bound, strict=True):
            array[...] = value
        for i, array in enumerate(arguments):
            self._buffer.set_arg(i, memoryview(array))  # type: ignore[call-arg, arg-type]  # casadi's stub is of C++
        for i, array in enumerate(self.results):
            self._buffer.set_res(i, memoryview(array))  # type: ignore[call-arg, arg-type]

    def __call__(self, *values: np.ndarray | float) -> tuple[np.ndarray, ...]:
        """Evaluate at `values` and return the result arrays (overwritten by the next call)."""
        for array, value in zip(self.arguments, values, strict=True):
            array[...] = value
        return self.evaluate()

    def evaluate(self) -> tuple[np.ndarray, ...]:
        """Evaluate at what stands in `arguments`."""
        self._evaluate()
        return self.results


def _array(size: tuple[int, int]) -> np.ndarray:
    rows, columns = size
    return np.zeros(rows) if columns == 1 else np.zeros((columns, rows))
