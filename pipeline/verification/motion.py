"""How far bodies move along the chords of a path, as other bodies see them.

A point of a body is at x(s) for s from 0 to 1 along a chord. With the joints between the body and the one that sees it
in their order from there, |x''| <= sum_k r_k |dq_k| (|dq_k| + 2 sum_{j<k} |dq_j|), where r_k is how far the point can
be from the axis of joint k and only j that turn count; a joint that slides has r_k = 1 and no term |dq_k|^2. Hence
|x'(s)| <= |x(1) - x(0)| + max |x''| / 2 everywhere on the chord. The first part is largest at a corner of the box
around the body, as x(1) - x(0) is affine in the point.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.verification.kinematics import WORLD, Kinematics
from pipeline.verification.pairs import Item

_BLOCK = 4_000_000  # numbers in one array
_LEAST = 1e-9  # way along a chord [m], so that ways grow along a path
Poses = tuple[np.ndarray, np.ndarray]


class Motion:
    """Bounds on the speed of items along chords.

    Args:
        kinematics: of the robot.
        items: of robot and obstacles.
        views: (item, joint) by number: the item as that joint sees it, or the world (WORLD). The joint does not move
            the item.
    """

    def __init__(self, kinematics: Kinematics, items: Sequence[Item], views: Sequence[tuple[int, int]]) -> None:
        self._kinematics = kinematics
        n, count = len(kinematics.names), len(views)
        self._joint = np.array([items[item].joint for item, _ in views], int)
        self._seen = np.array([joint for _, joint in views], int)
        corners = [items[item].form.moving @ items[item].place.R.T + items[item].place.p for item, _ in views]
        self._corners = np.array(corners, float).reshape(count, 8, 3)  # in the frame of the item's joint
        self._levers, self._before = np.zeros((count, n)), np.zeros((count, n, n))
        for row, (item, joint) in enumerate(views):
            self._view(row, items[item].joint, joint)
        self._bends = self._before * self._levers[:, None]  # |x''| <= dq @ bends @ dq

    @property
    def count(self) -> int:
        """Number of views."""
        return len(self._joint)

    def rates(self, Q: np.ndarray, poses: Poses, views: np.ndarray) -> np.ndarray:
        """Return bounds on |x'(s)| of views (V,) over the chords between rows of Q (T, n), as (V, T - 1) [m].

        Args:
            Q: states.
            poses: of the joints' frames at the states (T, J, 3, 3), (T, J, 3).
            views: by number.
        """
        R, p = with_world(poses)
        dq = np.abs(np.diff(Q, axis=0))  # (C, n)
        found = np.empty((len(views), len(dq)))
        size = max(_BLOCK // (len(Q) * max(24, dq.shape[1])), 1)
        for first in range(0, len(found), size):
            rows = views[first : first + size]
            joint, seen = self._joint[rows], self._seen[rows]
            turned, moved = R[:, joint], p[:, joint]  # (T, V, 3, 3), (T, V, 3)
            if (seen != WORLD).any():
                back = R[:, seen].swapaxes(-1, -2)
                turned, moved = back @ turned, (back @ (moved - p[:, seen])[..., None])[..., 0]
            flat = turned.swapaxes(0, 1).reshape(len(rows), -1, 3)  # (V, 3 T, 3): one product a view
            x = (flat @ self._corners[rows].swapaxes(1, 2)).reshape(len(rows), len(Q), 3, 8)
            x += moved.swapaxes(0, 1)[..., None]
            away = np.sqrt(np.square(np.diff(x, axis=1)).sum(axis=2).max(axis=2))  # (V, C)
            bows = (dq @ self._bends[rows] * dq).sum(axis=2) / 2  # (V, C)
            found[first : first + size] = away + bows + _LEAST
        return found

    def _view(self, row: int, moved: int, seen: int) -> None:
        """Fill in how far the item can be from the axes of the joints between, and their order."""
        joints = self._kinematics.joints
        down, up = _supports(self._kinematics, moved), _supports(self._kinematics, seen)
        while down and up and down[0] == up[0]:
            down, up = down[1:], up[1:]
        order = [*reversed(up), *down]  # from the joint that sees
        distance = float(np.linalg.norm(self._corners[row], axis=1).max())
        for k in reversed(down):
            self._levers[row, joints[k].variable] = 1.0 if joints[k].slides else distance
            distance += self._step(k)
        for k in up:
            distance += self._step(k)
            self._levers[row, joints[k].variable] = 1.0 if joints[k].slides else distance
        for place, k in enumerate(order):
            turning = [joints[j].variable for j in order[:place] if not joints[j].slides]
            self._before[row, turning, joints[k].variable] = 2.0
            self._before[row, joints[k].variable, joints[k].variable] = 0.0 if joints[k].slides else 1.0

    def _step(self, k: int) -> float:
        """Return how far the origin of a joint, moved, can be from that of the joint before it [m]."""
        joint = self._kinematics.joints[k]
        slid = 0.0
        if joint.slides:
            i = joint.variable
            slid = max(abs(float(self._kinematics.lower[i])), abs(float(self._kinematics.upper[i])))
        return float(np.linalg.norm(joint.placement.p)) + slid


def with_world(poses: Poses) -> Poses:
    """Return poses (T, J, ...) with that of the world behind the last joint, where number WORLD finds it."""
    R, p = poses
    count = len(R)
    return (
        np.concatenate([R, np.broadcast_to(np.eye(3), (count, 1, 3, 3))], axis=1),
        np.concatenate([p, np.zeros((count, 1, 3))], axis=1),
    )


def _supports(kinematics: Kinematics, joint: int) -> list[int]:
    """Return the joints that carry a joint, the first of the chain first, itself last; none for the world."""
    found: list[int] = []
    while joint != WORLD:
        found.insert(0, joint)
        joint = kinematics.joints[joint].parent
    return found
