"""How far bodies move along a chord: the straight line in joint space from one state of a path to the next.

A point of a body is at x(s) for s from 0 to 1 along the chord. The second derivative of x is bounded by the lever arms
of the joints: |x''| <= sum_k r_k |dq_k| (|dq_k| + 2 sum_{j<k} |dq_j|), where j < k are the joints before k, and r_k is
how far the point can be from the axis of joint k. Hence |x'(s)| <= |x(1) - x(0)| + max |x''| / 2 at every s: the first
part comes from the poses at both ends, the second is small where the chord is short.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints import Expressions, structure_of
from pipeline.robots import Numbers, Robot
from pipeline.robots.order import revolute

_BLOCK = 16  # states that one call of the kinematics takes
_MOST = 128  # relations; where there would be more, pairs of bodies are seen from the joint that carries both


@dataclass(frozen=True)
class Relation:
    """What one joint carries, as another joint sees it. Two hands that hold a tray do not move, seen from each other.

    Attributes:
        seen_from, joint: pinocchio's numbers; joint 0 is the world.
        far: how far points of the bodies that `joint` carries are from its origin at most [m].
        levers: how far they can be from the axis of each joint between the two at most (n,) [m]; 1 for prismatic
            joints, 0 for all joints that do not move one against the other.
    """

    seen_from: int
    joint: int
    far: float
    levers: np.ndarray


class Displacement:
    """Bounds on how fast bodies move along chords, by relation.

    Args:
        robot: whose bodies they are.
        native: evaluate the kinematics as machine code where there is a C compiler.

    Attributes:
        relations: of each joint that carries bodies to the world, and of those that self-collision pairs need.
        of_bodies: number of the relation of each body to the world (B,); -1 for bodies that stand.
        of_pairs: numbers of the relations whose motions add up to that of each self-collision pair (P, 2); -1 for none.
    """

    def __init__(self, robot: Robot, native: bool | None = False) -> None:
        carriers = [int(body.parentJoint) for body in robot.geometry.geometryObjects]
        pairs = [(carriers[pair.first], carriers[pair.second]) for pair in robot.geometry.collisionPairs]
        worlds = [(0, joint) for joint in carriers if joint]
        views = [[_ordered(robot.model, *pair)] for pair in pairs]
        if len({*worlds, *(view[0] for view in views)}) > _MOST:
            views = [_by_common_joint(robot.model, *view[0]) for view in views]
        numbers = {view: i for i, view in enumerate(dict.fromkeys([*worlds, *(v for pair in views for v in pair)]))}
        self.of_bodies = np.array([numbers[0, joint] if joint else -1 for joint in carriers], int)
        of_pairs = [([numbers[view] for view in pair] + [-1])[:2] for pair in views]
        self.of_pairs = np.array(of_pairs, int).reshape(-1, 2)
        self.relations = [_relation(robot, *view) for view in numbers]
        self._far = np.array([relation.far for relation in self.relations])
        self._levers = np.array([relation.levers for relation in self.relations]).reshape(-1, robot.dimension)
        self._turning = (self._levers > 0) & revolute(robot.model)
        self._poses = _Poses(robot, list(numbers), native)

    def rates(self, Q: np.ndarray) -> np.ndarray:
        """Return bounds on |x'(s)| over the chords between neighbouring rows of Q (T, n), as (T - 1, relations) [m]."""
        moved = np.diff(self._poses(Q), axis=0)  # (T - 1, relations, 12)
        rotated, shifted = (np.einsum("trk,trk->tr", part, part) for part in (moved[:, :, :9], moved[:, :, 9:]))
        # Two rotations an angle a apart move a unit vector by at most 2 sin(a / 2), which is |R1 - R0|_F / sqrt(2).
        turned = np.sqrt(rotated / 2)
        return np.sqrt(shifted) + self._far * turned + self._bows(np.abs(np.diff(Q, axis=0)))

    def _bows(self, dq: np.ndarray) -> np.ndarray:
        """Return max |x''| / 2 of chords with steps |dq| (C, n), as (C, relations)."""
        # sum_k r_k |dq_k| (|dq_k| + 2 sum_{j<k} |dq_j|) <= 2 (sum r |dq|) (sum |dq|) - sum r |dq|^2
        swept, turned = dq @ self._levers.T, dq @ self._turning.T  # (C, relations)
        return swept * turned - (dq * dq) @ (self._levers * self._turning).T / 2


