"""What holds at points of a path, shown to hold between them.

Equations: between two points of a chord at which F is known it leaves the straight line between its values by |F''| / 8
at most. |F''| is taken from second differences of F along the chord, with a safety factor: joints turn by a few
hundredths of a radian from point to point, in which F has no room for more than it shows; where it has a kink, at the
bound of a region, the second difference is as large as the kink. Inequalities: the same, with a bound of g'' that
follows from lever arms.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pipeline.verification.kinematics import WORLD, Kinematics

_SHARE = 0.4  # of the tolerance, whose root joints turn by along a stretch at most [rad]: what is 2 m from their axes
# leaves the straight line by 2 * (0.4 tolerance) / 8, a tenth of the tolerance, even where it does so unseen
_STRETCHES = 4  # of a chord at least: second differences need a few
_SAFETY = 2.0  # of second differences
_HALVINGS = 8  # of stretches; what they leave unproven falls to a quarter each time
Function = Callable[[np.ndarray], np.ndarray]


@dataclass
class Held:
    """How far something holds along a path.

    Attributes:
        chord: the first in which it does not hold; None where it holds wherever it was looked at.
        worst: value there.
        sampled: chords of which it is not proven that it holds between the points that were looked at.
    """

    chord: int | None = None
    worst: float = 0.0
    sampled: set[int] = field(default_factory=set)


def equations(values: Function, path: np.ndarray, tolerance: float) -> Held:
    """Tell how far ||F|| stays below a tolerance along the chords of a path (T, n).

    Args:
        values: F of configurations (N, n) as (N, k).
        path: states.
        tolerance: see above.
    """
    held = Held()
    moved = np.abs(np.diff(path, axis=0)).sum(axis=1)
    count = np.maximum(np.ceil(moved / np.sqrt(_SHARE * tolerance)).astype(int), _STRETCHES)
    chords = np.arange(len(count))
    for _ in range(_HALVINGS // 2):
        chord = np.repeat(chords, count + 1)
        begin = np.cumsum(count + 1) - (count + 1)
        share = (np.arange(len(chord)) - np.repeat(begin, count + 1)) / np.repeat(count, count + 1)
        F = values(path[chord] + share[:, None] * (path[chord + 1] - path[chord]))  # (N, k)
        off = np.linalg.norm(F, axis=1)
        bad = ~(off < tolerance)
        if bad.any():
            first = int(np.argmax(bad))
            if held.chord is None or chord[first] < held.chord:
                held.chord, held.worst = int(chord[first]), float(off[first])
        bend = np.zeros(len(F))
        bend[1:-1] = np.linalg.norm(F[2:] - 2 * F[1:-1] + F[:-2], axis=1)
        bend[begin] = bend[begin + 1]  # ends of chords have the bend of their neighbours
        bend[begin + count] = bend[begin + count - 1]
        most = np.maximum(off[1:], off[:-1]) + _SAFETY * np.maximum(bend[1:], bend[:-1]) / 8
        inner = chord[1:] == chord[:-1]
        open_ones = np.unique(chord[1:][inner & ~(most < tolerance)])
        if held.chord is not None:
            open_ones = open_ones[open_ones < held.chord]
        chords, count = open_ones, 4 * count[np.isin(chords, open_ones)]
        if not len(chords):
            break
    held.sampled = set(chords.tolist())
    return held


def inequality(least: Function, bend: Function, path: np.ndarray) -> Held:
    """Tell how far the least of inequalities g >= 0 stays at 0 or more along the chords of a path (T, n).

    Args:
        least: of the rows of g, of configurations (N, n), as (N,).
        bend: bounds |g''| of every row over chords with steps (C, n), as (C,).
        path: states.
    """
    held = Held()
    chord = np.arange(len(path) - 1)
    begin, end = path[:-1], path[1:]
    at_begin, at_end = least(begin), least(end)
    for halvings in range(_HALVINGS + 1):
        low = np.minimum(at_begin, at_end)
        bad = ~(low >= 0)
        if bad.any():
            first = int(np.flatnonzero(bad)[np.argmin(chord[bad])])
            if held.chord is None or chord[first] < held.chord:
                held.chord, held.worst = int(chord[first]), float(low[first])
        rest = ~bad & ~(low >= bend(end - begin) / 8)
        if held.chord is not None:
            rest &= chord < held.chord
        if not rest.any():
            return held
        if halvings == _HALVINGS:
            held.sampled = set(chord[rest].tolist())
            return held
        chord, begin, end = chord[rest], begin[rest], end[rest]
        middle = (begin + end) / 2
        at_middle = least(middle)
        at_begin, at_end = at_begin[rest], at_end[rest]
        chord = np.tile(chord, 2)
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin, at_end = np.concatenate([at_begin, at_middle]), np.concatenate([at_middle, at_end])
    return held


def bend_of_mass(kinematics: Kinematics) -> Function:
    """Return the function that bounds |c''| of the centre of mass c over chords with steps dq (C, n), as (C,) [m].

    The centre of what a joint carries is at x with |x''| <= sum_k r_k |dq_k| (|dq_k| + 2 sum_{j<k} |dq_j|), as for
    bodies (`motion`); that of the robot is their average by mass.
    """
    joints, n = kinematics.joints, len(kinematics.names)
    limits = np.maximum(np.abs(kinematics.lower), np.abs(kinematics.upper))
    share = kinematics.masses.mass / kinematics.masses.mass.sum()
    levers, before = np.zeros(n), np.zeros((n, n))
    for number, joint in enumerate(joints):
        k, carrier = joint.variable, joint.parent
        before[k, k] = 0.0 if joint.slides else 1.0
        while carrier != WORLD:
            if not joints[carrier].slides:
                before[joints[carrier].variable, k] = 2.0
            carrier = joints[carrier].parent
        far, at = float(np.linalg.norm(kinematics.masses.lever[number])), number
        while at != WORLD and share[number] > 0:
            levers[joints[at].variable] += share[number] * (1.0 if joints[at].slides else far)
            far += float(np.linalg.norm(joints[at].placement.p))
            far += float(limits[joints[at].variable]) if joints[at].slides else 0.0
            at = joints[at].parent

    def bend(steps: np.ndarray) -> np.ndarray:
        dq = np.abs(steps)
        return np.asarray((dq * (dq @ before)) @ levers)

    return bend
