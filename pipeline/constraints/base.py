"""Implicit constraints F(q, p) = 0, each written once as a CasADi expression, with numbers p of its own.

From the one expression come the value, the Jacobian, the Newton step of Algorithm 1 (compnetx.txt, section II-B), the
batch version, the symbolic step inside whole-edge functions, and OMPL's callbacks.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from pipeline.constraints.compiled import Compiled
from pipeline.constraints.structure import Expressions, structure_of
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers

_RANK_TOLERANCE = 1e-8  # a singular value below this share of the largest counts as zero
_INVOLVED = 0.05  # a row's share in a combination of rows, from which on a message names it
_EVALUATED = ("_value", "_jacobian", "_step", "_value_block", "_step_block")
_BLOCK = 64  # most configurations per batch call: larger blocks gain nothing, smaller ones pay the call
_INSTRUCTIONS = 4096  # of a batch call: long expressions need no large block, whose empty rows they would pay for


@dataclass(frozen=True)
class Projection:
    """Outcome of a projection.

    Attributes:
        q: the last configuration (n,).
        converged: whether ||F(q)|| is below the tolerance.
        iterations: Newton steps taken.
    """

    q: np.ndarray
    converged: bool
    iterations: int


class Constraint:
    """An implicit constraint F(q) = 0 with k rows on n variables, 0 < k < n.

    Args:
        name: how errors and reports call it.
        q: the configuration symbol (n, 1).
        expression: F as an expression of q (k, 1), in metres and radians.
        tolerance: q counts as on the manifold when ||F(q)||_2 is below it (0.001: compnetx.txt, appendix D).
        max_iterations: of Algorithm 1 (50: compnetx.txt, appendix D).
        labels: what each row says, for messages (k,).
        numbers: those that `expression` takes as arguments. Constraints that differ in their values only share all that
            is made of the expression (see `Structure`).

    Raises:
        ConstraintError: wrong shapes, free symbols other than q and numbers, or no positive tolerance.
    """

    def __init__(
        self,
        name: str,
        q: ca.SX,
        expression: ca.SX,
        tolerance: float = 1e-3,
        max_iterations: int = 50,
        labels: Sequence[str] = (),
        numbers: Numbers | None = None,
    ) -> None:
        self.name = name
        self.n, self.k = q.numel(), expression.numel()
        self.labels = tuple(labels) or tuple(f"{name}[{i}]" for i in range(self.k))
        if not 0 < self.k < self.n:
            raise ConstraintError(
                f"constraint {name!r} has {self.k} rows on {self.n} variables; a manifold needs 0 < rows < variables: "
                f"{'; '.join(self.labels)}"
            )
        if len(self.labels) != self.k:
            raise ConstraintError(f"constraint {name!r} has {self.k} rows and {len(self.labels)} labels")
        if not 0 < tolerance < np.inf:
            raise ConstraintError(f"constraint {name!r} has tolerance {tolerance}; it must be finite and above 0")
        if max_iterations < 1:
            raise ConstraintError(f"constraint {name!r} has {max_iterations} iterations; it needs at least 1")
        numbers = numbers or Numbers()
        self.numbers, self.said = numbers.values, numbers.said
        self.structure = structure_of(q, expression, numbers.symbols, f"constraint {name!r}")
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self._machine: bool | None = False

    @property
    def manifold_dimension(self) -> int:
        """n - k, where the constraint has full rank."""
        return self.n - self.k

    def prepare(self, native: bool | None = False) -> None:
        """Make the functions that evaluate it now, not within the time limit of a first plan.

        With `native` they are machine code from now on, where a C compiler is found, with None where they were compiled
        before; results stay the same.
        """
        if native is not False and self._machine is False:
            self._machine = native
            for name in _EVALUATED:
                self.__dict__.pop(name, None)  # those made before
        for name in _EVALUATED:
            getattr(self, name)

    def rows(self, q: ca.SX, numbers: Numbers) -> ca.SX:
        """Return F as an expression (k, 1) of q (n,), for an expression that takes `numbers` as arguments."""
        return self.structure.rows_with(q, numbers.arguments(self.numbers, self.said))

    def newton(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return F and the next iterate q - J^+ F (Algorithm 1, line 6) as expressions of q and the structure's p."""
        F, J = self.structure.rows_and_jacobian(q)
        return F, q - J.T @ ca.solve(J @ J.T, F)

    def projected(self, q: ca.SX, iterations: int, squared: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return Algorithm 1 unrolled: the configuration after at most `iterations` steps, and its ||F||^2.

        As in the algorithm an iterate within the tolerance, of which `squared` is the square, is left as it is.
        """
        for _ in range(iterations):
            F, following = self.newton(q)
            q = ca.if_else(ca.sumsqr(F) < squared, q, following)
        return q, ca.sumsqr(self.structure.rows(q))

    def compiled(
        self,
        key: tuple[Hashable, ...],
        make: Callable[[], Expressions],
        columns: int = 1,
        machine: bool | None = False,
        bound: Sequence[np.ndarray | float] = (),
    ) -> Compiled:
        """Return a function of this constraint's numbers that others of its structure share (`Structure.compiled`)."""
        return self.structure.compiled(key, make, self.numbers, columns, machine, bound)

    def value(self, q: np.ndarray) -> np.ndarray:
        """Return F(q) (k,)."""
        return self._value(q)[0].copy()

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return dF/dq (k, n)."""
        return self._jacobian(q)[0].reshape(self.k, self.n).copy()

    def distance(self, q: np.ndarray) -> float:
        """Return ||F(q)||_2."""
        return float(np.linalg.norm(self._value(q)[0]))

    def satisfied(self, q: np.ndarray) -> bool:
        """True when ||F(q)||_2 is below the tolerance; False for a q that is not finite."""
        return self.distance(q) < self.tolerance

    def project(self, q: np.ndarray) -> Projection:
        """Project q (n,) onto the manifold (Algorithm 1). Idempotent: a q within the tolerance comes back as it is."""
        step = self._step
        q = np.array(q, float)
        squared = self.tolerance**2
        for iteration in range(self.max_iterations):
            following, violation = step(q)
            if violation[0] < squared:
                return Projection(q, True, iteration)
            q = following.copy()
        return Projection(q, self.satisfied(q), self.max_iterations)

    def value_batch(self, Q: np.ndarray) -> np.ndarray:
        """Return F of every row of Q (N, n) as (N, k)."""
        found = np.empty((len(Q), self.k))
        for first in range(0, len(Q), self.block):
            block = Q[first : first + self.block]
            self._value_block.arguments[0][: len(block)] = block
            found[first : first + self.block] = self._value_block.evaluate()[0].reshape(-1, self.k)[: len(block)]
        return found

    def project_batch(
        self, Q: np.ndarray, iterations: int | None = None, tolerance: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Project every row of Q (N, n) by Algorithm 1; return the configurations (N, n) and which converged (N,).

        Takes at most `iterations` steps, `max_iterations` unless given, until ||F|| is below `tolerance`, the
        constraint's own unless given.
        """
        squared = (self.tolerance if tolerance is None else tolerance) ** 2
        most = self.max_iterations if iterations is None else iterations
        Q = np.array(Q, float)
        converged = np.zeros(len(Q), bool)
        for first in range(0, len(Q), self.block):
            rows = slice(first, min(first + self.block, len(Q)))
            count = rows.stop - rows.start
            block = self._step_block
            block.arguments[0][:count] = Q[rows]
            for iteration in range(most + 1):
                following, violation = block.evaluate()
                done = violation.reshape(-1)[:count] < squared
                if done.all() or iteration == most:
                    break
                block.arguments[0][:count] = np.where(done[:, None], block.arguments[0][:count], following[:count])
            Q[rows], converged[rows] = block.arguments[0][:count], done
            block.arguments[0][...] = block.arguments[0][0]
        return Q, converged

    def frame(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return orthonormal bases of the tangent space (n, n - k) and the normal space (n, k) at q.

        The tangent basis solves eq. (1) of compnetx.txt: J Phi = 0, Phi^T Phi = I.

        Raises:
            ConstraintError: the Jacobian at q has rank below k or is not finite, so there is no manifold of dimension
                n - k there.
        """
        J = self.jacobian(q)
        if not math.isfinite(J.sum()):
            raise ConstraintError(f"constraint {self.name!r} has no finite Jacobian at q = {on_one_line(q)}")
        U, singular, V, failed = lapack.dgesdd(J)  # what numpy calls, without what it wraps around
        if failed:
            raise np.linalg.LinAlgError("SVD did not converge")
        least = _RANK_TOLERANCE * max(singular[0], 1.0)
        if not singular[-1] > least:
            kept = singular > least
            raise ConstraintError(
                f"constraint {self.name!r} has rank {int(kept.sum())} of {self.k} at q = "
                f"{on_one_line(q)}: {_dependent(U[:, ~kept], self.labels)}; singular values "
                f"{on_one_line(singular)}"
            )
        return np.ascontiguousarray(V[self.k :].T), np.ascontiguousarray(V[: self.k].T)

    @cached_property
    def _value(self) -> Compiled:
        return self.compiled(("F",), self._made_value, machine=self._machine)

    @cached_property
    def _jacobian(self) -> Compiled:
        def make() -> Expressions:
            q = ca.SX.sym("q", self.n)
            return Expressions([q], [self.structure.rows_and_jacobian(q)[1].T])

        return self.compiled(("J",), make, machine=self._machine)

    @cached_property
    def _step(self) -> Compiled:
        return self.compiled(("newton",), self._made_step, machine=self._machine)

    @cached_property
    def block(self) -> int:
        """How many configurations a batch takes at a time."""
        one = self.compiled(("newton",), self._made_step)  # whatever evaluates it: batches are the same
        return int(np.clip(_INSTRUCTIONS // one.function.n_instructions(), 4, _BLOCK))

    @cached_property
    def _step_block(self) -> Compiled:
        return self.compiled(("newton",), self._made_step, self.block, self._machine)

    @cached_property
    def _value_block(self) -> Compiled:
        return self.compiled(("F",), self._made_value, self.block, self._machine)

    def _made_value(self) -> Expressions:
        q = ca.SX.sym("q", self.n)
        return Expressions([q], [self.structure.rows(q)])

    def _made_step(self) -> Expressions:
        q = ca.SX.sym("q", self.n)
        F, following = self.newton(q)
        return Expressions([q], [following, ca.sumsqr(F)])


def on_one_line(values: np.ndarray) -> str:
    """Return numbers (m,) for a message."""
    return np.array2string(values, precision=4, max_line_width=10**6)


def _dependent(combinations: np.ndarray, labels: Sequence[str]) -> str:
    """Name the rows in combinations (k, m) of rows whose derivatives cancel."""
    involved = [label for label, weights in zip(labels, combinations, strict=True) if np.abs(weights).max() > _INVOLVED]
    if len(involved) == 1:
        return f"row {involved[0]!r} does not change with q there"
    return f"rows {', '.join(map(repr, involved))} depend on each other there"
