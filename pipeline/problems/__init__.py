"""One problem of one's own: from a file to a verified, time-stamped path."""

from pipeline.problems.file import ProblemFile, read_problem
from pipeline.problems.solve import Solution, solve

__all__ = ["ProblemFile", "Solution", "read_problem", "solve"]
