"""The error tree. Every message gives the offending value, the bound and the alternatives."""


class PipelineError(Exception):
    """Base of every error this package raises on purpose."""


class ConfigError(PipelineError):
    """A configuration key or value is wrong."""


class ArtifactError(PipelineError):
    """A file of an earlier stage is missing, truncated or foreign."""


class ProblemError(PipelineError):
    """A start, goal or scene cannot be planned for."""


class ConstraintError(PipelineError):
    """A constraint is malformed, rank deficient or over-constrained."""


class RobotError(PipelineError):
    """A robot, joint, frame or geometry does not exist or does not fit."""
