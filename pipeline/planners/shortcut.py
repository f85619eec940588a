"""Shortcuts that stay on the manifold."""

import numpy as np

from pipeline.manifolds import Adherence, OutOfTime
from pipeline.planners.base import path_length


def shortcut(
    space: Adherence, path: np.ndarray, rng: np.random.Generator, attempts: int, until: float = np.inf
) -> np.ndarray:
    """Return a path (T, n) with the same ends that is never longer; where joints turn, the end may be turns away.

    Each attempt walks on the manifold between two random states of the path; a shorter way that holds at the finer
    resolution replaces the states in between.

    Args:
        space: the manifold and scene of the path.
        path: valid states (T, n), neighbours at most a leap apart.
        rng: of the pairs to try.
        attempts: how many pairs to try.
        until: when to stop trying, also within an attempt, by time.perf_counter() [s].
    """
    with space.deadline.until(until):
        for _ in range(attempts):
            if len(path) < 4:
                break
            try:
                space.deadline.look()
                path = _shorter(space, path, rng)
            except OutOfTime:
                break
    return path


def _shorter(space: Adherence, path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the path (T, n) with a shorter way between two of its states, or as it is."""
    i, j = np.sort(rng.choice(len(path), 2, replace=False)).tolist()
    if j - i < 2:
        return path
    walk = space.traverse(path[i], path[j])
    if not walk.reached:
        return path
    way = np.concatenate([path[i : i + 1], walk.states])
    if path_length(way) >= path_length(path[i : j + 1]):
        return path
    refined = space.refine(way)
    if refined.invalid is None and path_length(refined.states) < path_length(path[i : j + 1]):
        states = np.concatenate([path[:i], refined.states, path[j + 1 :]])
        return states if space.turns is None else space.turns.unwrapped(states)
    return path
