"""Draw the panels of a still with matplotlib alone: the surface of the sphere, orthographic."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patheffects import Normal, Stroke

from pipeline.reporting.globe import Globe, View, covered
from pipeline.reporting.style import color

_PIXELS = 600  # across the sphere


def surface(globe: Globe, view: View, half: float, sphere: str, obstacle: str) -> np.ndarray:
    """Return an image of the near side (pixels, pixels, 4) with the parts inside obstacles in their colour.

    Args:
        globe: what to show.
        view: the camera.
        half: of the picture's width, in radii.
        sphere: colour of the free surface.
        obstacle: colour of the surface inside obstacles.
    """
    axis = np.linspace(-half, half, _PIXELS)
    x, y = np.meshgrid(axis, axis)
    on = x**2 + y**2 <= 1
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    normals = np.column_stack([x[on], y[on], z[on]])  # (K, 3) in the axes of the picture
    world = normals @ np.vstack([view.right, view.up, view.direction])
    inside = covered(globe.radius * world, globe.obstacles)
    light = np.array([-0.4, 0.4, 0.82])
    shade = 0.6 + 0.4 * np.clip(normals @ light, 0, 1)
    image = np.zeros((_PIXELS, _PIXELS, 4))
    colors = np.where(inside[:, None], to_rgb(obstacle), to_rgb(sphere)) * shade[:, None]
    image[on] = np.column_stack([colors, np.ones(len(colors))])
    return image


def draw(axes: Axes, globe: Globe, view: View, look: dict[str, str], half: float) -> None:
    """Draw one panel; what is behind the sphere is left out."""
    r = globe.radius
    extent = (-half * r, half * r, -half * r, half * r)
    image = surface(globe, view, half, look["sphere"], look["obstacle"])
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear")
    if globe.cloud is not None and len(globe.cloud):
        seen = view.project(globe.cloud)
        seen = seen[seen[:, 2] > 0]
        axes.scatter(seen[:, 0], seen[:, 1], s=7, color=globe.cloud_color, linewidths=0, zorder=3)
    methods = list(globe.paths)
    for method in reversed(methods):  # the first method of the legend on top
        path = view.project(np.asarray(globe.paths[method], float))
        path[path[:, 2] < 0] = np.nan  # a gap in the line; the view of the other side shows this part
        (line,) = axes.plot(path[:, 0], path[:, 1], color=color(method, methods), linewidth=2.4, zorder=4)
        line.set_path_effects([Stroke(linewidth=3.4, foreground="black", alpha=0.6), Normal()])
    for name, point in (("start", globe.start), ("goal", globe.goal)):
        x, y, depth = view.project(np.asarray(point, float))
        if depth >= 0:
            axes.plot(x, y, "o", color=look[name], markeredgecolor="white", markersize=8, zorder=5)
