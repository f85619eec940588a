"""Meshes of files: read once, and refused where planning could not bear them."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import coal
import numpy as np

from pipeline.errors import ProblemError, RobotError
from pipeline.robots.shapes import LARGEST, BodyShape
from pipeline.robots.xml import check_mesh

_MOST = 200_000  # triangles: coal's boxes around more take more than seconds to make
_COUNTED = 10_000_000  # size of a file [bytes]: smaller ones cannot hold more triangles than that


def load(file: str, scale: Sequence[float], name: str) -> BodyShape:
    """Return the mesh of a file (STL, OBJ, DAE), its units multiplied by a scale (3,); read anew only when it changed.

    Raises:
        ProblemError: no such file, one that cannot be read, a scale that is 0, more triangles than planning bears, or
            an extent beyond LARGEST.
    """
    if not all(scale) or not np.isfinite(scale).all():
        raise ProblemError(f"mesh {name!r} has scale {tuple(scale)}; it must be finite and not 0: 1 keeps the units")
    path = Path(file)
    if not path.is_file():
        raise ProblemError(f"there is no mesh {file!r}")
    try:
        check_mesh(path)
    except RobotError as error:
        raise ProblemError(f"mesh {name!r} cannot be read: {error}") from None
    state = path.stat()
    shape = _read(str(path), state.st_mtime_ns, state.st_size, tuple(float(s) for s in scale))
    extent = float(2 * shape.box[1].max())
    if not extent <= LARGEST:
        raise ProblemError(
            f"mesh {name!r} is {extent:.4g} m large at scale {tuple(scale)}; at most {LARGEST:g} m: a file in "
            "millimetres needs scale 0.001"
        )
    return shape


@lru_cache(maxsize=16)
def _read(file: str, changed: int, size: int, scale: tuple[float, ...]) -> BodyShape:
    """Read a mesh; `changed` is only there to read it again when the file is another one."""
    try:
        if size > _COUNTED:  # boxes of this kind are made five times faster, and only counted
            _check_count(coal.MeshLoader(coal.BV_AABB).load(file, np.array(scale)), file)
        mesh = coal.MeshLoader().load(file, np.array(scale))
    except ProblemError:
        raise
    except Exception as error:  # what assimp's C++ throws has no class of its own
        raise ProblemError(f"mesh {file!r} cannot be read: {str(error).strip()}") from None
    _check_count(mesh, file)
    if not np.isfinite(mesh.vertices()).all():
        raise ProblemError(f"mesh {file!r} has vertices that are not finite")
    shape = BodyShape(mesh)
    if shape.mesh is None or not shape.mesh.areas.any():
        raise ProblemError(f"mesh {file!r} has no triangles, or none with an area")
    return shape


def _check_count(mesh: coal.BVHModelBase, file: str) -> None:
    if mesh.num_tris > _MOST:
        raise ProblemError(
            f"mesh {file!r} has {mesh.num_tris} triangles; at most {_MOST}: simplify it, or give boxes and cylinders "
            "around it instead"
        )