def _ordered(model: pin.Model, one: int, other: int) -> tuple[int, int]:
    """Return two joints, first the one that fewer joints carry: from there fewer are in between."""
    return (one, other) if len(model.supports[one]) <= len(model.supports[other]) else (other, one)


def _by_common_joint(model: pin.Model, one: int, other: int) -> list[tuple[int, int]]:
    """Return the relations of two joints to the last joint that carries both."""
    shared = [a for a, b in zip(model.supports[one], model.supports[other], strict=False) if a == b][-1]
    return [(int(shared), joint) for joint in (one, other) if joint != shared]


class _Poses:
    """Poses of joints' frames as other joints see them, at many configurations at once."""

    def __init__(self, robot: Robot, views: list[tuple[int, int]], native: bool | None) -> None:
        q, p = ca.SX.sym("q", robot.dimension), Numbers()
        joints = sorted({joint for pair in views for joint in pair})
        placed = dict(zip(joints, robot.symbolic_joint_poses(q, joints, p), strict=True))
        poses = [
            placed[seen_from].inverse() @ placed[joint] if seen_from else placed[joint] for seen_from, joint in views
        ]
        columns = [ca.vertcat(ca.vec(ca.densify(pose.rotation)), ca.densify(pose.position)) for pose in poses]
        self._count = len(views)
        if not views:
            return
        structure = structure_of(q, ca.vertcat(*columns), p.symbols, f"robot {robot.name!r}")
        self._function = structure.compiled(
            ("poses",), lambda: Expressions([q], [structure.rows(q)]), p.values, _BLOCK, native
        )
        self._input = self._function.arguments[0].reshape(_BLOCK, -1)
        self._output = self._function.results[0].reshape(_BLOCK, -1)

    def __call__(self, Q: np.ndarray) -> np.ndarray:
        """Return rotations, by columns, and positions [m] at rows of Q (T, n), as (T, views, 12)."""
        found = np.empty((len(Q), self._count, 12))
        if not self._count:
            return found
        for first in range(0, len(Q), _BLOCK):
            block = Q[first : first + _BLOCK]
            self._input[: len(block)] = block
            self._function.evaluate()
            found[first : first + _BLOCK] = self._output[: len(block)].reshape(-1, self._count, 12)
        return found


def _relation(robot: Robot, seen_from: int, joint: int) -> Relation:
    """See `Relation`; bounds hold wherever the joints are within their limits."""
    model, turns = robot.model, revolute(robot.model)
    up, down = list(model.supports[seen_from]), list(model.supports[joint])
    shared = sum(a == b for a, b in zip(up, down, strict=False))  # joints that carry both, the world included
    far = max(_reach(body) for body in robot.geometry.geometryObjects if body.parentJoint == joint)
    levers, distance = np.zeros(robot.dimension), far
    for k in reversed(down[shared:]):
        levers[model.idx_vs[k]] = distance if turns[model.idx_vs[k]] else 1.0
        distance += _step(robot, k)
    for k in up[shared:]:
        distance += _step(robot, k)
        levers[model.idx_vs[k]] = distance if turns[model.idx_vs[k]] else 1.0
    return Relation(seen_from, joint, far, levers)


def _reach(body: pin.GeometryObject) -> float:
    """Return how far points of a body are from the origin of the joint that carries it at most [m]."""
    body.geometry.computeLocalAABB()
    centre = body.placement.act(np.array(body.geometry.aabb_center))
    return float(np.linalg.norm(centre)) + float(body.geometry.aabb_radius)


def _step(robot: Robot, joint: int) -> float:
    """Return how far the origin of a joint, moved, can be from that of the joint before it [m]."""
    model = robot.model
    slid = 0.0
    if not revolute(model)[model.idx_vs[joint]]:
        slid = max(abs(float(bounds[model.idx_qs[joint]])) for bounds in (robot.lower, robot.upper))
    return float(np.linalg.norm(model.jointPlacements[joint].translation)) + slid
