"""How much the centre of mass bows away from a straight line while the joints move along one."""

from collections.abc import Callable

import numpy as np

from pipeline.robots.model import Robot
from pipeline.robots.order import revolute


def centre_of_mass_bend(robot: Robot) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that bounds |c''| of the centre of mass c over chords with steps dq (C, n), as (C,) [m].

    The centre of mass of what a joint carries is at x with |x''| <= sum_k r_k |dq_k| (|dq_k| + 2 sum_{j<k} |dq_j|),
    where r_k is how far it can be from the axis of joint k, and j < k are the joints before k that turn. That of the
    robot is the average of these, by mass; bounds hold wherever the joints are within their limits.
    """
    model, n = robot.model, robot.dimension
    turns = revolute(model)
    slides = np.where(turns, 0.0, np.maximum(np.abs(robot.lower), np.abs(robot.upper)))
    levers, before = np.zeros(n), np.zeros((n, n))
    total = sum(inertia.mass for inertia in list(model.inertias)[1:])
    for joint in range(1, model.njoints):
        k = model.idx_vs[joint]
        carriers = [model.idx_vs[other] for other in list(model.supports[joint])[1:-1]]
        before[carriers, k] = 2.0
        before[k, k] = 1.0
        inertia = model.inertias[joint]
        distance, other = float(np.linalg.norm(inertia.lever)), joint
        while other and inertia.mass > 0:
            i = model.idx_vs[other]
            levers[i] += inertia.mass / total * (distance if turns[i] else 1.0)
            distance += float(np.linalg.norm(model.jointPlacements[other].translation)) + slides[i]
            other = model.parents[other]
    before *= turns[:, None]

    def bend(steps: np.ndarray) -> np.ndarray:
        dq = np.abs(steps)  # (C, n)
        return (dq * (dq @ before)) @ levers

    return bend
