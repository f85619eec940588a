"""Whether the chords of a path are free: proven everywhere along them, not only at points of them.

A configuration at which all bodies keep a reserve from what they must not meet proves the part of the path around it in
which no body moves farther than its reserve. How far that is follows from bounds on their speed along the path
(`Displacement`). Reserves come in classes, each half of the one before it: small ones for narrow scenes.
"""

from bisect import bisect_right

import numpy as np

from pipeline.manifolds.deadline import Deadline
from pipeline.manifolds.displacement import Displacement
from pipeline.robots import Validity

CLEARANCE = 1e-4  # where a body comes nearer than this to what it must not meet, a path does not count as free [m]
_LARGEST = (
    0.04  # reserve of the body that moves fastest, in the largest class [m]; with twice as much a query costs twice
)
_TRUSTED = 4  # proofs in a row by a class, after which the next larger one is tried
_FIRST = 1  # class to begin with
_USUAL = 4  # classes that suffice for nine paths in ten of the families of tasks, corridors aside
_LEAST = 0.02  # reserve of a body that hardly moves, as a share of the largest
_NOTHING = 1e-12  # a way as short is none


class ChordProof:
    """Proves that paths of a robot are free in one scene. Lives in one process.

    Margins of the scene are not asked for: what is proven is that there is no contact but that of pairs which may
    touch, and that all conditions hold.

    Args:
        validity: of the scene.
        displacement: of the robot; made once for all of its scenes.
        typical: how fast bodies move along a typical chord, by relation [m]. Reserves have this shape, so that none is
            used up long before the others.
        parts: of every chord, on which speeds are bounded.
    """

    def __init__(self, validity: Validity, displacement: Displacement, typical: np.ndarray, parts: int = 1) -> None:
        self.validity, self._displacement, self._parts = validity, displacement, parts
        largest = typical.max(initial=_NOTHING)
        self._shape = np.maximum(typical / largest, _LEAST)  # (relations,)
        self._reserves = [_LARGEST]
        while self._reserves[-1] > CLEARANCE:
            self._reserves.append(self._reserves[-1] / 2)
        self._checkers: dict[int, Validity] = {}  # by class, made when it is first asked

    @property
    def checks(self) -> int:
        """Collision queries so far."""
        return sum(checker.checks for checker in self._checkers.values())

    def prepare(self) -> None:
        """Make the checkers that most paths ask, which otherwise the first one does, at a millisecond each."""
        for size in range(_USUAL):
            self._checker(size)

    def allows(self, q: np.ndarray) -> bool:
        """Tell whether a path can begin or end at q (n,): nothing is nearer than `CLEARANCE`."""
        # What keeps more is asked first: its checkers are there already, and the smallest takes milliseconds to make.
        return any(self._checker(size).free(q) for size in (_FIRST, _FIRST + 1, len(self._reserves) - 1))

    def first_gap(self, states: np.ndarray, deadline: Deadline | None = None) -> int | None:
        """Return the first i for which the chord from states[i] to states[i + 1], rows of (T, n), is not proven.

        Raises:
            OutOfTime: the deadline passed before that was known.
        """
        deadline = deadline or Deadline()
        gaps = [condition.first_gap(states) for condition in self.validity.conditions]
        unmet = min((gap for gap in gaps if gap is not None), default=None)
        gap = self._first_contact(states if unmet is None else states[: unmet + 1], deadline)
        return unmet if gap is None else gap

    def _first_contact(self, states: np.ndarray, deadline: Deadline) -> int | None:
        finite = np.isfinite(states).all(axis=1)
        if not finite.all():
            return max(int(np.argmin(finite)) - 1, 0)
        states = cut(states, self._parts)
        steps = np.diff(states, axis=0)
        # As shares of the shape: where this has grown by a class's reserve, one of the bodies may have used up its own.
        ways = (self._displacement.rates(states) / self._shape).max(axis=1, initial=0.0)
        along = [0.0, *np.cumsum(ways).tolist()]
        end, last, smallest = along[-1], len(steps) - 1, len(self._reserves) - 1
        proven, size, held = 0.0, _FIRST, 0
        while proven < end:
            deadline.look()
            following = min(proven + 2 * self._reserves[size], end)
            middle = (proven + following) / 2
            i = min(bisect_right(along, middle) - 1, last)
            share = (middle - along[i]) / max(along[i + 1] - along[i], _NOTHING)
            if self._checker(size).free(states[i] + share * steps[i]):
                proven, held = following, held + 1
                if held == _TRUSTED and size:
                    size, held = size - 1, 0
            elif size == smallest:
                return i // self._parts
            else:
                size, held = size + 1, 0
        return None

    def _checker(self, size: int) -> Validity:
        if size not in self._checkers:
            of = self._displacement
            reserves = np.append(self._reserves[size] * self._shape, 0.0)  # -1 finds the last: of no relation
            self._checkers[size] = self.validity.reserving(reserves[of.of_bodies], reserves[of.of_pairs].sum(axis=1))
        return self._checkers[size]


def cut(states: np.ndarray, parts: int) -> np.ndarray:
    """Return a path (T, n) with every chord in so many equal parts."""
    if parts == 1:
        return states
    shares = np.arange(parts)[:, None] / parts
    points = states[:-1, None] + shares * np.diff(states, axis=0)[:, None]  # (T - 1, parts, n)
    return np.concatenate([points.reshape(-1, states.shape[1]), states[-1:]])
