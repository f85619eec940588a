"""No constraint: every configuration will do."""

from typing import Any

import casadi as ca
import numpy as np

from pipeline.constraints.base import Constraint, Projection
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers

_BLOCK = 64  # configurations per batch; there is nothing to compute


class Unconstrained(Constraint):
    """A constraint without rows, for those who ask one: all configurations are on the manifold, of full dimension.

    Args:
        variables: of a configuration.
        tolerance: that it would be met within.
    """

    def __init__(self, variables: int, tolerance: float = 1e-3) -> None:
        self.name, self.labels = "free space", ()
        self.n, self.k, self.tolerance, self.max_iterations = variables, 0, tolerance, 1
        self.numbers = self.said = np.empty(0)

    @property
    def block(self) -> int:
        """How many configurations a batch takes at a time."""
        return _BLOCK

    def prepare(self, native: bool | None = False) -> None:
        """Do nothing: there is nothing to make."""
        del native

    def rows(self, q: ca.SX, numbers: Numbers) -> ca.SX:
        """Return an expression without rows (0, 1)."""
        del q, numbers
        return ca.SX(0, 1)

    def value(self, q: np.ndarray) -> np.ndarray:
        """Return no values (0,)."""
        del q
        return np.empty(0)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return no derivatives (0, n)."""
        return np.empty((0, len(q)))

    def distance(self, q: np.ndarray) -> float:
        """Return 0; NaN for a q that is not finite, so that it does not count as satisfied."""
        return 0.0 if np.isfinite(q).all() else float("nan")

    def project(self, q: np.ndarray) -> Projection:
        """Return q (n,) as it is."""
        return Projection(np.array(q, float), self.satisfied(q), 0)

    def value_batch(self, Q: np.ndarray) -> np.ndarray:
        """Return no values (N, 0)."""
        return np.empty((len(Q), 0))

    def project_batch(
        self, Q: np.ndarray, iterations: int | None = None, tolerance: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Q (N, n) as it is, and that all have converged (N,)."""
        del iterations, tolerance
        return np.array(Q, float), np.isfinite(Q).all(axis=1)

    def frame(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the tangent space (n, n), which is everything, and no normal space (n, 0)."""
        return np.eye(len(q)), np.empty((len(q), 0))

    def compiled(self, *arguments: Any, **keywords: Any) -> Any:
        """Refuse: adherence methods are for constraints, free space has one of its own."""
        raise ConstraintError("free space has no constraint, of which a function could be compiled")
