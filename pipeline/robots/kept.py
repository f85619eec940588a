"""Pieces of meshes, kept in the user's cache: cutting a large mesh takes a second or two."""

import hashlib
import logging
import os
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import scipy

from pipeline.cache import cache_folder
from pipeline.robots import cuts, pieces

log = logging.getLogger(__name__)


def kept_pieces(triangles: np.ndarray) -> list[np.ndarray]:
    """Return `convex_pieces` of a mesh (M, 3, 3) [m], the same to the bit whether they were kept or are made now."""
    content = np.ascontiguousarray(triangles, float)
    key = hashlib.sha256(
        "\0".join(
            [scipy.__version__, *(Path(str(module.__file__)).read_text() for module in (cuts, pieces)), ""]
        ).encode()
    )
    key.update(content.tobytes())
    path = cache_folder() / f"{key.hexdigest()[:32]}.npz"
    try:
        with np.load(path, allow_pickle=False) as file:
            return [file[f"arr_{i}"] for i in range(len(file.files))]
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        log.warning("%s cannot be read (%s): the pieces are made again", path, error)
    made = pieces.convex_pieces(content)
    try:
        _write(path, made)
    except OSError as error:
        log.warning("%s cannot be written (%s): the pieces are made again next time", path, error)
    return made


def _write(path: Path, made: list[np.ndarray]) -> None:
    """Write beside the place, and move there: a killed run leaves nothing half-written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        written = Path(folder) / "pieces.npz"
        np.savez(written, *made)
        os.replace(written, path)
