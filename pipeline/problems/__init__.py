"""Problem files of a user's own: what they ask for, and their starts and goals by inverse kinematics."""

from pipeline.problems.file import ProblemFile, read_problem

__all__ = ["ProblemFile", "read_problem"]
