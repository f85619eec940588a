"""Still pictures of paths and samples on the sphere: rendered by VTK, or drawn flat where VTK cannot start."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from pipeline.errors import ProblemError
from pipeline.reporting import stills_plain
from pipeline.reporting.globe import Globe, View, corners, covered, views
from pipeline.reporting.renderer import plain_wanted, render
from pipeline.reporting.style import color, new_figure, save, style
from pipeline.robots import Obstacle, Shape

HALF = 1.08  # half the width of a panel, in radii: leaves room for blocks and balls at the edge
LOOK: dict[str, Any] = {
    "sphere": "#E4E4E4", "obstacle": "#8A8F98", "start": "#000000", "goal": "#CC79A7",  # goal: Okabe and Ito
    "tube": 0.011, "dot": 0.014, "ball": 0.035,  # in radii: seen at 7 cm of print, thinner than a block of 0.1
}  # fmt: skip
_PIXELS = 800
_PANEL = 3.4  # [inch]
_LARGE = 0.5  # obstacles wider than this [radii] are shown as a relief where they cut the sphere: whole they hide it
_RELIEF = (541, 1081)  # every third of a degree
_CLOUDS = ("#009E73", "#0B4FA3", "#D55E00", "#555555")  # none is the red of the path they are to surround


class Stills:
    """Draws stills; at the first failure of VTK it says so once and draws flat pictures from then on.

    Args:
        plain: True draws flat pictures only, None asks the environment (`plain_wanted`).
        renderer: the command that renders; it gets two file names, see `stills_vtk.py`.
    """

    def __init__(self, plain: bool | None = None, renderer: Sequence[str] | None = None) -> None:
        self.plain = plain_wanted() if plain is None else plain
        # -P keeps this folder off the script's path: its modules would pass for others (markdown).
        self._renderer = renderer or (sys.executable, "-P", str(Path(__file__).with_name("stills_vtk.py")))

    def paths(self, globes: Sequence[Globe], file: Path, title: str = "") -> str:
        """Draw globes side by side with their paths (the paper's Figs. 1 and 7) and return how: 'VTK' or 'matplotlib'.

        The far sides are shown too where a path would be hidden: below, or for a single globe beside it.

        Args:
            globes: one per column.
            file: the PNG to write.
            title: over the picture.
        """
        return self._draw(globes, [views(globe) for globe in globes], file, title)

    def samples(
        self, globe: Globe, clouds: Mapping[str, np.ndarray], file: Path, title: str = "", colors: Sequence[str] = ()
    ) -> str:
        """Draw clouds of samples side by side on both sides of the sphere (Fig. 8); return 'VTK' or 'matplotlib'.

        Samples are shown on the surface, radially from where they are: inside the sphere they would not be seen.

        Args:
            globe: obstacles, start, goal and the paths that fix the camera; its paths are drawn.
            clouds: name -> samples (N, 3) [m], one per column.
            file: the PNG to write.
            title: over the picture.
            colors: of the clouds.
        """
        columns = []
        palette = [*colors, *_CLOUDS[len(colors) :]][: len(clouds)]
        for (name, cloud), shade in zip(clouds.items(), palette, strict=True):
            lifted = np.asarray(cloud, float).reshape(-1, 3)
            lengths = np.linalg.norm(lifted, axis=1, keepdims=True)
            lifted = globe.radius * lifted / np.where(lengths > 0, lengths, 1)
            inside = int(covered(lifted, globe.obstacles).sum())
            label = f"{name}\nn = {len(lifted)}, {inside} inside obstacles"
            columns.append(
                Globe(globe.obstacles, globe.start, globe.goal, globe.paths, lifted, shade, label, globe.radius)
            )
        return self._draw(columns, [views(column, both_sides=True) for column in columns], file, title)

    def _draw(self, globes: Sequence[Globe], cameras: list[list[View]], file: Path, title: str) -> str:
        if not globes:
            raise ProblemError("a still needs at least one globe, got none")
        images = None if self.plain else self._render(globes, cameras)
        rows, single = max(map(len, cameras)), len(globes) == 1
        shape = (1, rows) if single else (rows, len(globes))
        width = max(_PANEL * shape[1], 5.2)
        with style():
            figure = new_figure(width, _PANEL * shape[0] + 1.1)
            figure.suptitle("\n".join(filter(None, (title, globes[0].title if single else ""))), fontsize=10)
            grid = figure.subplots(*shape, squeeze=False)
            rendered = iter([] if images is None else images)
            for axes in grid.flat:
                axes.set_axis_off()
            for column, (globe, looks) in enumerate(zip(globes, cameras, strict=True)):
                if not single:
                    grid[0, column].set_title(globe.title, fontsize=9)
                for row, view in enumerate(looks):
                    axes = grid[0, row] if single else grid[row, column]
                    if images is None:
                        stills_plain.draw(axes, globe, view, LOOK, HALF)
                    else:
                        reach = HALF * globe.radius
                        axes.imshow(next(rendered), extent=(-reach, reach, -reach, reach))
                    _name_ends(axes, globe, view)
                    if len(looks) > 1:
                        side = "near side" if row == 0 else "far side"
                        axes.text(0.02, 0.98, side, transform=axes.transAxes, va="top", fontsize=8)
            figure.legend(handles=_legend(globes), loc="outside lower center", ncols=6 if width > 6.5 else 3)
            save(figure, file)
        return "matplotlib" if images is None else "VTK"

    def _render(self, globes: Sequence[Globe], cameras: list[list[View]]) -> np.ndarray | None:
        """Return the panels' images (K, pixels, pixels, 3), or None where VTK failed, after saying so."""
        images = render(self._renderer, _scene(globes, cameras), sum(map(len, cameras)))
        self.plain = images is None
        return images


def _scene(globes: Sequence[Globe], cameras: list[list[View]]) -> dict[str, np.ndarray]:
    """Return what the renderer needs as arrays by name, and everything that is no array as JSON under 'meta'."""
    arrays: dict[str, np.ndarray] = {}
    for i, globe in enumerate(globes):
        small = [o for o in globe.obstacles if o.shape is Shape.BOX and max(o.size) <= _LARGE * globe.radius]
        large = [o for o in globe.obstacles if not any(o is other for other in small)]
        cloud = np.empty((0, 3)) if globe.cloud is None else globe.cloud
        arrays |= {f"{i}/boxes": corners(small), f"{i}/relief": _relief(large, globe.radius), f"{i}/cloud": cloud}
        arrays |= {f"{i}/start": np.asarray(globe.start, float), f"{i}/goal": np.asarray(globe.goal, float)}
        for k, path in enumerate(globe.paths.values()):
            path = np.asarray(path, float)
            new = np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)
            arrays[f"{i}/path/{k}"] = path[new]  # a tube through a point twice has no direction there
    meta = {
        "pixels": _PIXELS, "half": HALF, "look": LOOK, "radii": [g.radius for g in globes],
        "colors": [[color(m, list(g.paths)) for m in g.paths] for g in globes],
        "cloud_colors": [g.cloud_color for g in globes],
        "panels": [
            {"globe": i, "direction": v.direction.tolist(), "up": v.up.tolist(), "right": v.right.tolist()}
            for i, looks in enumerate(cameras) for v in looks
        ],
    }  # fmt: skip
    return arrays | {"meta": np.array(json.dumps(meta))}


