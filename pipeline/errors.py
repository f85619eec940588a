"""The error tree. Every message gives the offending value, the bound and the alternatives."""

import difflib
import math
import re
from collections.abc import Iterable

_LONGEST = 200  # characters of a value in a message


class PipelineError(Exception):
    """Base of every error this package raises on purpose."""


class ConfigError(PipelineError):
    """A configuration key or value is wrong."""


class ArtifactError(PipelineError):
    """A file of an earlier stage is missing, truncated or foreign, or one cannot be written."""


class ClusterError(PipelineError):
    """Workers on this machine or others cannot be reached, run other code or went away."""


class ProblemError(PipelineError):
    """A start, goal or scene cannot be planned for."""


class ConstraintError(PipelineError):
    """A constraint is malformed, rank deficient or over-constrained."""


class RobotError(PipelineError):
    """A robot, joint, frame or geometry does not exist or does not fit."""


def unknown(claim: str, name: str, choices: Iterable[str]) -> str:
    """Return a message about a name that does not exist: the claim, the name, the closest choice and all choices."""
    there = list(dict.fromkeys(choices))
    close = difflib.get_close_matches(name, there, 1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return f"{claim} {name!r}{hint}; there are: {', '.join(there) or 'none'}"


def shown(value: object) -> str:
    """Return a value as a message shows it: what is too long to read is cut, and its length said."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({len(text)} characters)"


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
    whole = isinstance(value, int)  # of any size, also where no float is so large
    if (whole or math.isfinite(value)) and not outside:
        return
    words = {"at least": at_least, "above": above, "at most": at_most, "below": below}
    bounds = [f"{word} {bound:g}{unit}" for word, bound in words.items() if math.isfinite(bound)]
    finite = [] if whole or math.isfinite(value) else ["finite"]
    raise ConfigError(f"{name} is {shown(value)}{unit}; it must be {' and '.join(finite + bounds)}")


def require_name(key: str, value: str, also: str = "") -> None:
    """Refuse a name that a file or folder cannot have anywhere: as a path it would lead elsewhere.

    Args:
        key: where it stands.
        value: the name.
        also: characters that it may have besides letters, digits, `_`, `-` and `.`.

    Raises:
        ConfigError: names the key, its value and what is allowed.
    """
    if not re.fullmatch(rf"[\w.{re.escape(also)}-]+", value) or value.startswith("."):
        marks = ", ".join(map(repr, "_-." + also))
        raise ConfigError(
            f"{key} is {shown(value)}; files are named after it: it must be letters, digits and {marks}, at least one "
            "of them, and not begin with '.'"
        )


def told_apart(*values: float) -> list[str]:
    """Return numbers as text with the digits it takes to tell different ones apart, 6 at least."""
    texts: list[str] = []
    for digits in range(6, 18):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len(set(values)):
            break
    return texts
