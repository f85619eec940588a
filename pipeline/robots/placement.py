"""A pose as people write it in files."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pipeline.errors import ConfigError


@dataclass(frozen=True)
class Placement:
    """A pose in its parent frame, R = Rz(yaw) Ry(pitch) Rx(roll) as in URDF.

    Attributes:
        xyz: position [m].
        rpy: roll, pitch and yaw [rad].
    """

    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name, values in (("xyz", self.xyz), ("rpy", self.rpy)):
            if len(values) != 3 or not np.isfinite(values).all():
                raise ConfigError(f"{name} of a placement is {list(values)}; it must be three finite numbers")

    def se3(self) -> pin.SE3:
        """Return the pose as pinocchio's."""
        return pin.SE3(pin.rpy.rpyToMatrix(*self.rpy), np.array(self.xyz))

    @classmethod
    def of(cls, pose: pin.SE3) -> "Placement":
        """Return the placement of a pose."""
        return cls(tuple(pose.translation.tolist()), tuple(pin.rpy.matrixToRpy(pose.rotation).tolist()))


IDENTITY = Placement()
