"""A picture of a robot's path among obstacles, from the side and from above."""

import json
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from pipeline.reporting.renderer import plain_wanted, render
from pipeline.reporting.style import new_figure, save, style
from pipeline.robots import Obstacle, Robot
from pipeline.robots.surfaces import triangles

_START, _GOAL, _BETWEEN, _OBSTACLE, _PATH = "#0072B2", "#D55E00", "#BBBBBB", "#8A8F98", "#009E73"  # Okabe and Ito
_HELD_START, _HELD_GOAL = "#56B4E9", "#E69F00"  # the paler ones of the same hues
_OBSTACLES = ("#8A8F98", "#A3A8B0", "#73777F", "#B9BDC4")  # in turns: seen from above, equal greys would merge
_BETWEENS = 4  # configurations drawn pale between start and goal
_AROUND = 0.4  # how much of what stands around is shown, in sizes of what the robot passes through
_PIXELS = (900, 800)
_FRAME = 10  # background left around what is shown [pixels]
_SIDES = tuple((x, y, 0.45) for x in (0.55, -0.55) for y in (-0.7, 0.7))  # of these the one that shows most
_ABOVE: dict[str, Any] = {"name": "from above", "direction": (0, 0, 1), "up": (1, 0, 0)}
_AWAY = 20.0  # where the camera is, for what hides the robot [m]
_SEEN = 60  # points of the robot that are to be seen

_Mesh = tuple[np.ndarray, np.ndarray, str, float]  # vertices, faces, colour, opacity


