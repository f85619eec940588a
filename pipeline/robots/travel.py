"""How far bodies travel: bounds that hold wherever the other joints are within their limits."""

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from pipeline.robots.model import Robot

_AXES = {"X": 0, "Y": 1, "Z": 2}
_DIGITS = 12


def lever_arms(robot: "Robot") -> np.ndarray:
    """Return by how much any point of each body moves at most per unit of each joint (B, n) [m per rad or m].

    A point turns about a revolute joint at its distance from the axis, which is at most the sum of the links between;
    a prismatic joint carries everything after it along. What bodies are made of lies in a ball around their box.
    """
    model, bodies = robot.model, robot.geometry.geometryObjects
    reach = np.maximum(np.abs(robot.lower), np.abs(robot.upper))  # of prismatic joints, from where they are 0
    arms = np.zeros((len(bodies), robot.dimension))
    for row, body in enumerate(bodies):
        joint = body.parentJoint
        if not joint:
            continue
        body.geometry.computeLocalAABB()
        centre, radius = body.placement.act(np.array(body.geometry.aabb_center)), float(body.geometry.aabb_radius)
        arms[row, model.idx_vs[joint]] = _lever(model, joint, centre) + radius if _turns(model, joint) else 1.0
        far = float(np.linalg.norm(centre)) + radius  # from the joint's origin
        while model.parents[joint]:
            parent, offset = model.parents[joint], model.jointPlacements[joint].translation
            slid = 0.0 if _turns(model, joint) else float(reach[model.idx_qs[joint]])
            turned = _lever(model, parent, offset) + slid + far
            arms[row, model.idx_vs[parent]] = turned if _turns(model, parent) else 1.0
            far += float(np.linalg.norm(offset)) + slid
            joint = parent
    return arms


def pair_arms(robot: "Robot", arms: np.ndarray) -> np.ndarray:
    """Return `lever_arms` of the bodies of each self-collision pair against each other (P, n).

    Joints that carry both bodies do not count.
    """
    model, bodies = robot.model, robot.geometry.geometryObjects
    supports = [frozenset(model.supports[body.parentJoint]) for body in bodies]
    between = np.zeros((len(robot.geometry.collisionPairs), robot.dimension))
    for row, pair in enumerate(robot.geometry.collisionPairs):
        first, second = pair.first, pair.second
        apart = [model.idx_vs[joint] for joint in supports[first] ^ supports[second] if joint]
        between[row, apart] = (arms[first] + arms[second])[apart]
    return between


def sliding_bound(robot: "Robot") -> float | None:
    """Return how far bodies travel at most, alone or against each other, per joint distance; None where one turns.

    Without joints that turn, a body's displacement is a matrix, the axes of the joints that carry it, times that of the
    joints: no more than its largest singular value.
    """
    model, bodies = robot.model, robot.geometry.geometryObjects
    axes = np.zeros((len(bodies), 3, robot.dimension))
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for row, body in enumerate(bodies):
        joint = body.parentJoint
        if any(_turns(model, carrier) for carrier in model.supports[joint] if carrier):
            return None
        if joint:
            axes[row] = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[:3]
    pairs = [axes[pair.first] - axes[pair.second] for pair in robot.geometry.collisionPairs]
    moves = np.concatenate([axes, np.array(pairs).reshape(-1, 3, robot.dimension)])
    # Rounded: a unit matrix has singular values of 1, to the last digit.
    return float(np.linalg.norm(moves, ord=2, axis=(1, 2)).max(initial=0.0).round(_DIGITS))


def _turns(model: pin.Model, joint: int) -> bool:
    return "JointModelR" in model.joints[joint].shortname()


def _lever(model: pin.Model, joint: int, point: np.ndarray) -> float:
    """The distance of a point of a joint's frame from the joint's axis, or from its origin where that is no axis."""
    axis = _AXES.get(model.joints[joint].shortname().removeprefix("JointModelR"))
    kept = np.array(point, float)
    if axis is not None:
        kept[axis] = 0.0
    return float(np.linalg.norm(kept))
