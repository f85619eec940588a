"""A robot: a pinocchio model of the planning group, its collision geometry and its symbolic kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Robot:
    """Joints, limits and geometry of a planning group.

    Attributes:
        name: how reports and recordings call it.
        model: pinocchio model; every joint has one degree of freedom.
        geometry: collision geometry, with the self-collision pairs to check.
        lower, upper: joint limits (n,) [rad or m].
        travel: no point of a body moves farther than this times the joint distance [m per rad or m]; None where no
            such bound is known. With it, one collision check with more margin stands for several between states.
    """

    name: str
    model: pin.Model
    geometry: pin.GeometryModel
    lower: np.ndarray
    upper: np.ndarray
    travel: float | None = None

    @property
    def dimension(self) -> int:
        """Number of configuration variables n."""
        return int(self.model.nq)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in configuration order."""
        return tuple(self.model.names)[1:]

    def symbolic_pose(self, q: ca.SX, frame: str) -> tuple[ca.SX, ca.SX]:
        """Return rotation (3, 3) and position (3,) [m] of `frame` in the world as expressions of q (n,).

        Raises:
            RobotError: no such frame, or a joint that is neither revolute nor prismatic.
        """
        if not self.model.existFrame(frame):
            names = ", ".join(f.name for f in self.model.frames)
            raise RobotError(f"robot {self.name!r} has no frame {frame!r}; it has: {names}")
        target = self.model.frames[self.model.getFrameId(frame)]
        chain: list[int] = []
        joint = target.parentJoint
        while joint:
            chain.append(joint)
            joint = self.model.parents[joint]
        R, p = ca.SX.eye(3), ca.SX.zeros(3)
        for joint in reversed(chain):
            R, p = _compose(R, p, self.model.jointPlacements[joint])
            R_joint, p_joint = self._symbolic_joint(joint, q[self.model.idx_qs[joint]])
            R, p = R @ R_joint, p + R @ p_joint
        return _compose(R, p, target.placement)

    def _symbolic_joint(self, joint: int, angle: ca.SX) -> tuple[ca.SX, ca.SX]:
        kind = self.model.joints[joint].shortname().removeprefix("JointModel")
        if kind in ("RX", "RY", "RZ"):
            return _rotation(np.array(_AXES[kind[1]]), angle), ca.SX.zeros(3)
        if kind in ("PX", "PY", "PZ"):
            return ca.SX.eye(3), ca.SX(np.array(_AXES[kind[1]])) * angle
        if kind == "RevoluteUnaligned":
            return _rotation(_axis(self.model, joint, slice(3, 6)), angle), ca.SX.zeros(3)
        if kind == "PrismaticUnaligned":
            return ca.SX.eye(3), ca.SX(_axis(self.model, joint, slice(0, 3))) * angle
        raise RobotError(
            f"joint {self.model.names[joint]!r} of {self.name!r} is a {kind}; only revolute and prismatic joints "
            "with limits are planned for (a continuous joint needs finite limits in the URDF)"
        )


def point_robot(radius: float, lower: Sequence[float], upper: Sequence[float]) -> Robot:
    """Return a small ball on three prismatic joints: the point mass of the sphere environment.

    Args:
        radius: of the ball [m]; a point mass needs a positive radius for collision checking.
        lower: limits of x, y, z [m].
        upper: likewise.
    """
    if not radius > 0:
        raise RobotError(f"radius is {radius} m; a point robot needs a radius above 0 m")
    model = pin.Model()
    model.name = "point"
    joint = 0
    for name, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("z", pin.JointModelPZ())):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name)
    model.addFrame(pin.Frame("point", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    geometry = pin.GeometryModel()
    ball = pin.GeometryObject("point", joint, pin.SE3.Identity(), pin.hppfcl.Sphere(radius))
    geometry.addGeometryObject(ball)
    return Robot("point", model, geometry, np.asarray(lower, float), np.asarray(upper, float), travel=1.0)


def _compose(R: ca.SX, p: ca.SX, placement: pin.SE3) -> tuple[ca.SX, ca.SX]:
    return R @ ca.SX(ca.DM(placement.rotation)), p + R @ ca.SX(ca.DM(placement.translation))


def _rotation(axis: np.ndarray, angle: ca.SX) -> ca.SX:
    """Rodrigues' formula for a unit axis (3,)."""
    K = ca.SX(ca.skew(ca.DM(axis)))
    return ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)


def _axis(model: pin.Model, joint: int, rows: slice) -> np.ndarray:
    """The motion subspace of a one-DOF joint holds its axis in the rows of its kind (linear first)."""
    single = model.joints[joint]
    data = single.createData()
    single.calc(data, np.zeros(model.nq), np.zeros(model.nv))
    return np.asarray(data.S).reshape(6)[rows]
