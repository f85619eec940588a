"""One problem of one's own: from a file to a verified, time-stamped path."""

from pipeline.planning.solve import Solution, solve

__all__ = ["Solution", "solve"]
