"""Shortcuts that stay on the manifold."""

import time

import numpy as np

from pipeline.manifolds import Adherence
from pipeline.planners.base import path_length


def shortcut(
    space: Adherence, path: np.ndarray, rng: np.random.Generator, attempts: int, until: float = np.inf
) -> np.ndarray:
    """Return a path (T, n) with the same ends that is never longer.

    Each attempt walks on the manifold between two random states of the path; a shorter way that holds at the finer
    resolution replaces the states in between.

    Args:
        space: the manifold and scene of the path.
        path: valid states (T, n), neighbours at most a leap apart.
        rng: of the pairs to try.
        attempts: how many pairs to try.
        until: when to stop trying, by time.perf_counter() [s].
    """
    for _ in range(attempts):
        if len(path) < 4 or time.perf_counter() >= until:
            return path
        i, j = np.sort(rng.choice(len(path), 2, replace=False)).tolist()
        if j - i < 2:
            continue
        walk = space.traverse(path[i], path[j])
        if not walk.reached:
            continue
        way = np.concatenate([path[i : i + 1], walk.states])
        if path_length(way) >= path_length(path[i : j + 1]):
            continue
        refined = space.refine(way)
        if refined.invalid is None and path_length(refined.states) < path_length(path[i : j + 1]):
            path = np.concatenate([path[:i], refined.states, path[j + 1 :]])
    return path
