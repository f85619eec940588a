"""Render the panels of a still with VTK. A script of its own: VTK may abort the process it runs in.

Run by `stills.py` as `python stills_vtk.py scene.npz images.npz`; it imports nothing of this package, to start fast.
"""

import json
import sys
from typing import Any

import numpy as np
import pyvista as pv

# Faces of a box whose corners are numbered x slowest, z fastest.
_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def render(arrays: dict[str, np.ndarray], meta: dict[str, Any]) -> np.ndarray:
    """Return one image per panel (K, pixels, pixels, 3)."""
    return np.stack([_panel(arrays, meta, panel) for panel in meta["panels"]])


def _panel(arrays: dict[str, np.ndarray], meta: dict[str, Any], panel: dict[str, Any]) -> np.ndarray:
    globe, look = panel["globe"], meta["look"]
    radius = meta["radii"][globe]
    # Any: mypy reads pyvista's deprecation wrappers as functions without self.
    plotter: Any = pv.Plotter(off_screen=True, window_size=[meta["pixels"]] * 2, lighting="none")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    matt: dict[str, Any] = {"ambient": 0.45, "diffuse": 0.6, "specular": 0.0}
    ball = pv.Sphere(radius=radius, theta_resolution=180, phi_resolution=180)
    plotter.add_mesh(ball, color=look["sphere"], smooth_shading=True, **matt)
    boxes = arrays[f"{globe}/boxes"]
    if len(boxes):
        plotter.add_mesh(_boxes(boxes), color=look["obstacle"], **matt)
    relief = arrays[f"{globe}/relief"]
    if relief.size:
        grid = pv.StructuredGrid(*(np.ascontiguousarray(relief[..., k])[..., None] for k in range(3)))
        plotter.add_mesh(grid.extract_surface(algorithm=None), color=look["obstacle"], **matt)
    for k, color in enumerate(meta["colors"][globe]):
        path = arrays[f"{globe}/path/{k}"]
        if len(path) > 1:
            plotter.add_mesh(pv.lines_from_points(path).tube(radius=look["tube"] * radius), color=color, **matt)
    cloud = arrays[f"{globe}/cloud"]
    if len(cloud):
        dot = pv.Sphere(radius=look["dot"] * radius, theta_resolution=10, phi_resolution=10)
        dots = pv.PolyData(cloud).glyph(geom=dot, scale=False, orient=False)
        plotter.add_mesh(dots, color=meta["cloud_colors"][globe], **matt)
    for name in ("start", "goal"):
        marker = pv.Sphere(radius=look["ball"] * radius, center=arrays[f"{globe}/{name}"])
        plotter.add_mesh(marker, color=look[name], **matt)
    _camera(plotter, panel, meta["half"] * radius)
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(image)[..., :3]


def _boxes(boxes: np.ndarray) -> pv.PolyData:
    faces = (_FACES[None] + 8 * np.arange(len(boxes))[:, None, None]).reshape(-1, 4)
    return pv.PolyData(boxes.reshape(-1, 3), np.column_stack([np.full(len(faces), 4), faces]).ravel())


def _camera(plotter: Any, panel: dict[str, Any], half: float) -> None:
    direction, up, right = (np.array(panel[name]) for name in ("direction", "up", "right"))
    plotter.enable_parallel_projection()
    plotter.camera.position = 5 * half * direction
    plotter.camera.focal_point = (0, 0, 0)
    plotter.camera.up = up
    plotter.camera.parallel_scale = half
    # From over the left shoulder, so that the sides of the obstacles differ in brightness.
    plotter.add_light(pv.Light(position=5 * half * (direction + 0.5 * up - 0.5 * right), light_type="scene light"))
    plotter.reset_camera_clipping_range()


if __name__ == "__main__":
    with np.load(sys.argv[1], allow_pickle=False) as stored:
        given = {name: stored[name] for name in stored.files}
    np.savez(sys.argv[2], images=render(given, json.loads(str(given["meta"]))))