def draw_path(
    robot: Robot,
    obstacles: tuple[Obstacle, ...],
    path: np.ndarray,
    file: Path,
    title: str = "",
    held: Collection[str] = (),
    plain: bool = False,
) -> str:
    """Draw start, goal and what is between, the tool's way and the obstacles; return 'VTK' or 'matplotlib'.

    Args:
        robot: with the bodies to draw.
        obstacles: of the scene.
        path: configurations (T, n), T >= 1.
        file: the PNG to write.
        title: over the picture.
        held: names of bodies that the robot carries, which have colours of their own.
        plain: draws flat even where VTK could; see also `plain_wanted`.
    """
    still, meshes = _static(robot, path[0]), []
    for share in np.linspace(0, 1, _BETWEENS + 2)[1:-1]:
        meshes += _moving(robot, path[round(share * (len(path) - 1))], (_BETWEEN, _BETWEEN), 0.25, held)
    meshes += _moving(robot, path[0], (_START, _HELD_START), 1.0, held)
    meshes += _moving(robot, path[-1], (_GOAL, _HELD_GOAL), 1.0, held)
    placed = [
        _placed(o.geometry(), pin.SE3(o.rotation, np.array(o.position)), _OBSTACLES[k % len(_OBSTACLES)], 1.0)
        for k, o in enumerate(obstacles)
    ]
    way = np.array([robot.pose(q, robot.tool).translation for q in path])
    everything = [*still, *placed, *meshes]
    low, high = _extent([*still, *meshes], placed, way)
    points = np.concatenate([way, *(vertices for vertices, *_ in meshes)])
    side = clearest(_SIDES, points[:: max(len(points) // _SEEN, 1)], obstacles)
    views = ({"name": "from the side", "direction": side, "up": (0, 0, 1)}, _ABOVE)
    arrays = {"meta": np.array(json.dumps(_meta(everything, low, high, views)))}
    for k, (vertices, faces, _, _) in enumerate(everything):
        arrays[f"vertices/{k}"], arrays[f"faces/{k}"] = vertices, faces
    arrays |= {"line/0": way, "ball/0": way[0], "ball/1": way[-1]}
    command = (sys.executable, "-P", str(Path(__file__).with_name("scene_vtk.py")))
    images = None if plain or plain_wanted() else render(command, arrays, len(views))
    with style():
        figure = new_figure(10, 5.2)
        figure.suptitle(title, fontsize=10)
        for k, view in enumerate(views):
            axes: Any = figure.add_subplot(1, 2, k + 1, **({} if images is not None else {"projection": "3d"}))
            axes.set_title(view["name"], fontsize=9)
            axes.set_axis_off()
            if images is not None:
                axes.imshow(cropped(images[k]))
            else:
                _flat(axes, everything, way, view, low, high)
        looks = {"start": _START, "goal": _GOAL}
        looks |= {"held, at the start": _HELD_START, "held, at the goal": _HELD_GOAL} if held else {}
        looks |= {"between": _BETWEEN, "obstacles": _OBSTACLE, "tool's way": _PATH}
        handles = [Patch(color=color, label=name) for name, color in looks.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
        save(figure, file)
    return "matplotlib" if images is None else "VTK"


def cropped(image: np.ndarray) -> np.ndarray:
    """Return the part of an image (h, w, 3 or 4) that shows something, with a little of the background around it."""
    rows, columns = np.nonzero((image[..., :3] != image[0, 0, :3]).any(axis=2))
    if not len(rows):
        return image
    box = [slice(max(int(at.min()) - _FRAME, 0), int(at.max()) + _FRAME + 1) for at in (rows, columns)]
    return image[box[0], box[1]]


def clearest(
    directions: Sequence[tuple[float, float, float]], points: np.ndarray, obstacles: Sequence[Obstacle]
) -> tuple[float, float, float]:
    """Return the first direction from which, far away, the fewest points (m, 3) [m] are hidden by obstacles."""
    ray, request = coal.Cylinder(1e-3, _AWAY), coal.CollisionRequest()
    placed = [obstacle.collision_object() for obstacle in obstacles]

    def hidden(direction: tuple[float, float, float]) -> int:
        towards = np.array(direction) / np.linalg.norm(direction)
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), towards).matrix()
        rays = (coal.CollisionObject(ray, turn, point + _AWAY / 2 * towards) for point in points)
        return sum(any(coal.collide(r, o, request, coal.CollisionResult()) for o in placed) for r in rays)

    return min(directions, key=hidden)


def _meta(meshes: list[_Mesh], low: np.ndarray, high: np.ndarray, views: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {
        "meshes": [{"color": color, "opacity": opacity} for *_, color, opacity in meshes],
        "lines": [{"color": _PATH, "radius": 0.006}],
        "balls": [{"color": color, "radius": 0.015} for color in (_START, _GOAL)],
        "views": views,
        "size": _PIXELS,
        "centre": ((low + high) / 2).tolist(),
        "half": float(0.55 * np.linalg.norm(high - low)),
    }


def _placed(geometry: Any, pose: pin.SE3, color: str, opacity: float) -> _Mesh:
    vertices, faces = triangles(geometry)
    return vertices @ pose.rotation.T + pose.translation, faces, color, opacity


def _bodies(robot: Robot, q: np.ndarray, colors: Mapping[str, str], opacity: float) -> list[_Mesh]:
    """Return the bodies that have a colour."""
    data, placed = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, np.asarray(q, float))
    return [
        _placed(body.geometry, pose, colors[body.name], opacity)
        for body, pose in zip(robot.geometry.geometryObjects, placed.oMg, strict=True)
        if body.name in colors
    ]


def _moving(robot: Robot, q: np.ndarray, colors: tuple[str, str], opacity: float, held: Collection[str]) -> list[_Mesh]:
    """Return the robot's own bodies that move in the first colour, and what it holds in the second."""
    names = [body.name for body in robot.geometry.geometryObjects if body.parentJoint]
    return _bodies(robot, q, {name: colors[name in held] for name in names}, opacity)


def _static(robot: Robot, q: np.ndarray) -> list[_Mesh]:
    names = [body.name for body in robot.geometry.geometryObjects if not body.parentJoint]
    return _bodies(robot, q, dict.fromkeys(names, "#DDDDDD"), 1.0)


def _extent(meshes: list[_Mesh], around: list[_Mesh], way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (3,) of what is shown: the robot on its way, and what stands near it."""
    points = np.concatenate([*(vertices for vertices, *_ in meshes), way])
    low, high = points.min(axis=0), points.max(axis=0)
    least, most = low - _AROUND * (high - low).max(), high + _AROUND * (high - low).max()
    boxes = [(v.min(axis=0), v.max(axis=0)) for v, *_ in around if len(v)]
    corners = [np.clip(box, least, most) for box in boxes if (box[0] < most).all() and (box[1] > least).all()]
    shown = np.concatenate([[low, high], *corners])
    return shown.min(axis=0), shown.max(axis=0)


def _flat(
    axes: Any, meshes: list[_Mesh], way: np.ndarray, view: dict[str, Any], low: np.ndarray, high: np.ndarray
) -> None:
    for vertices, faces, color, opacity in meshes:
        if len(faces):
            axes.add_collection3d(
                Poly3DCollection(vertices[faces], facecolor=color, alpha=0.5 * opacity, edgecolor="none")
            )
    axes.plot(*way.T, color=_PATH, linewidth=2)
    x, y, z = view["direction"]
    axes.view_init(elev=np.degrees(np.arctan2(z, np.hypot(x, y))), azim=np.degrees(np.arctan2(y, x)) if x or y else 180)
    middle, half = (low + high) / 2, (high - low).max() / 2
    axes.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half], zlim=middle[2] + [-half, half])
    axes.set_box_aspect((1, 1, 1))
