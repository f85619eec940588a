"""Task space regions as they are written in problem files."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.constraints import TaskSpaceRegion
from pipeline.errors import ConfigError
from pipeline.robots import IDENTITY, Placement
from pipeline.schema import convert
from pipeline.spec import statement


@dataclass(frozen=True)
class Region:
    """A task space region in a file; see `TaskSpaceRegion`. Bounds that are left out are free.

    Attributes:
        x, y, z, roll, pitch, yaw: lower and upper bound, or one number for both [m, rad].
        origin: where the region's frame is.
        offset: where the held frame is in the region at zero displacement.
    """

    x: Any = None
    y: Any = None
    z: Any = None
    roll: Any = None
    pitch: Any = None
    yaw: Any = None
    origin: Placement = IDENTITY
    offset: Placement = IDENTITY

    def __post_init__(self) -> None:
        self.region()  # refuses bounds that are none

    def region(self) -> TaskSpaceRegion:
        """Return the region."""
        made = self.said()
        return TaskSpaceRegion(made.lower, made.upper, made.place, made.end)

    def said(self) -> statement.Region:
        """Return the region as a statement has it."""
        bounds = [_bounds(name, getattr(self, name)) for name in ("x", "y", "z", "roll", "pitch", "yaw")]
        lower, upper = zip(*bounds, strict=True)
        return statement.Region(lower, upper, self.origin, self.offset)


def is_number(value: Any) -> bool:
    """Tell whether a value of a file is a number; `true` and `yes` are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _bounds(name: str, value: Any) -> tuple[float, float]:
    if value is None:
        return -np.inf, np.inf
    if is_number(value):
        return float(value), float(value)
    if isinstance(value, list | tuple) and len(value) == 2:
        ends = zip(value, (-np.inf, np.inf), strict=True)
        low, high = (open_end if v is None else convert(v, float, f"region.{name}") for v, open_end in ends)
        return low, high
    raise ConfigError(
        f"region.{name} is {value!r}; it must be a number, [lower, upper] (null where there is none), or left out"
    )
