"""States of a path such that the straight lines between them stay on the manifold, within its tolerance."""

from typing import NamedTuple

import numpy as np

from pipeline.constraints import Constraint

TIGHT = 0.25  # share of the tolerance that states are brought to: the rest is for the chords between them
_KEPT = 0.95  # of the tolerance, that what is seen of a chord stays below
_SHARES = np.array([0.25, 0.5, 0.75])  # of a chord, at which its distance from the manifold is looked at
# Of values at the beginning, the middle and the end of a chord: the parabola through them at these shares (3, 3).
_PARABOLA = np.stack([(1 - _SHARES) * (1 - 2 * _SHARES), 4 * _SHARES * (1 - _SHARES), _SHARES * (2 * _SHARES - 1)], 1)
_HALVINGS = 6  # of a chord at most: its distance from the manifold falls to a quarter each time
_SIDE = 0.75  # a state put into a chord is nearer to both of its ends than this share of its length, or there is a jump


class Polyline(NamedTuple):
    """A path as the polyline of its states.

    Attributes:
        states: (M, n), the given ones and those put in between.
        segments: the given segment that each chord is part of (M - 1,).
        broken: the first given segment that cannot be followed; None where there is none.
    """

    states: np.ndarray
    segments: np.ndarray
    broken: int | None


def brought_back(constraint: Constraint, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project the states of a path (T, n) that are not tightly on the manifold; return them, and which converged (T,).

    The first and the last one are given by the problem: they stay where they are, if within the tolerance.
    """
    off = np.linalg.norm(constraint.value_batch(states), axis=1)
    least = np.full(len(states), TIGHT * constraint.tolerance)
    least[[0, -1]] = constraint.tolerance
    rows = np.flatnonzero(~(off < least))
    converged = np.ones(len(states), bool)
    if len(rows):
        states = states.copy()
        states[rows], converged[rows] = constraint.project_batch(states[rows], tolerance=TIGHT * constraint.tolerance)
    return states, converged


def polyline(constraint: Constraint, states: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> Polyline:
    """Put states between those given (T, n), on the manifold, until all chords are within the tolerance of it.

    Args:
        constraint: of the manifold.
        states: on the manifold, within the limits.
        lower: limits (n,); a state that is put in is moved to them where the manifold bends beyond.
        upper: likewise.
    """
    segments = np.arange(len(states) - 1)
    values = constraint.value_batch(states)  # (T, k)
    open_chords = np.ones(len(segments), bool)
    for halvings in range(_HALVINGS + 1):
        asked = np.flatnonzero(open_chords)
        middles = (states[asked] + states[asked + 1]) / 2
        at_middles = constraint.value_batch(middles)
        ends = np.stack([values[asked], at_middles, values[asked + 1]], axis=1)  # (C, 3, k)
        worst = np.linalg.norm(np.einsum("sj,cjk->csk", _PARABOLA, ends), axis=2).max(axis=1, initial=0.0)
        bent = ~(worst < _KEPT * constraint.tolerance)
        if not bent.any():
            break
        asked, middles = asked[bent], middles[bent]
        if halvings == _HALVINGS:
            return Polyline(states, segments, int(segments[asked[0]]))
        found, converged = constraint.project_batch(middles, tolerance=TIGHT * constraint.tolerance)
        found = np.clip(found, lower, upper)
        at_found = constraint.value_batch(found)
        sides = [np.linalg.norm(found - states[asked + i], axis=1) for i in (0, 1)]
        lengths = np.linalg.norm(states[asked + 1] - states[asked], axis=1)
        sound = converged & (np.linalg.norm(at_found, axis=1) < constraint.tolerance)
        sound &= np.maximum(*sides) <= _SIDE * lengths
        if not sound.all():
            return Polyline(states, segments, int(segments[asked[int(np.argmin(sound))]]))
        open_chords = np.zeros(len(segments), bool)
        open_chords[asked] = True
        open_chords = np.insert(open_chords, asked, True)
        states, values = np.insert(states, asked + 1, found, axis=0), np.insert(values, asked + 1, at_found, axis=0)
        segments = np.insert(segments, asked, segments[asked])
    return Polyline(states, segments, None)


def subdivided(path: np.ndarray, spacing: float) -> np.ndarray:
    """Return a path (T, n) with states put onto its chords, so that neighbours are at most `spacing` apart."""
    gaps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    pieces = np.maximum(np.ceil(gaps / spacing - 1e-9).astype(int), 1)
    segment = np.repeat(np.arange(len(pieces)), pieces)
    first = np.cumsum(pieces) - pieces
    share = (np.arange(len(segment)) - first[segment]) / pieces[segment]
    points = path[segment] + share[:, None] * (path[segment + 1] - path[segment])
    return np.concatenate([points, path[-1:]])
