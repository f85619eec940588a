"""Contact that is allowed: which pairs of bodies may touch, and how deep.

What touches is not left out of the checks: it may be a little inside, so that a cup may stand on a table without
sinking into it, and nothing passes through anything.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import ProblemError
from pipeline.robots.shapes import BodyShape

DEPTH = 0.002  # [m] of bodies that may touch: the manifold's tolerance and what a file rounds are within it
_SHARE = 0.1  # of the thinner body's least extent, which the depth is at most unless another is asked for
_MOST = 0.5  # of the same, of a depth that is asked for: two bodies that pass through each other are deeper on the way
_KEPT = 0.25  # of the depth: what planning leaves of it at most, where it keeps a margin from others

Touching = Collection[tuple[str, str]] | Mapping[tuple[str, str], float | None]


@dataclass(frozen=True)
class Pair:
    """Two bodies that are held against each other.

    Attributes:
        first: name of a body of the robot.
        second: name of another one, or of an obstacle.
        depth: how deep they may be in each other [m]; 0 where they may not touch.
        body: number of the first among the robot's bodies.
        other: number of the second among them, or among the obstacles.
        obstacle: whether the second is an obstacle.
    """

    first: str
    second: str
    depth: float
    body: int
    other: int
    obstacle: bool


@dataclass(frozen=True)
class Contact:
    """Two bodies that are in each other.

    Attributes:
        first, second: their names.
        depth: the shortest way out [m].
    """

    first: str
    second: str
    depth: float


def depths_asked(touching: Touching) -> dict[tuple[str, str], float | None]:
    """Return the pairs with the depth that was asked for [m]; None for the usual one."""
    if isinstance(touching, Mapping):
        return dict(touching)
    return dict.fromkeys(touching)


def allowed_depth(names: tuple[str, str], shapes: Sequence[BodyShape], asked: float | None) -> float:
    """Return how deep two bodies that may touch may be in each other [m].

    Args:
        names: of the two, for messages.
        shapes: theirs.
        asked: what a user says; None for DEPTH, or a tenth of the thinner body where that is less.

    Raises:
        ProblemError: a mesh that is not convex, or an octree: nobody knows how deep something is in them; or a depth
            that is out of bounds.
    """
    first, second = names
    for name, shape in zip(names, shapes, strict=True):
        if not shape.convex:
            what = "an octree" if shape.mesh is None else "a mesh that is not convex"
            open_one = "a mesh with open edges" if shape.open else what
            raise ProblemError(
                f"{first!r} may touch {second!r}, but {name!r} is {open_one}, of which no depth is known: give what is "
                "touched there as boxes, cylinders, spheres or closed convex meshes"
            )
    if asked is None:
        return usual_depth(shapes)
    thin = min(shape.thickness for shape in shapes)
    if not 0 < asked <= _MOST * thin:
        raise ProblemError(
            f"{first!r} may touch {second!r} {asked} m deep; it must be above 0 m and at most {_MOST * thin:.4g} m, "
            "half of the thinner one's least extent"
        )
    return float(asked)


def usual_depth(shapes: Sequence[BodyShape]) -> float:
    """Return how deep bodies that may touch may be in each other unless another depth is asked for [m]."""
    return min(DEPTH, _SHARE * min(shape.thickness for shape in shapes))


def kept(margin: float, depth: np.ndarray, reserve: float = 0.0) -> np.ndarray:
    """Return the distances that pairs keep (P,) [m]: the margin, or less than nothing where they may touch.

    Where others keep a margin, pairs that touch leave some of their depth, so that what is checked more finely
    afterwards is not at the very bound.

    Args:
        margin: of pairs that may not touch [m].
        depth: how deep pairs may be in each other (P,) [m]; 0 where they may not touch.
        reserve: that all keep besides [m].
    """
    return np.where(depth > 0, np.minimum(margin, _KEPT * depth) - depth, margin) + reserve
