"""Bodies that no joint moves, held against obstacles once: a robot stands on its floor, and in nothing else."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.verification.kinematics import WORLD
from pipeline.verification.pairs import Item, usual_depth
from pipeline.verification.touching import Asker, Placed

_NOTHING = 1e-6  # [m] of bodies that may not touch: what rounding in a file makes of touching


def standing_contact(items: Sequence[Item], touching: Mapping[tuple[str, str], float | None]) -> str | None:
    """Return in a sentence which body stands in an obstacle, deeper than it may; None where none does.

    Bodies of the robot's root link may touch what they stand on to the usual depth, others what they are said to touch.

    Args:
        items: of robot and obstacles.
        touching: pairs (body, obstacle) that may touch, and how deep [m]; None for the usual depth.
    """
    ask = Asker()
    there = [item for item in items if item.body < 0]
    if not there:
        return None
    middles = np.array([item.place.R @ item.form.middle + item.place.p for item in there])
    radii = np.array([item.form.radius for item in there])
    for item in (item for item in items if item.body >= 0 and item.joint == WORLD):
        middle = item.place.R @ item.form.middle + item.place.p
        near = np.flatnonzero(np.linalg.norm(middles - middle, axis=1) <= radii + item.form.radius)
        for other in (there[i] for i in near.tolist()):
            depth = ask.depth(_placed(item), _placed(other))
            allowed = _NOTHING
            if item.base or (item.name, other.name) in touching:
                asked = touching.get((item.name, other.name))
                allowed = usual_depth(item.form, other.form) if asked is None else asked
            if depth > allowed:
                return (
                    f"{item.name!r}, which no joint moves, is {depth:.3g} m deep in {other.name!r}; "
                    f"allowed {allowed:.3g} m"
                )
    return None


def _placed(item: Item) -> Placed:
    return item.form, item.place.R, item.place.p
