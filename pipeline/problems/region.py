"""Task space regions as they are written in problem files."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.constraints import TaskSpaceRegion
from pipeline.errors import ConfigError
from pipeline.robots import IDENTITY, Placement
from pipeline.schema import convert


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

    def region(self) -> TaskSpaceRegion:
        """Return the region."""
        bounds = [_bounds(name, getattr(self, name)) for name in ("x", "y", "z", "roll", "pitch", "yaw")]
        lower, upper = zip(*bounds, strict=True)
        return TaskSpaceRegion(lower, upper, self.origin, self.offset)


def _bounds(name: str, value: Any) -> tuple[float, float]:
    if value is None:
        return -np.inf, np.inf
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), float(value)
    if isinstance(value, list | tuple) and len(value) == 2:
        low, high = (convert(v, float, f"region.{name}") for v in value)
        return low, high
    raise ConfigError(f"region.{name} is {value!r}; it must be a number, [lower, upper], or left out")
