"""Points on the surfaces of obstacles: an ideal point cloud, without a camera and its shadows.

The authors of CoMPNetX read the sphere's scenes in the same way (their code draws points on the blocks, not a depth
image). Surfaces inside another obstacle are sampled too.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.errors import ConfigError
from pipeline.robots import PRIMITIVES, Obstacle, Shape


def surface_area(obstacle: Obstacle) -> float:
    """Return the area of an obstacle's whole surface [m^2]."""
    return float(_patches(obstacle).sum())


def surface_points(obstacles: Sequence[Obstacle], density: float, rng: np.random.Generator) -> np.ndarray:
    """Draw points independently and uniformly by area on the surfaces of all obstacles.

    Args:
        obstacles: of the scene; none gives no points.
        density: points per area [1/m^2]; their number is density times the area of all surfaces, rounded.
        rng: the only source of chance.

    Returns:
        Points in the world (N, 3) [m], those of one obstacle next to each other.

    Raises:
        ConfigError: the density is negative or not finite.
        ProblemError: a shape that cannot be, or a mesh that cannot be read.
    """
    if not 0 <= density < np.inf:
        raise ConfigError(f"density is {density} points/m^2; it must be finite and at least 0")
    if not obstacles:
        return np.empty((0, 3))
    patches = [_patches(o) for o in obstacles]
    areas = np.array([found.sum() for found in patches])
    owner = np.sort(rng.choice(len(obstacles), size=round(density * areas.sum()), p=areas / areas.sum()))
    local = np.empty((len(owner), 3))
    sizes = np.array([o.size for o in obstacles])[owner]  # (N, 3)
    shapes = np.array([o.shape.value for o in obstacles])[owner]
    parts = np.array([found if len(found) == 3 else np.zeros(3) for found in patches])
    for shape, draw in ((Shape.BOX, _on_boxes), (Shape.SPHERE, _on_spheres), (Shape.CYLINDER, _on_cylinders)):
        chosen = shapes == shape.value
        local[chosen] = draw(sizes[chosen], parts[owner[chosen]], rng)
    for number, obstacle in enumerate(obstacles):
        if obstacle.shape not in PRIMITIVES:
            chosen = owner == number
            local[chosen] = _on_triangles(_corners(obstacle), patches[number], int(chosen.sum()), rng)
    rotations = np.array([o.rotation for o in obstacles])[owner]  # (N, 3, 3)
    positions = np.array([o.position for o in obstacles])[owner]
    return np.einsum("nij,nj->ni", rotations, local) + positions


def _patches(obstacle: Obstacle) -> np.ndarray:
    """Areas of the parts of a surface: of a primitive (3,), of others of each triangle.

    A box's are its pairs of faces across x, y, z; a cylinder's its mantle and two caps.
    """
    x, y, z = obstacle.size
    if obstacle.shape is Shape.BOX:
        return np.array([2 * y * z, 2 * x * z, 2 * x * y])
    if obstacle.shape is Shape.SPHERE:
        return np.array([np.pi * x**2, 0.0, 0.0])
    if obstacle.shape is Shape.CYLINDER:
        return np.array([np.pi * x * z, np.pi * x**2 / 4, np.pi * x**2 / 4])
    a, b, c = _corners(obstacle).swapaxes(0, 1)
    areas: np.ndarray = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return areas


def _corners(obstacle: Obstacle) -> np.ndarray:
    """Corners of the triangles of a mesh, or of an octree's leaves where they face no other leaf (F, 3, 3) [m]."""
    shape = obstacle.body_shape()
    if shape.mesh is not None:
        return shape.mesh.corners
    edge = obstacle.size[0]
    cells = np.floor(np.array(shape.given.toBoxes())[:, :3] / edge).astype(np.int64)  # (C, 3), each once
    found = []
    for axis in range(3):
        others = np.roll(np.eye(3, dtype=np.int64), -1 - axis, axis=0)[:2]  # the two directions across
        for side in (-1, 1):
            beyond = cells.copy()
            beyond[:, axis] += side
            outer = cells[~_among(beyond, cells)]
            corner = outer + (side > 0) * np.eye(3, dtype=np.int64)[axis]
            square = [corner, corner + others[0], corner + others[0] + others[1], corner + others[1]]
            found += [np.stack([square[0], square[i], square[i + 1]], axis=1) for i in (1, 2)]
    corners: np.ndarray = np.concatenate(found) * edge
    return corners


def _among(rows: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Tell which rows (N, 3) are among different known ones (C, 3), as (N,)."""
    both, place = np.unique(np.concatenate([known, rows]), axis=0, return_inverse=True)
    there = np.zeros(len(both), bool)
    there[place.ravel()[: len(known)]] = True
    found: np.ndarray = there[place.ravel()[len(known) :]]
    return found


def _on_triangles(corners: np.ndarray, areas: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    a, b, c = corners[rng.choice(len(corners), size=count, p=areas / areas.sum())].swapaxes(0, 1)
    u, v = rng.random((2, count, 1))
    beyond = u + v > 1  # the other half of the parallelogram
    return a + np.where(beyond, 1 - u, u) * (b - a) + np.where(beyond, 1 - v, v) * (c - a)


def _choose(patches: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Choose one of three parts per row (N,), with odds in the proportion of their areas (N, 3)."""
    edges = np.cumsum(patches, axis=1)
    return (rng.random(len(patches))[:, None] * edges[:, 2:] >= edges[:, :2]).sum(axis=1)


def _on_boxes(sizes: np.ndarray, patches: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    axis = _choose(patches, rng)
    points = rng.uniform(-0.5, 0.5, (len(sizes), 3))
    points[np.arange(len(sizes)), axis] = np.where(rng.random(len(sizes)) < 0.5, -0.5, 0.5)
    return points * sizes


def _on_spheres(sizes: np.ndarray, patches: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    directions = rng.standard_normal((len(sizes), 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * sizes[:, :1] / 2


def _on_cylinders(sizes: np.ndarray, patches: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    part = _choose(patches, rng)
    mantle = part == 0
    angle = rng.uniform(-np.pi, np.pi, len(sizes))
    radius = sizes[:, 0] / 2 * np.where(mantle, 1.0, np.sqrt(rng.random(len(sizes))))
    height = sizes[:, 2] * np.where(mantle, rng.uniform(-0.5, 0.5, len(sizes)), part - 1.5)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
