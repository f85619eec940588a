"""When work has to end: what takes long looks at the clock between its parts, however deep inside a plan it is."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class OutOfTime(Exception):  # noqa: N818 - the time being over is no error
    """The time is over. Whoever set the deadline catches it: to a planner it is a result, not an error."""


class Deadline:
    """A time by which work ends; none until `until` sets one. Time is that of `time.perf_counter` [s]."""

    def __init__(self) -> None:
        self._end = float("inf")

    def look(self) -> None:
        """Look at the clock, which takes a tenth of a microsecond.

        Raises:
            OutOfTime: the deadline has passed.
        """
        if time.perf_counter() >= self._end:
            raise OutOfTime

    @contextmanager
    def until(self, end: float) -> Iterator[None]:
        """Work inside of this ends at `end` [s], or at a deadline set before where that is sooner."""
        before = self._end
        self._end = min(end, before)
        try:
            yield
        finally:
            self._end = before
