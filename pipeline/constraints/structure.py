"""Rows F(q, p) as functions, made once for all constraints that differ in their numbers p only.

A height, a hinge or what a hand carries changes with every scene; kinematics do not. What is derived from the rows
(Jacobians, Newton steps, whole edges of a walk, each also as machine code) takes a tenth of a second to many seconds
to make, and is kept here by structure.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import NamedTuple, TypeVar, cast

import casadi as ca
import numpy as np

from pipeline.constraints.compiled import Compiled
from pipeline.constraints.native import native
from pipeline.errors import ConstraintError

Made = TypeVar("Made")
_MOST = 64  # structures that are kept: those of the last tasks


class Expressions(NamedTuple):
    """Arguments and results of a function to be made."""

    arguments: list[ca.SX]
    results: list[ca.SX]


class Structure:
    """F(q, p) and the functions that were made of it. Use `structure_of`.

    Attributes:
        n, k: variables and rows.
        p: the numbers' symbols (p, 1), for expressions that contain rows; functions get them as their last argument.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self.n, self.k, numbers = function.size1_in(0), function.size1_out(0), function.size1_in(1)
        self.p = ca.SX.sym("p", numbers)
        self._made: dict[Hashable, object] = {}

    def rows(self, q: ca.SX) -> ca.SX:
        """Return F as an expression (k, 1) of q (n,) and `p`."""
        return self._function(q, self.p)

    def rows_with(self, q: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return F as an expression (k, 1) of q (n,) and other symbols (p, 1) for the numbers."""
        return self._function(q, numbers)

    def rows_and_jacobian(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return F and dF/dq as expressions (k, 1) and (k, n)."""
        F, J = self._with_jacobian(q, self.p)
        return F, J

    @cached_property
    def _with_jacobian(self) -> ca.Function:
        q = ca.SX.sym("q", self.n)
        F = self.rows(q)
        return ca.Function("F_J", [q, self.p], [F, ca.densify(ca.jacobian(F, q))])

    def compiled(
        self,
        key: tuple[Hashable, ...],
        make: Callable[[], Expressions],
        numbers: np.ndarray,
        columns: int = 1,
        machine: bool | None = False,
        bound: Sequence[np.ndarray | float] = (),
    ) -> Compiled:
        """Return a function with its own arguments and results, whose last arguments are bound to values.

        Args:
            key: its name and all that `make` depends on but this structure.
            make: called once for a key; its results may depend on `p`.
            numbers: values of `p` (p,).
            columns: how many configurations one call takes (see `Compiled`).
            machine: as machine code where there is a C compiler; None: where it was compiled before.
            bound: values of the last arguments that `make` returns, which are bound as well.
        """
        function = self.kept((key, columns), lambda: self._mapped(key, make, columns))
        if machine is not False:
            plain, kept_only = function, machine is None
            made = (key, columns, "kept" if kept_only else "machine")
            function = self.kept(made, lambda: native(plain, kept_only) or plain)
        return Compiled(function, bound=[*bound, *([numbers] if len(numbers) else [])])

    def _mapped(self, key: tuple[Hashable, ...], make: Callable[[], Expressions], columns: int) -> ca.Function:
        def made() -> ca.Function:
            arguments, results = make()
            given = [self.p] if self.p.numel() else []
            return ca.Function(str(key[0]), [*arguments, *given], [ca.densify(result) for result in results])

        function = self.kept((key, 1), made)
        return function.map(columns) if columns > 1 else function

    def kept(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what `make` returned when it was first called for a key."""
        if key not in self._made:
            self._made[key] = make()
        return cast(Made, self._made[key])


_STRUCTURES: OrderedDict[str, Structure] = OrderedDict()


def structure_of(q: ca.SX, rows: ca.SX, symbols: ca.SX, what: str) -> Structure:
    """Return the structure of rows: the same object for rows that differ in the values of their numbers only.

    Args:
        q: the configuration symbol (n, 1).
        rows: as an expression (k, 1).
        symbols: of the numbers (p, 1).
        what: whose rows they are, for the message.

    Raises:
        ConstraintError: they depend on other symbols.
    """
    known = ca.vertcat(q, symbols)
    free = [str(s) for s in ca.symvar(rows) if not ca.depends_on(known, s)]
    if free:
        raise ConstraintError(f"{what} depends on symbols other than its configuration: {free}")
    function = ca.Function("F", [q, symbols], [ca.densify(ca.vec(rows))])
    key = hashlib.sha256(function.serialize().encode()).hexdigest()
    if key not in _STRUCTURES:
        _STRUCTURES[key] = Structure(function)
        if len(_STRUCTURES) > _MOST:
            _STRUCTURES.popitem(last=False)
    _STRUCTURES.move_to_end(key)
    return _STRUCTURES[key]


def forget() -> None:
    """Drop all structures that are kept; those in use go on."""
    _STRUCTURES.clear()
