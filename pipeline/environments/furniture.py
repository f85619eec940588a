"""Boxes and cylinders that stand upright, and random ones."""

from collections.abc import Sequence

import numpy as np

from pipeline.robots import Obstacle, Shape


def box(name: str, position: Sequence[float], size: tuple[float, float, float], turn: float = 0.0) -> Obstacle:
    """Return a box with its middle at `position` (3,) [m], turned about the vertical [rad]."""
    x, y, z = (float(value) for value in position)
    return Obstacle(Shape.BOX, (x, y, z), (0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2))), size, name)


def cylinder(name: str, position: Sequence[float], width: float, height: float) -> Obstacle:
    """Return an upright cylinder with its middle at `position` (3,) [m]."""
    x, y, z = (float(value) for value in position)
    return Obstacle(Shape.CYLINDER, (x, y, z), (0.0, 0.0, 0.0, 1.0), (width, width, height), name)


def random_object(rng: np.random.Generator, name: str, foot: Sequence[float], heights: tuple[float, float]) -> Obstacle:
    """Return a box or a cylinder, 3 to 12 cm wide, that stands at `foot` (3,) [m]; heights are bounds [m]."""
    width, depth, height = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.12), rng.uniform(*heights)
    turn = rng.uniform(-np.pi, np.pi)
    x, y, z = foot
    middle = (x, y, z + height / 2)
    if rng.random() < 0.5:
        return cylinder(name, middle, width, height)
    return box(name, middle, (width, depth, height), turn)
