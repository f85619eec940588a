"""The order of a model's variables, which need not be that of its joints."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

_OF_VARIABLES = (
    *("lowerPositionLimit", "upperPositionLimit", "lowerVelocityLimit", "upperVelocityLimit"),
    *("lowerEffortLimit", "upperEffortLimit", "lowerDryFrictionLimit", "upperDryFrictionLimit"),
    *("damping", "armature", "rotorInertia", "rotorGearRatio", "positionLimitMargin"),
)


def in_order(model: pin.Model, names: Sequence[str]) -> pin.Model:
    """Return a model whose variables are in the order of `names`, all of its joints, each with one degree of freedom.

    Joints stay in the order of the kinematic tree, as pinocchio needs them; variable i belongs to the joint with
    `idx_qs` i. Kinematics heed that. What counts on the tree's order does not: `crba` and what stands on it.
    """
    model = pin.Model(model)
    places = [names.index(name) for name in list(model.names)[1:]]
    for attribute in _OF_VARIABLES:
        values = np.array(getattr(model, attribute))
        reordered = values.copy()
        reordered[places] = values
        setattr(model, attribute, reordered)
    place_variables(model, places)
    return model


def revolute(model: pin.Model) -> np.ndarray:
    """Return which variables turn a joint, and do not slide one (n,)."""
    found = np.zeros(model.nv, bool)
    for joint, place in zip(list(model.joints)[1:], list(model.idx_vs)[1:], strict=True):
        found[place] = "JointModelR" in joint.shortname()
    return found


def place_variables(model: pin.Model, places: Sequence[int]) -> None:
    """Give every joint but the world (m,), each with one degree of freedom, the variable at its place."""
    for joint, place in enumerate(places, 1):
        model.joints[joint].setIndexes(joint, place, place)
        model.idx_qs[joint] = model.idx_vs[joint] = model.idx_vExtendeds[joint] = place
