"""The error tree. Every message gives the offending value, the bound and the alternatives."""

import math


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


def require(
    name: str,
    value: float,
    *,
    at_least: float = -math.inf,
    above: float = -math.inf,
    at_most: float = math.inf,
    below: float = math.inf,
    unit: str = "",
) -> None:
    """Refuse a number of a configuration that is not finite or outside its bounds.

    Raises:
        ConfigError: names the number, its value and the bounds.
    """
    outside = value < at_least or value > at_most or value <= above or value >= below
    if math.isfinite(value) and not outside:
        return
    words = {"at least": at_least, "above": above, "at most": at_most, "below": below}
    bounds = [f"{word} {bound:g}{unit}" for word, bound in words.items() if math.isfinite(bound)]
    finite = [] if math.isfinite(value) else ["finite"]
    raise ConfigError(f"{name} is {value}{unit}; it must be {' and '.join(finite + bounds)}")
