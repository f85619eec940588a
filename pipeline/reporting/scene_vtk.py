"""Render a robot, obstacles and lines with VTK. A script of its own: VTK may abort the process it runs in.

Run as `python scene_vtk.py scene.npz images.npz`; it imports nothing of this package, to start fast.
"""

import json
import sys
from typing import Any

import numpy as np
import pyvista as pv


def render(arrays: dict[str, np.ndarray], meta: dict[str, Any]) -> np.ndarray:
    """Return one image per view (K, height, width, 3)."""
    return np.stack([_view(arrays, meta, view) for view in meta["views"]])


def _view(arrays: dict[str, np.ndarray], meta: dict[str, Any], view: dict[str, Any]) -> np.ndarray:
    # Any: mypy reads pyvista's deprecation wrappers as functions without self.
    plotter: Any = pv.Plotter(off_screen=True, window_size=meta["size"], lighting="none")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    matt: dict[str, Any] = {"ambient": 0.4, "diffuse": 0.65, "specular": 0.0}
    for k, look in enumerate(meta["meshes"]):
        vertices, faces = arrays[f"vertices/{k}"], arrays[f"faces/{k}"]
        mesh = pv.PolyData(vertices, np.column_stack([np.full(len(faces), 3), faces]).ravel())
        plotter.add_mesh(mesh, color=look["color"], opacity=look["opacity"], **matt)
    for k, look in enumerate(meta["lines"]):
        line = arrays[f"line/{k}"]
        if len(line) > 1 and np.ptp(line, axis=0).max() > 0:
            plotter.add_mesh(pv.lines_from_points(line).tube(radius=look["radius"]), color=look["color"], **matt)
    for k, look in enumerate(meta["balls"]):
        plotter.add_mesh(pv.Sphere(radius=look["radius"], center=arrays[f"ball/{k}"]), color=look["color"], **matt)
    centre, direction = np.array(meta["centre"]), np.array(view["direction"])
    plotter.enable_parallel_projection()
    plotter.camera.position = centre + 5 * meta["half"] * direction
    plotter.camera.focal_point = centre
    plotter.camera.up = view["up"]
    plotter.camera.parallel_scale = meta["half"]
    side = np.cross(direction, view["up"])
    plotter.add_light(pv.Light(position=centre + 5 * (direction + 0.6 * np.array([0, 0, 1]) - 0.5 * side)))
    plotter.reset_camera_clipping_range()
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(image)[..., :3]


if __name__ == "__main__":
    with np.load(sys.argv[1], allow_pickle=False) as stored:
        given = {name: stored[name] for name in stored.files}
    np.savez(sys.argv[2], images=render(given, json.loads(str(given["meta"]))))
