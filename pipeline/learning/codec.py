"""Between the variables of a robot and the numbers of a network."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.errors import ConfigError
from pipeline.robots import Robot


@dataclass(frozen=True)
class Codec:
    """Writes configurations as the numbers a network works with, and reads them back.

    A joint with limits takes one number, its value divided by its range: by the robot's limits and never by data. A
    joint that turns takes two, cosine and sine, so that an angle and the same angle a turn later are one. Numbers stand
    in the order of the variables; of a vector that is wider, for tasks with more variables, the rest is 0.

    Dividing by the range alone, as the authors' code does, is the default: it leaves symmetric limits, such as the
    sphere's, within +-0.5 as centring would. For a joint whose limits lie on one side of zero, centring keeps its
    numbers small.

    Attributes:
        lower, upper: limits of the variables (n,) [rad or m]; of joints that turn a turn, whatever is given.
        turning: which joints turn without end (n,); none unless given.
        centre: whether to subtract the middle of the limits first.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    turning: tuple[bool, ...] = ()
    centre: bool = False

    def __post_init__(self) -> None:
        turning = tuple(bool(turns) for turns in self.turning or [False] * len(self.lower))
        object.__setattr__(self, "turning", turning)
        for name, bound in (("lower", -np.pi), ("upper", np.pi)):
            limits = zip(getattr(self, name), turning, strict=True)
            object.__setattr__(self, name, tuple(bound if turns else float(value) for value, turns in limits))
        if not isinstance(self.centre, bool):
            raise ConfigError(f"centre is {self.centre!r}; it must be true or false")
        if not all(-np.inf < low < high < np.inf for low, high in zip(self.lower, self.upper, strict=True)):
            raise ConfigError(f"limits {self.lower} to {self.upper} do not normalise: finite, lower below upper")

    @classmethod
    def of(cls, robots: Sequence[Robot], centre: bool) -> "Codec":
        """Return the codec of robots of the same joints, whose limits may differ: from the lowest to the highest."""
        lower, upper = zip(*(robot.box for robot in robots), strict=True)
        turning = tuple(robots[0].turning.tolist())
        return cls(tuple(np.min(lower, axis=0)), tuple(np.max(upper, axis=0)), turning, centre)

    @property
    def dimension(self) -> int:
        """Variables n."""
        return len(self.lower)

    @property
    def size(self) -> int:
        """Numbers of a configuration s, one for each variable and one more for each that turns."""
        return len(self.lower) + sum(self.turning)

    @cached_property
    def scale(self) -> np.ndarray:
        """What numbers are divided by (s,)."""
        return self._spread(np.subtract(self.upper, self.lower), 2.0)

    @cached_property
    def offset(self) -> np.ndarray:
        """What is subtracted before (s,); zeros without centring."""
        middle = np.add(self.upper, self.lower) / 2 if self.centre else np.zeros(self.dimension)
        return self._spread(middle, 0.0)

    def expand(self, Q: np.ndarray) -> np.ndarray:
        """Return the numbers (..., s) of configurations Q (..., n) before they are scaled: values, cosines, sines."""
        if not any(self.turning):
            return Q
        found = np.empty((*Q.shape[:-1], self.size))
        found[..., self._first] = np.where(self.turning, np.cos(Q), Q)
        found[..., self._sines] = np.sin(Q[..., self._turns])
        return found

    def contract(self, X: np.ndarray) -> np.ndarray:
        """Return the configurations (..., n) of numbers X (..., s) as `expand` gives them; angles in (-pi, pi].

        Of a cosine and a sine that are of no angle, the nearest one's: their direction counts, not their length.
        """
        if not any(self.turning):
            return X
        Q = X[..., self._first].copy()
        Q[..., self._turns] = np.arctan2(X[..., self._sines], Q[..., self._turns])
        return Q

    def encode(self, Q: np.ndarray, width: int = 0) -> np.ndarray:
        """Return the numbers (N, width) of configurations Q (N, n); as wide as they are unless `width` says more."""
        X = (self.expand(Q) - self.offset) / self.scale
        return X if width <= self.size else np.pad(X, ((0, 0), (0, width - self.size)))

    def decode(self, X: np.ndarray) -> np.ndarray:
        """Return the configurations (N, n) of numbers X (N, s or more)."""
        return self.contract(X[..., : self.size] * self.scale + self.offset)

    @cached_property
    def _turns(self) -> np.ndarray:
        return np.flatnonzero(self.turning)

    @cached_property
    def _first(self) -> np.ndarray:
        """Place of each variable's first number (n,)."""
        return np.arange(self.dimension) + np.cumsum((0, *self.turning[:-1]))

    @cached_property
    def _sines(self) -> np.ndarray:
        return self._first[self._turns] + 1

    def _spread(self, values: np.ndarray, turning: float) -> np.ndarray:
        """Return values (n,) of the variables by number (s,), with another value for cosines and sines."""
        found = np.full(self.size, turning)
        kept = ~np.array(self.turning, bool)
        found[self._first[kept]] = values[kept]
        return found
