"""Centres of mass of carried bodies, each of one density."""

from pathlib import Path

import numpy as np

from pipeline.robots.obstacles import Obstacle, Shape
from pipeline.verification.urdf import read_mesh

_SAME = 1e-9  # corners nearer than this are one, of the mesh's diagonal


def centre_of_mass(body: Obstacle) -> np.ndarray:
    """Return a body's centre of mass (3,) [m] in its frame: of a closed mesh the solid's, of an open one the surface's.

    Raises:
        RobotError: a mesh that cannot be read.
    """
    if body.shape is Shape.OCTREE and body.points is not None:
        edge = body.size[0]
        return np.asarray((np.unique(np.floor(body.points / edge), axis=0) + 0.5).mean(axis=0) * edge)
    if body.shape is not Shape.MESH:
        return np.zeros(3)
    mesh = read_mesh(Path(body.file), np.array(body.size))
    faces = np.array([[mesh.tri_indices(i)[k] for k in range(3)] for i in range(mesh.num_tris)])
    return centre_of_faces(np.array(mesh.vertices()), faces)


def centre_of_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the centre of mass (3,) of what faces (M, 3) of vertices (N, 3) enclose, however they are wound.

    Faces that share edges are wound alike first; parts of several shells count each for itself. Where an edge has not
    two faces nothing is enclosed, and the surface is what has mass.
    """
    span = float(np.linalg.norm(np.ptp(vertices, axis=0))) or 1.0
    _, first, same = np.unique(
        np.round(vertices / (_SAME * span)).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    corners, faces = vertices[first], same.reshape(-1)[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]  # those without area
    signs = _wound_alike(faces)
    a, b, c = corners[faces].swapaxes(0, 1)
    if signs is None:
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(areas @ ((a + b + c) / 3) / areas.sum())
    sign, shell = signs
    origin = corners.mean(axis=0)
    volumes = sign * np.einsum("ij,ij->i", np.cross(a - origin, b - origin), c - origin)
    whole = np.bincount(shell, volumes)
    volumes *= np.sign(whole)[shell]
    return np.asarray(volumes @ (a + b + c + origin) / 4 / volumes.sum())


def _wound_alike(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return a sign for every face (M,) and the number of its shell (M,); None where the surface is open or crossed."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    ahead = edges[:, 0] < edges[:, 1]
    _, edge, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    if not len(faces) or (count != 2).any():
        return None
    order = np.argsort(edge.reshape(-1), kind="stable").reshape(-1, 2)  # the two faces of every edge
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for i, j in order.tolist():
        alike = bool(ahead[i] != ahead[j])
        neighbours[owner[i]].append((int(owner[j]), alike))
        neighbours[owner[j]].append((int(owner[i]), alike))
    sign, shell = np.zeros(len(faces)), np.zeros(len(faces), int)
    shells = 0
    for begin in range(len(faces)):
        if sign[begin]:
            continue
        sign[begin], shell[begin], stack = 1.0, shells, [begin]
        while stack:
            face = stack.pop()
            for other, alike in neighbours[face]:
                if not sign[other]:
                    sign[other], shell[other] = sign[face] * (1 if alike else -1), shells
                    stack.append(other)
        shells += 1
    return sign, shell
