"""Virtual joints: coordinates of a robot that move no part of it, only frames (compnetx.txt, section III)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError
from pipeline.robots.model import Robot

_JOINTS = (
    pin.JointModelPX,
    pin.JointModelPY,
    pin.JointModelPZ,
    pin.JointModelRZ,
    pin.JointModelRY,
    pin.JointModelRX,
)
DIRECTIONS = ("x", "y", "z", "yaw", "pitch", "roll")  # of `_JOINTS`


@dataclass(frozen=True)
class VirtualJoint:
    """A joint between two frames of a virtual chain.

    Attributes:
        direction: index into `DIRECTIONS`.
        before: its place after the joint before it.
        lower, upper: limits [m or rad]; of an angle that turns only where its middle is.
        name: of the configuration variable.
        turns: whether it is an angle that turns without end.
    """

    direction: int
    before: pin.SE3
    lower: float
    upper: float
    name: str
    turns: bool = False


@dataclass(frozen=True)
class VirtualFrame:
    """A frame along a virtual chain: fixed at `placement` after the joint before it."""

    placement: pin.SE3
    name: str


def with_virtual_chain(robot: Robot, chain: Sequence[VirtualJoint | VirtualFrame]) -> Robot:
    """Return the robot with a serial chain of virtual joints and frames that begins at the world.

    Its variables come after those of the robot; they have no velocity limit and rest in the middle of their range.

    Raises:
        RobotError: a name that the robot already has, or limits that are not finite or out of order.
    """
    model = pin.Model(robot.model)
    joint, limits, turning = 0, [], []
    for link in chain:
        if isinstance(link, VirtualFrame):
            if model.existFrame(link.name):
                raise RobotError(f"robot {robot.name!r} has a frame {link.name!r} already")
            model.addFrame(pin.Frame(link.name, joint, 0, link.placement, pin.FrameType.OP_FRAME))
            continue
        if model.existJointName(link.name):
            raise RobotError(f"robot {robot.name!r} has a joint {link.name!r} already")
        if not -np.inf < link.lower < link.upper < np.inf:
            raise RobotError(
                f"virtual joint {link.name!r} has limits {link.lower} and {link.upper}; both must be finite"
            )
        joint = model.addJoint(joint, _JOINTS[link.direction](), link.before, link.name)
        limits.append((link.lower, link.upper))
        turning.append(link.turns)
    bounds = np.array(limits).reshape(-1, 2)
    free = len(bounds)
    rest = np.zeros(robot.dimension) if robot.rest is None else robot.rest
    return replace(
        robot,
        model=model,
        geometry=robot.geometry.copy(),
        lower=np.concatenate([robot.lower, np.where(turning, -np.inf, bounds[:, 0])]),
        upper=np.concatenate([robot.upper, np.where(turning, np.inf, bounds[:, 1])]),
        turning=np.concatenate([robot.turning, np.array(turning, bool)]),
        velocity=None if robot.velocity is None else np.concatenate([robot.velocity, np.full(free, np.inf)]),
        rest=np.concatenate([rest, bounds.mean(axis=1)]),
        placed=robot.placed | {link.name for link in chain},
    )
