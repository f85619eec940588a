"""Where the joints, frames and bodies of a robot are, for many configurations at once; plain numpy."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import coal
import numpy as np

from pipeline.errors import RobotError, unknown
from pipeline.robots.obstacles import Obstacle

WORLD = -1  # number of what no joint moves
UNIVERSE = "universe"  # the world's frame, as pinocchio calls it


@dataclass(frozen=True)
class Place:
    """A pose in a parent frame: rotation R (3, 3) and position p (3,) [m]."""

    R: np.ndarray = field(default_factory=lambda: np.eye(3))
    p: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: "Place") -> "Place":
        return Place(self.R @ other.R, self.R @ other.p + self.p)

    def inverse(self) -> "Place":
        """Return the parent's pose in this frame."""
        return Place(self.R.T, -self.R.T @ self.p)


@dataclass(frozen=True)
class Joint:
    """A joint with one variable.

    Attributes:
        name: of the joint and of its variable.
        parent: number of the joint before it, which is less than its own; WORLD where there is none.
        placement: where it is at 0, in the frame of the joint before it.
        axis: unit vector in its own frame (3,): of rotation, or along which it slides.
        slides: whether it slides; else it turns.
        variable: column of the path that moves it.
    """

    name: str
    parent: int
    placement: Place
    axis: np.ndarray
    slides: bool
    variable: int


@dataclass(frozen=True)
class Body:
    """A body of the robot, or one that it carries.

    Attributes:
        name: of the body.
        link: whose it is; of a carried body the frame that carries it.
        joint: number of the joint that moves it; WORLD where it stands.
        placement: of its shape, in the joint's frame.
        geometry: the shape as it was read from the file, or the carried obstacle, whose own pose `placement` has.
        base: whether it stands with the robot's root link.
    """

    name: str
    link: str
    joint: int
    placement: Place
    geometry: coal.CollisionGeometry | Obstacle
    base: bool = False


@dataclass(frozen=True)
class Masses:
    """Mass that a joint moves: that of the links behind it up to the next joints, and of what they carry.

    Attributes:
        mass: of every joint (J,) [kg].
        lever: its centre in the joint's frame (J, 3) [m]; 0 where there is no mass.
    """

    mass: np.ndarray
    lever: np.ndarray


@dataclass(frozen=True)
class Kinematics:
    """A robot as the verifier knows it.

    Attributes:
        names: of the variables (n,), in the order of a path's columns; those of a chain last.
        lower, upper: their limits (n,) [rad or m].
        turning: which of them turn a joint (n,).
        joints: that move, parents before children (J = n of them).
        bodies: all of them, carried ones last.
        masses: for the centre of mass; what stands is left out.
        frames: name -> number of the joint that moves it (WORLD where it stands), and its pose in that joint's frame.
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    turning: np.ndarray
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    masses: Masses
    frames: Mapping[str, tuple[int, Place]]

    def joint_poses(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (T, J, 3, 3) and positions (T, J, 3) [m] of the joints' frames at the rows of Q (T, n)."""
        Q = np.asarray(Q, float)
        R, p = np.empty((len(Q), len(self.joints), 3, 3)), np.empty((len(Q), len(self.joints), 3))
        for i, joint in enumerate(self.joints):
            moved = Q[:, joint.variable]
            if joint.parent == WORLD:
                before, origin = joint.placement.R[None], joint.placement.p[None]
            else:
                before = R[:, joint.parent] @ joint.placement.R  # (T, 3, 3)
                origin = R[:, joint.parent] @ joint.placement.p + p[:, joint.parent]
            if joint.slides:
                R[:, i] = before
                p[:, i] = origin + moved[:, None] * (before @ joint.axis)
            else:
                R[:, i] = before @ turns(joint.axis, moved)
                p[:, i] = origin
        return R, p

    def frame_poses(self, Q: np.ndarray, frame: str) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (T, 3, 3) and positions (T, 3) [m] of a frame in the world at the rows of Q (T, n).

        Raises:
            RobotError: no such frame; names those there are.
        """
        return self.placed(*self.joint_poses(Q), *self.frame(frame))

    def frame(self, name: str) -> tuple[int, Place]:
        """Return the number of the joint that moves a frame, and the frame's pose in that of the joint.

        Raises:
            RobotError: no such frame; names those there are.
        """
        if name not in self.frames:
            raise RobotError(unknown("the robot has no frame", name, self.frames))
        return self.frames[name]

    @staticmethod
    def placed(R: np.ndarray, p: np.ndarray, joint: int, placement: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (T, 3, 3), (T, 3) [m] of what is fixed to a joint, from those of all joints (see above)."""
        if joint == WORLD:
            count = len(R)
            return np.broadcast_to(placement.R, (count, 3, 3)), np.broadcast_to(placement.p, (count, 3))
        return R[:, joint] @ placement.R, R[:, joint] @ placement.p + p[:, joint]

    def centre_of_mass(self, Q: np.ndarray) -> np.ndarray:
        """Return the centre of mass of what moves, in the world, at the rows of Q (T, n) as (T, 3) [m].

        Raises:
            RobotError: nothing that moves has a mass.
        """
        total = self.masses.mass.sum()
        if not total > 0:
            raise RobotError("the robot has no mass; its description needs <inertial> elements")
        R, p = self.joint_poses(Q)
        centres = np.einsum("tjab,jb->tja", R, self.masses.lever) + p  # (T, J, 3)
        return np.asarray(np.einsum("j,tja->ta", self.masses.mass / total, centres))


def turns(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return rotations (T, 3, 3) about a unit vector (3,) by angles (T,) [rad] (Rodrigues' formula)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angles)[:, None, None], 2 * np.sin(angles / 2)[:, None, None] ** 2  # 1 - cos, to the last digit
    return np.asarray(np.eye(3) + sine * K + rest * (K @ K))
