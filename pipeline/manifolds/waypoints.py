"""Paths with more states."""

import numpy as np

from pipeline.manifolds.base import Adherence
from pipeline.manifolds.polyline import brought_back, polyline


def dense(space: Adherence, path: np.ndarray, spacing: float) -> np.ndarray:
    """Return a path (T, n) with states on the manifold put in, so that neighbours are at most about `spacing` apart."""
    gaps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    pieces = np.maximum(np.ceil(gaps / spacing).astype(int), 1)
    segment = np.repeat(np.arange(len(pieces)), pieces)
    first = np.cumsum(pieces) - pieces
    share = (np.arange(len(segment)) - first[segment]) / pieces[segment]
    between = share > 0
    points = path[segment] + share[:, None] * (path[segment + 1] - path[segment])
    points[between] = space.constraint.project_batch(points[between])[0]
    inside = np.clip(points, space.lower, space.upper)
    # A way along a limit bends a hair beyond it; a state that clipping would take off the manifold is left out.
    kept = ~between | ((space.constraint.value_batch(inside) ** 2).sum(axis=1) < space.constraint.tolerance**2)
    return np.concatenate([inside[kept], path[-1:]])


def joined(space: Adherence, path: np.ndarray) -> np.ndarray:
    """Return a path (T, n) as a polyline within the tolerance of the manifold: states are moved nearer, some put in.

    For paths of others, whose states are within the tolerance and the lines between them not always. One that cannot be
    joined is returned as it is.
    """
    states, converged = brought_back(space.constraint, path)
    states = np.clip(states, space.lower, space.upper)
    line = polyline(space.constraint, states, space.lower, space.upper)
    return line.states if line.broken is None and converged.all() else path
