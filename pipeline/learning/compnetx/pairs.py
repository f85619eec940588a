"""What CoMPNetX learns from: demonstrated paths cut into pairs of a configuration and the next one.

A path {q_0, ..., q_T} gives T pairs: in scene i, from q_j, towards q_T, comes q_{j+1} (compnetx.txt, section V-C).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError, ConfigError, require
from pipeline.learning.codec import Codec

Project = Callable[[np.ndarray], np.ndarray]

COLUMNS = ("scene", "problem", "path", "waypoints", "dimension")


@dataclass(frozen=True)
class Pairs:
    """N training pairs.

    Attributes:
        scene: row of the voxel grids (N,).
        current, target, following: configurations (N, n) [rad or m], or their numbers (N, w) once they are encoded;
            `following` is what the network shall answer.
    """

    scene: np.ndarray
    current: np.ndarray
    target: np.ndarray
    following: np.ndarray

    def __len__(self) -> int:
        return len(self.scene)

    def __getitem__(self, rows: np.ndarray) -> "Pairs":
        """Return the pairs at indices, or where a mask (N,) is true."""
        return Pairs(*(getattr(self, f.name)[rows] for f in fields(self)))

    def encoded(self, codec: Codec, width: int) -> "Pairs":
        """Return the pairs as a network takes them, of `width` numbers each."""
        ends = (self.current, self.target, self.following)
        return Pairs(self.scene, *(codec.encode(Q, width).astype(np.float32) for Q in ends))


def resample(path: np.ndarray, spacing: float) -> np.ndarray:
    """Return points at equal arc length along a polyline, its ends included.

    Args:
        path: (T, n), T at least 2.
        spacing: largest arc length between neighbours [rad or m]; the points divide the path evenly.

    Returns:
        (m + 1, n) with m = ceil(length / spacing); (1, n) when the path has no length. Inner points lie on straight
        lines between waypoints, beside the manifold by the square of the gap: project them.
    """
    stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])  # (T,)
    length = stations[-1]
    pieces = int(np.ceil(length / spacing - 1e-9))  # a length of exactly k spacings makes k pieces
    wanted = np.linspace(0.0, length, max(pieces, int(length > 0)) + 1)
    points = np.stack([np.interp(wanted, stations, column) for column in path.T], axis=1)
    points[0], points[-1] = path[0], path[-1] if length > 0 else path[0]
    return points


def demonstration_pairs(
    frame: pd.DataFrame,
    scenes: Sequence[str],
    spacing: float,
    project: Project | None = None,
    reverse: bool = False,
) -> Pairs:
    """Cut demonstrated paths into pairs at even spacing.

    Args:
        frame: one path per row, see `COLUMNS`; `path` is row-major flat, (waypoints, dimension). Rows with fewer than
            two waypoints, or without length, give no pairs.
        scenes: names in the order of the voxel grids.
        spacing: largest arc length between q_j and q_{j+1} [rad or m]. The paper takes the planner's waypoints as
            they come, about a step of 0.05 apart; a longer spacing asks the network for a longer look ahead.
        project: brings rows of configurations (N, n) onto the manifold and returns all of them, in order; it is asked
            once for the inner points of all paths. None leaves them where they are.
        reverse: add each path backwards, because bidirectional planners ask from both ends. Off in the authors' code.

    Raises:
        ConfigError: the spacing is not above 0.
        ArtifactError: a column is missing, a path does not fit its shape or is not finite, a scene is unknown, or
            `project` lost configurations.
    """
    require("spacing", spacing, above=0)
    missing = [name for name in COLUMNS if name not in frame]
    if missing:
        raise ArtifactError(f"demonstrations lack the columns {missing}; expected {list(COLUMNS)}")
    index = {name: i for i, name in enumerate(scenes)}
    unknown = sorted(set(frame["scene"]) - set(index))
    if unknown:
        raise ArtifactError(f"demonstrations are of scenes without voxels: {unknown[:5]} ({len(unknown)} in all)")
    owners, paths = [], []
    for scene, problem, flat, waypoints, dimension in frame[list(COLUMNS)].itertuples(index=False):
        path = resample(_path(scene, problem, flat, waypoints, dimension), spacing) if waypoints > 1 else None
        if path is not None and len(path) > 1:
            owners.append(index[scene])
            paths.append(path)
    if not paths:
        dimension = int(frame["dimension"].iloc[0]) if len(frame) else 0
        return Pairs(np.empty(0, np.int64), *(np.empty((0, dimension), np.float32) for _ in range(3)))
    if project is not None:
        paths = _projected(paths, project)
    pieces = [_forward(path) for path in paths]
    if reverse:
        pieces += [_forward(path[::-1]) for path in paths]
        owners += owners
    scene_rows = np.repeat(np.array(owners, np.int64), [len(piece[0]) for piece in pieces])
    return Pairs(scene_rows, *(np.concatenate(part).astype(np.float32) for part in zip(*pieces, strict=True)))


def together(pieces: Sequence[Pairs]) -> Pairs:
    """Return the pairs of several, one after the other; they have as many numbers each."""
    return Pairs(*(np.concatenate([getattr(piece, f.name) for piece in pieces]) for f in fields(Pairs)))


def split_by_scene(pairs: Pairs, scenes: Sequence[str], validation: Sequence[str]) -> tuple[Pairs, Pairs]:
    """Return (training, validation) pairs; a scene is in one of them only, so that validation means unseen scenes.

    Args:
        pairs: of all training scenes.
        scenes: names in the order of the voxel grids.
        validation: names of the training scenes to hold out; test scenes have no place here.

    Raises:
        ConfigError: an unknown scene, or a side without pairs.
    """
    unknown = sorted(set(validation) - set(scenes))
    if unknown:
        raise ConfigError(f"validation scenes {unknown} are not among the {len(scenes)} scenes of the demonstrations")
    held_out = np.isin(pairs.scene, [i for i, name in enumerate(scenes) if name in set(validation)])
    if held_out.all() or not held_out.any():
        raise ConfigError(
            f"{int(held_out.sum())} of {len(pairs)} pairs are for validation ({len(validation)} of {len(scenes)} "
            "scenes); training and validation both need some"
        )
    return pairs[~held_out], pairs[held_out]


def _path(scene: str, problem: int, flat: np.ndarray, waypoints: int, dimension: int) -> np.ndarray:
    values = np.asarray(flat, float)
    if values.size != waypoints * dimension or not np.isfinite(values).all():
        raise ArtifactError(
            f"path of scene {scene!r}, problem {problem} has {values.size} numbers, "
            f"{int(np.isfinite(values).sum())} of them finite; expected {waypoints} waypoints x {dimension}"
        )
    return values.reshape(waypoints, dimension)


def _projected(paths: list[np.ndarray], project: Project) -> list[np.ndarray]:
    """Project the inner points of all paths in one call; the ends are on the manifold and stay as they are."""
    inner = np.concatenate([path[1:-1] for path in paths])
    found = np.asarray(project(inner))
    if found.shape != inner.shape or not np.isfinite(found).all():
        raise ArtifactError(f"projection returned {found.shape} for {inner.shape} configurations, or not finite ones")
    ends = np.cumsum([len(path) - 2 for path in paths])[:-1]
    return [np.concatenate([p[:1], q, p[-1:]]) for p, q in zip(paths, np.split(found, ends), strict=True)]


def _forward(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return path[:-1], np.broadcast_to(path[-1], path[1:].shape), path[1:]
