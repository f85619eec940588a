"""Joints that turn without end: an angle and the same angle a turn later are one place.

Configurations stay vectors of R^n, and a path is continuous in them. What knows that angles come round is the
difference of two configurations (`Turning.wrapped`), which everything that measures, looks for neighbours or walks
takes; a robot without such joints has no `Turning` and pays nothing but the question.

A joint with limits does not turn in this sense, however many turns lie between them: there is no way around beyond a
limit (a cable). Such an angle is another place a turn later, but a goal may be any of them (`turns_within`).
"""

import itertools

import numpy as np

TURN = 2 * np.pi


class Turning:
    """The variables of a configuration that turn.

    Args:
        mask: which those are (n,); at least one.
    """

    def __init__(self, mask: np.ndarray) -> None:
        self.mask = np.asarray(mask, bool)
        self.places = np.flatnonzero(self.mask)
        self.periods = np.where(self.mask, TURN, 0.0)  # (n,), 0 for none, as k-d trees take them

    def wrapped(self, differences: np.ndarray) -> np.ndarray:
        """Return differences of configurations (..., n) with angles in (-pi, pi]; infinite ones stay as they are."""
        found = np.array(differences, float)
        angles = found[..., self.places]
        with np.errstate(invalid="ignore"):
            near = angles - TURN * _turns(angles)
        found[..., self.places] = np.where(np.isfinite(angles), near, angles)
        return found

    def distances(self, Q: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return how far configurations Q (..., n) are from q (..., n) [rad or m]."""
        found: np.ndarray = np.linalg.norm(self.wrapped(Q - q), axis=-1)
        return found

    def nearest(self, q: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return q (..., n) at the turns nearest to `near` (..., n); unchanged to the last bit where it is there."""
        turns = _turns((q - near)[..., self.places])
        if not turns.any():
            return q
        found = np.array(q, float)
        found[..., self.places] -= TURN * turns
        return found

    def canonical(self, q: np.ndarray) -> np.ndarray:
        """Return q (..., n) at the turns where all angles are in (-pi, pi]."""
        return self.nearest(q, np.zeros_like(q))

    def folded(self, Q: np.ndarray) -> np.ndarray:
        """Return Q (..., n) with angles in [0, 2 pi), as k-d trees with `periods` take them."""
        found = np.array(Q, float)
        angles = found[..., self.places] % TURN
        found[..., self.places] = np.where(angles < TURN, angles, 0.0)  # the remainder of -1e-20 is rounded to a turn
        return found

    def unwrapped(self, states: np.ndarray) -> np.ndarray:
        """Return a path (T, n) from the same first state without jumps by whole turns between neighbours."""
        turns = _turns(np.diff(states[:, self.places], axis=0))
        if not turns.any():
            return states
        found = np.array(states, float)
        found[1:, self.places] -= TURN * np.cumsum(turns, axis=0)
        return found


def _turns(angles: np.ndarray) -> np.ndarray:
    """Return how many whole turns an angle is away from (-pi, pi]."""
    return np.ceil((angles - np.pi) / TURN)


def turns_within(
    q: np.ndarray, lower: np.ndarray, upper: np.ndarray, angles: np.ndarray, near: np.ndarray, most: int
) -> np.ndarray:
    """Return q (n,) at all turns of some joints that lie within limits, nearest to a configuration first (m, n).

    Args:
        q: a configuration, whose other joints stay as they are.
        lower: limits (n,), finite for those joints.
        upper: likewise.
        angles: which joints (n,).
        near: a configuration (n,).
        most: how many at most: the nearest.
    """
    offered: list[tuple[float, tuple[float, ...]]] = [(0.0, ())]  # squared distances and values, of the joints so far
    for value, low, high, wanted, turns in zip(q, lower, upper, near, angles, strict=True):
        values = [float(value)]
        if turns:
            first, last = int(np.ceil((low - value) / TURN)), int(np.floor((high - value) / TURN))
            values = [float(value + TURN * k) for k in range(first, last + 1)]
        # Only the nearest so far: what comes after is the same for all, so that these are among the nearest in the end.
        longer = itertools.product(offered, values)
        nearest = sorted((square + (v - wanted) ** 2, (*before, v)) for (square, before), v in longer)
        offered = nearest[:most]
    return np.array([values for _, values in offered], float).reshape(-1, len(q))
