"""An independent check of paths: nothing counts as solved until it has passed.

Shares no code with the walks and the finer walk of the planners. Of the constraint it uses the value only, which is the
definition of the problem; the way back to the manifold is a Gauss-Newton iteration with finite differences of its own.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, require
from pipeline.robots import Validity

_DIFFERENCE = 1e-7  # of forward differences; the Jacobian's error of about 1e-7 only costs digits per iteration
_ITERATIONS = 30  # from within a leap of the manifold two or three suffice
_DAMPING = 1e-12  # of J J^T, relative: keeps a rank deficient Jacobian solvable, too little to bend a step


class Failure(Enum):
    """What is wrong with a path."""

    MALFORMED = "malformed"  # no (T, n) array
    EMPTY = "empty"
    NOT_FINITE = "not finite"
    WRONG_START = "wrong start"
    WRONG_GOAL = "wrong goal"
    OUT_OF_BOUNDS = "out of bounds"
    OFF_MANIFOLD = "off the manifold"
    LEAP = "leap"  # neighbouring waypoints are too far apart
    NO_MANIFOLD = "no manifold in between"  # a point between two waypoints finds no way to the manifold
    JUMP = "jump"  # neighbouring points between two waypoints lie on different parts of the manifold
    COLLISION = "collision"


@dataclass(frozen=True)
class VerifierParameters:
    """Bounds of the check.

    Attributes:
        step: spacing of the states checked between waypoints, a fifth of planning's `resolution` [rad or m].
        leap: farthest apart neighbouring waypoints may be: lambda_1 gamma (compnetx.txt, appendix D) [rad or m].
        tolerance: waypoints have ||F|| below it; None takes the constraint's own.
        inner: share of the tolerance that states between waypoints are brought to, as a chord of a step's length is
            often within the tolerance itself and would be checked in place of the way on the manifold.
        jump: farthest apart neighbouring states may be on the manifold, in steps; lambda_1 again.
        overshoot: how far a state between two waypoints may exceed a joint limit that waypoints keep [rad or m]. A way
            along a limit bends beyond it by up to resolution^2 / 8 times its curvature: 1.2e-5 for a curvature of 1.
        endpoint: distance within which ends count as start and goal [rad or m]; for rounding only.
        clearance: also measure the least clearance of the waypoints (0.35 ms per state).
    """

    step: float = 0.002
    leap: float = 0.1
    tolerance: float | None = None
    inner: float = 0.01
    jump: float = 2.0
    overshoot: float = 1e-4
    endpoint: float = 1e-6
    clearance: bool = False

    def __post_init__(self) -> None:
        for name in ("step", "leap", "tolerance", "inner", "jump", "overshoot", "endpoint"):
            value = getattr(self, name)
            if value is not None:
                require(f"verifier.{name}", value, above=0)


@dataclass(frozen=True)
class Verdict:
    """What the check of a path found.

    Attributes:
        failure: the first defect found; None when the path passes.
        segment: index i of the segment (i, i + 1) that has it; for a waypoint the segment it begins (the last one
            ends it); None when the path passes or the defect is of the whole path.
        message: the defect in a sentence, with value and bound; empty when the path passes.
        max_violation: largest ||F|| of the waypoints; NaN when it could not be computed.
        min_clearance: least clearance of the waypoints [m]; None when not asked for, or not computable.
        length: of the polyline [rad or m]; NaN when it could not be computed.
        states_checked: configurations asked for collisions.
    """

    failure: Failure | None
    segment: int | None
    message: str
    max_violation: float
    min_clearance: float | None
    length: float
    states_checked: int

    @property
    def passed(self) -> bool:
        """True when the path has no defect."""
        return self.failure is None


def verify(
    path: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    constraint: Constraint,
    validity: Validity,
    parameters: VerifierParameters | None = None,
) -> Verdict:
    """Check that a path (T, n) leads from start to goal (n,) on the manifold, within limits and free of contact.

    A path of one state passes where start and goal are that state. Joints that turn may reach the goal's angle whole
    turns away.

    Raises:
        ConfigError: the validity checker has a margin, so that its verdicts are not about contact.
    """
    if validity.margin != 0:
        raise ConfigError(f"the verifier needs a Validity without margin; this one has {validity.margin} m")
    check = _Check(constraint, validity, parameters or VerifierParameters())
    found = check.form(path, np.asarray(start, float), np.asarray(goal, float))
    if found is not None:
        return Verdict(*found, np.nan, None, np.nan, 0)
    path = np.asarray(path, float)
    failure, segment, message = check.waypoints(path) or check.between(path) or (None, None, "")
    return Verdict(
        failure=failure,
        segment=segment,
        message=message,
        max_violation=float(check.violation(path).max()),
        min_clearance=min(validity.clearance(q) for q in path) if check.parameters.clearance else None,
        length=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        states_checked=check.states,
    )


_Found = tuple[Failure, int | None, str]


class _Check:
    """The single checks; each returns the first defect it finds, or None."""

    def __init__(self, constraint: Constraint, validity: Validity, parameters: VerifierParameters) -> None:
        self.constraint, self.validity, self.parameters = constraint, validity, parameters
        self.lower, self.upper = validity.robot.lower, validity.robot.upper
        self.tolerance = constraint.tolerance if parameters.tolerance is None else parameters.tolerance
        self.states = 0

    def violation(self, Q: np.ndarray) -> np.ndarray:
        """Return ||F|| of the rows of Q (N, n) as (N,)."""
        return np.linalg.norm(self.constraint.value_batch(Q), axis=1)

    def form(self, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> _Found | None:
        """Shape, finite numbers and both ends."""
        try:
            Q = np.asarray(path, float)
        except (TypeError, ValueError) as error:
            return Failure.MALFORMED, None, f"the path is no array of numbers: {error}"
        if Q.size == 0:
            return Failure.EMPTY, None, "the path has no states"
        if Q.ndim != 2 or Q.shape[1] != self.constraint.n:
            return Failure.MALFORMED, None, f"the path has shape {Q.shape}; it must be (T, {self.constraint.n})"
        finite = np.isfinite(Q).all(axis=1)
        if not finite.all():
            i = int(np.argmin(finite))
            return Failure.NOT_FINITE, _segment(i, Q), f"waypoint {i} of {len(Q)} is not finite: {Q[i].tolist()}"
        bound = self.parameters.endpoint
        if not (off := float(np.linalg.norm(Q[0] - start))) <= bound:
            return Failure.WRONG_START, _segment(0, Q), f"the path begins {off:.3g} from the start; bound {bound:.3g}"
        turns = self.validity.robot.turns
        missed = Q[-1] - goal if turns is None else turns.wrapped(Q[-1] - goal)
        if not (off := float(np.linalg.norm(missed))) <= bound:
            return (
                Failure.WRONG_GOAL,
                _segment(len(Q) - 1, Q),
                f"the path ends {off:.3g} from the goal; bound {bound:.3g}",
            )
        return None

    def waypoints(self, Q: np.ndarray) -> _Found | None:
        """Limits, manifold and distances of the given states (T, n)."""
        excess = np.maximum(self.lower - Q, Q - self.upper)  # (T, n)
        if excess.max() > 0:
            i, joint = divmod(int(np.argmax(excess > 0)), self.constraint.n)
            name, low, high = self.validity.robot.joint_names[joint], self.lower[joint], self.upper[joint]
            message = f"waypoint {i}: joint {name} is {Q[i, joint]:.6g}, outside its limits [{low:.6g}, {high:.6g}]"
            return Failure.OUT_OF_BOUNDS, _segment(i, Q), message
        off = self.violation(Q)
        if not off.max() < self.tolerance:
            i = int(np.argmax(~(off < self.tolerance)))
            message = f"waypoint {i} is off the manifold: ||F|| = {off[i]:.3g}, tolerance {self.tolerance:.3g}"
            return Failure.OFF_MANIFOLD, _segment(i, Q), message
        gaps = np.linalg.norm(np.diff(Q, axis=0), axis=1)
        if (gaps > self.parameters.leap).any():
            i = int(np.argmax(gaps > self.parameters.leap))
            message = f"waypoints {i} and {i + 1} are {gaps[i]:.4g} apart; bound {self.parameters.leap:.4g}"
            return Failure.LEAP, i, message
        return None

    def between(self, Q: np.ndarray) -> _Found | None:
        """Manifold, limits and collisions of states at most a step apart along the path, and of the waypoints."""
        step, overshoot = self.parameters.step, self.parameters.overshoot
        pieces = np.maximum(np.ceil(np.linalg.norm(np.diff(Q, axis=0), axis=1) / step).astype(int), 1)
        at = np.append(0, np.cumsum(pieces))  # where the waypoints stand among the states
        segment = np.repeat(np.arange(len(pieces)), pieces)
        share = (np.arange(at[-1]) - at[segment]) / pieces[segment]
        chord = Q[segment] + share[:, None] * (Q[segment + 1] - Q[segment])
        points, off = self._to_manifold(np.vstack([chord, Q[-1:]]))
        segment = np.append(segment, max(len(pieces) - 1, 0))
        lost = ~(off < self.tolerance)
        if lost.any():
            first = int(np.argmax(lost))
            message = f"a state stays {off[first]:.3g} off the manifold; tolerance {self.tolerance:.3g}"
            return _between(Failure.NO_MANIFOLD, segment[first], len(pieces), message)
        steps, bound = np.linalg.norm(np.diff(points, axis=0), axis=1), self.parameters.jump * step
        if (steps > bound).any():
            first = int(np.argmax(steps > bound))
            message = f"the way on the manifold jumps by {steps[first]:.3g}; bound {bound:.3g}"
            return _between(Failure.JUMP, segment[first], len(pieces), message)
        excess = np.maximum(self.lower - points, points - self.upper).max(axis=1)
        if (excess > overshoot).any():
            first = int(np.argmax(excess > overshoot))
            message = f"a joint exceeds its limit by {excess[first]:.3g}; bound {overshoot:.3g}"
            return _between(Failure.OUT_OF_BOUNDS, segment[first], len(pieces), message)
        points[at] = Q  # as they were given, not as projected
        for i, q in zip(segment.tolist(), points, strict=True):
            self.states += 1
            if not self.validity.free(q):
                return _between(Failure.COLLISION, i, len(pieces), f"there is contact at {np.round(q, 4).tolist()}")
        return None

    def _to_manifold(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton with steps of least length from rows of Q (N, n); return them (N, n) and their ||F|| (N,)."""
        Q, n, k = Q.copy(), self.constraint.n, self.constraint.k
        F = self.constraint.value_batch(Q)  # (N, k)
        for _ in range(_ITERATIONS):
            rows = np.flatnonzero(np.linalg.norm(F, axis=1) >= self.parameters.inner * self.tolerance)
            if len(rows) == 0:
                break
            moved = Q[rows, None, :] + _DIFFERENCE * np.eye(n)  # (M, n, n), one row per joint
            values = self.constraint.value_batch(moved.reshape(-1, n)).reshape(len(rows), n, k)
            JT = (values - F[rows, None, :]) / _DIFFERENCE  # (M, n, k)
            A = JT.transpose(0, 2, 1) @ JT  # (M, k, k)
            A += (_DAMPING * np.trace(A, axis1=1, axis2=2)[:, None, None] + _DIFFERENCE**2) * np.eye(k)
            Q[rows] -= (JT @ np.linalg.solve(A, F[rows, :, None]))[:, :, 0]
            F[rows] = self.constraint.value_batch(Q[rows])
        return Q, np.linalg.norm(F, axis=1)


def _between(failure: Failure, segment: int, segments: int, what: str) -> _Found:
    if segments == 0:
        return failure, None, f"at the only waypoint {what}"
    return failure, int(segment), f"between waypoints {segment} and {segment + 1} {what}"


def _segment(waypoint: int, Q: np.ndarray) -> int | None:
    """Return the segment a waypoint begins, or ends when it is the last; None in a path without segments."""
    return min(waypoint, len(Q) - 2) if len(Q) > 1 else None
