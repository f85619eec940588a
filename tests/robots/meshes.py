"""Meshes of bodies known in closed form, and the same written in other ways: as soups, inside out, mirrored."""

from pathlib import Path

import numpy as np

Triangles = tuple[np.ndarray, np.ndarray]  # vertices (V, 3) [m], faces (F, 3)


def box(size=(1.0, 1.0, 1.0), middle=(0.0, 0.0, 0.0)) -> Triangles:
    """A box of twelve triangles, wound outwards."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6),
             (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    return corners * size + middle, np.array(faces)


def grid(rows: int, columns: int, wrapped: bool) -> np.ndarray:
    """Faces of a grid of vertices whose columns, and rows where `wrapped`, close."""
    i, j = np.meshgrid(np.arange(rows if wrapped else rows - 1), np.arange(columns), indexing="ij")
    corners = [((i + a) % rows) * columns + (j + b) % columns for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return np.concatenate([np.stack([corners[k] for k in t], axis=-1).reshape(-1, 3) for t in ((0, 1, 2), (0, 2, 3))])


def torus(major=0.4, minor=0.15, count=60) -> Triangles:
    """A torus about z: its surface is within minor * (pi / count)^2 of the closed form."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around, across = (part.ravel() for part in np.meshgrid(turn, turn, indexing="ij"))
    ring = major + minor * np.cos(across)
    return np.stack([ring * np.cos(around), ring * np.sin(around), minor * np.sin(across)], axis=1), grid(
        count, count, True
    )


def ball(radius=0.5, count=80) -> Triangles:
    """A ball; many vertices at its poles become one, and their faces lines."""
    up, turn = np.linspace(0, np.pi, count // 2 + 1), np.linspace(0, 2 * np.pi, count, endpoint=False)
    up, turn = (part.ravel() for part in np.meshgrid(up, turn, indexing="ij"))
    points = radius * np.stack([np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), np.cos(up)], axis=1)
    return points, grid(count // 2 + 1, count, False)


def tube(radius=0.5, length=1.0, count=80) -> Triangles:
    """A cylinder along z, with a fan from the middle of each cap."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    ring, up = radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), np.array([[0.0, 0.0, length / 2]])
    points = np.concatenate([ring - up, ring + up, -up, up])
    i, after = np.arange(count), (np.arange(count) + 1) % count
    fans = [np.stack([np.full(count, 2 * count + k), k * count + i, k * count + after], axis=1) for k in (0, 1)]
    return points, np.concatenate([grid(2, count, False), fans[0], fans[1][:, ::-1]])


def corner(size=1.0) -> Triangles:
    """An L of two boxes of half the size: a closed mesh that is not convex."""
    outline = np.array([[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]]) * size - size / 2
    low, high = (np.column_stack([outline, np.full(6, z * size)]) for z in (-0.5, 0.5))
    flat = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)])
    return np.concatenate([low, high]), np.concatenate([grid(2, 6, False), flat, flat[:, ::-1] + 6])


def joined(*meshes: Triangles) -> Triangles:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=False)]
    return np.concatenate([points for points, _ in meshes]), np.concatenate(faces)


def flipped(mesh: Triangles, rng: np.random.Generator) -> Triangles:
    """The same with a random half of the faces wound the other way."""
    points, faces = mesh
    turned = rng.random(len(faces)) < 0.5
    return points, np.where(turned[:, None], faces[:, ::-1], faces)


def soup(mesh: Triangles, rng: np.random.Generator) -> Triangles:
    """The same with vertices of their own for every face, in another order."""
    points, faces = mesh
    faces = faces[rng.permutation(len(faces))]
    order = rng.permutation(3 * len(faces))
    vertices = np.empty((len(order), 3))
    vertices[order] = points[faces.ravel()]
    return vertices, order.reshape(-1, 3)


def write(path: Path, mesh: Triangles) -> str:
    """Write an OBJ and return its name."""
    points, faces = mesh
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    path.write_text(text + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces.tolist()))
    return str(path)
