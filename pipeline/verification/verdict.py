"""What the verifier finds, and what it is asked to keep to."""

from dataclasses import dataclass
from enum import Enum

from pipeline.errors import require

CLEARANCE = 1e-4  # what is nearer than this to contact may be sampled only [m]; everything else is proven


class Failure(Enum):
    """What is wrong with a path."""

    MALFORMED = "malformed"  # no (T, n) array
    EMPTY = "empty"
    NOT_FINITE = "not finite"
    WRONG_START = "wrong start"
    WRONG_GOAL = "wrong goal"
    OUT_OF_BOUNDS = "out of bounds"
    OFF_MANIFOLD = "off the manifold"
    CONDITION = "condition"  # balance, or the walls of a maze
    COLLISION = "collision"


@dataclass(frozen=True)
class VerifierParameters:
    """Bounds of the check.

    Attributes:
        tolerance: ||F|| is below it at every point of the path; None takes the task's own.
        endpoint: distance within which ends count as start and goal [rad or m]; for rounding only.
        clearance: also measure the least clearance of the waypoints.
    """

    tolerance: float | None = None
    endpoint: float = 1e-6
    clearance: bool = False

    def __post_init__(self) -> None:
        for name in ("tolerance", "endpoint"):
            value = getattr(self, name)
            if value is not None:
                require(f"verifier.{name}", value, above=0)


@dataclass(frozen=True)
class Touch:
    """Two bodies that may touch, where they are deepest in each other.

    Attributes:
        first, second: their names.
        depth: the shortest way out [m].
    """

    first: str
    second: str
    depth: float


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
        states_checked: configurations at which bodies were held against each other.
        chords_proven: chords of which every point is proven to be sound.
        chords_sampled: chords that are sound wherever they were looked at, but come nearer to a bound than can be
            proven; of a path that passes both add up to all chords.
        note: what was only sampled, or is judged as a surface; empty where there is nothing to say.
        deepest: the deepest contact of bodies that may touch, at the waypoints; None where none touch.
    """

    failure: Failure | None
    segment: int | None
    message: str
    max_violation: float
    min_clearance: float | None
    length: float
    states_checked: int
    chords_proven: int = 0
    chords_sampled: int = 0
    note: str = ""
    deepest: Touch | None = None

    @property
    def passed(self) -> bool:
        """True when the path has no defect."""
        return self.failure is None