def _relief(obstacles: Sequence[Obstacle], radius: float) -> np.ndarray:
    """Return a grid over the sphere (rows, columns, 3) [m], raised inside obstacles, sunk elsewhere; empty if none."""
    if not obstacles:
        return np.empty((0, 0, 3))
    polar, azimuth = np.linspace(0, np.pi, _RELIEF[0]), np.linspace(-np.pi, np.pi, _RELIEF[1])
    p, a = np.meshgrid(polar, azimuth, indexing="ij")
    units = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)
    inside = covered(radius * units.reshape(-1, 3), obstacles).reshape(p.shape)
    return units * (radius * np.where(inside, 1.015, 0.99))[..., None]


def _name_ends(axes: Axes, globe: Globe, view: View) -> None:
    """Write 'start' and 'goal' beside the balls of a panel."""
    axes.set_aspect("equal")
    for name, point in (("start", globe.start), ("goal", globe.goal)):
        x, y, depth = view.project(np.asarray(point, float))
        if depth >= 0:
            left = x > 0.6 * globe.radius  # keep the word inside the panel
            axes.annotate(
                name, (x, y), xytext=(-7 if left else 7, 5), textcoords="offset points", ha="right" if left else "left",
                fontsize=8, zorder=6, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1},
            )  # fmt: skip


def _legend(globes: Sequence[Globe]) -> list[Line2D]:
    methods = list(dict.fromkeys(m for globe in globes for m in globe.paths))
    handles = [Line2D([], [], color=color(m, methods), linewidth=3, label=m) for m in methods]
    dot: dict[str, Any] = {"marker": "o", "linestyle": "none"}
    handles += [Line2D([], [], color=LOOK[name], markersize=7, label=name, **dot) for name in ("start", "goal")]
    square = dot | {"marker": "s"}
    return [*handles, Line2D([], [], color=LOOK["obstacle"], markersize=7, label="obstacle", **square)]
