"""How fast bodies move along a typical chord of a manifold: the shape of the reserves by which paths are proven."""

from functools import lru_cache

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ConstraintError
from pipeline.manifolds.displacement import Displacement
from pipeline.robots import Robot

_TYPICAL = 64  # random chords are looked at
_FAST = 0.9  # quantile of their speeds that counts as typical
_KEPT = 16  # manifolds of which it is kept: it takes 50 ms to find out
_PARTS, _PAYS = 4, 0.6  # chords are cut in so many parts where the fastest body then counts as so much slower


@lru_cache(maxsize=_KEPT)
def typical_motion(
    constraint: Constraint, robot: Robot, step: float, native: bool | None
) -> tuple[Displacement, np.ndarray, int]:
    """Return how bodies move along chords, how fast along typical ones, and in how many parts these are looked at.

    Typical are random steps in the tangent space. Two arms that hold one body move against each other by little but the
    bow, which is a quarter of the whole where chords are cut in four; elsewhere that does not pay.

    Args:
        constraint: of the manifold.
        robot: whose bodies move.
        step: length of the chords [rad or m].
        native: evaluate the kinematics as machine code where there is a C compiler.

    Returns:
        Bounds; speeds by relation (relations,) [m], all 1 where no random configuration reaches the manifold; parts.
    """
    displacement, rng = Displacement(robot, native), np.random.default_rng(0)
    Q, converged = constraint.project_batch(rng.uniform(*robot.box, (2 * _TYPICAL, robot.dimension)))
    Q = Q[converged & np.isfinite(Q).all(axis=1)][:_TYPICAL]
    steps = [(q, _tangent_step(constraint, q, step, rng)) for q in Q]
    found = {}
    for parts in (1, _PARTS):
        rates = [parts * displacement.rates(np.stack([q, q + dq / parts]))[0] for q, dq in steps]
        rates = rates or [np.ones(len(displacement.relations))]
        found[parts] = np.quantile(rates, _FAST, axis=0)  # (relations,)
    parts = _PARTS if found[_PARTS].max(initial=0.0) < _PAYS * found[1].max(initial=0.0) else 1
    return displacement, found[parts], parts


def _tangent_step(constraint: Constraint, q: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """Return a step (n,) in a random direction; along the tangent space at q, where there is one."""
    try:
        tangent = constraint.frame(q)[0]
    except ConstraintError:
        tangent = np.eye(len(q))
    step = tangent @ rng.normal(size=tangent.shape[1])
    return length / max(float(np.linalg.norm(step)), 1e-12) * step
