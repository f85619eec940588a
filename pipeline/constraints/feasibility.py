"""Whether a constraint has solutions within joint limits, and if not, which rows fail."""

import numpy as np
from scipy.optimize import least_squares

from pipeline.constraints.base import Constraint, on_one_line
from pipeline.errors import ConstraintError

_SOLVES = 20  # least-squares problems before giving up


def feasible(
    constraint: Constraint, lower: np.ndarray, upper: np.ndarray, rng: np.random.Generator, tries: int = 200
) -> np.ndarray:
    """Return a configuration (n,) on the manifold and within limits, at which the constraint has full rank.

    Projects random configurations; where none of them ends within the limits, solves bounded least squares.

    Args:
        constraint: to be met.
        lower: joint limits (n,) [rad or m].
        upper: likewise.
        rng: of the random configurations.
        tries: how many are projected.

    Raises:
        ConstraintError: none is found (names the rows that fail, and where), or the rows depend on each other.
    """
    Q = rng.uniform(lower, upper, (tries, constraint.n))
    with np.errstate(all="ignore"):
        X, converged = constraint.project_batch(Q)
        good = converged & ((X >= lower) & (X <= upper)).all(axis=1)
    if good.any():
        q = X[int(np.argmax(good))]
    else:
        q = _least(constraint, lower, upper, Q[:_SOLVES])
        if not constraint.satisfied(q):
            raise ConstraintError(infeasible(constraint, q))
    constraint.frame(q)
    return q


def infeasible(constraint: Constraint, q: np.ndarray) -> str:
    """Return a message: the rows that q (n,), the best that was found, does not meet."""
    F = constraint.value(q)
    enough = constraint.tolerance / np.sqrt(constraint.k)  # rows all below it are below the tolerance together
    failing = [
        f"{label} by {value:.4g}" for label, value in zip(constraint.labels, F, strict=True) if abs(value) > enough
    ]
    return (
        f"no configuration within the joint limits meets constraint {constraint.name!r}; the best that was found, q = "
        f"{on_one_line(q)}, misses {'; '.join(failing)}"
    )


def _least(constraint: Constraint, lower: np.ndarray, upper: np.ndarray, starts: np.ndarray) -> np.ndarray:
    best, least = starts[0], np.inf
    for start in starts:
        apart = np.maximum(upper, lower + 1e-9)  # least_squares takes no equal bounds
        found = least_squares(constraint.value, start, jac=constraint.jacobian, bounds=(lower, apart), xtol=1e-12)
        if 2 * found.cost < least:
            best, least = found.x, 2 * found.cost
        if least < (constraint.tolerance / 2) ** 2:
            break
    return best
