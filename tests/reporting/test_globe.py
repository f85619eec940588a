"""Geometry of the stills against closed forms and brute force."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError
from pipeline.reporting.globe import Globe, corners, covered, look_at, views
from pipeline.robots import Obstacle, Shape
from tests.reporting.synthetic import arc, block_scene, unit

X, Y, Z = np.eye(3)


def test_the_camera_looks_at_the_mean_of_the_path():
    """Over a quarter circle the camera stands over its middle, with right-handed unit axes and north up."""
    view = look_at(arc(X, Y))
    assert view.direction == pytest.approx((X + Y) / np.sqrt(2))
    axes = np.array([view.right, view.up, view.direction])
    assert axes @ axes.T == pytest.approx(np.eye(3)) and np.linalg.det(axes) == pytest.approx(1)
    assert view.up @ Z > 0.99
    assert view.project(view.direction) == pytest.approx(Z)


@pytest.mark.parametrize("points", [np.array([Z, Z]), np.array([X, -X]), np.array([Z, X, -Z])])
def test_cameras_exist_over_poles_and_where_directions_cancel(points):
    """The axes stay finite and orthogonal."""
    view = look_at(points)
    axes = np.array([view.right, view.up, view.direction])
    assert axes @ axes.T == pytest.approx(np.eye(3))


def test_a_far_side_is_shown_only_where_a_path_is_hidden():
    """A short path needs one view; one that leads around the sphere two, which together show every state."""
    around = unit(np.column_stack([np.cos(a := np.linspace(0, 5, 60)), np.sin(a), 0.1 * np.ones(60)]))
    assert len(views(Globe([], X, Y, {"A": arc(X, Y)}))) == 1
    assert len(views(Globe([], X, Y, {"A": arc(X, Y)}), both_sides=True)) == 2
    near, far = views(Globe([], around[0], around[-1], {"A": around}))
    assert (np.maximum(near.project(around)[:, 2], far.project(around)[:, 2]) >= 0).all()


def test_covered_is_the_inequality_of_each_shape():
    """Random points against boxes, balls and cylinders, one by one in the obstacle's frame."""
    rng = np.random.default_rng(1)
    points, obstacles = rng.uniform(-1, 1, (400, 3)), []
    for shape in Shape:
        for _ in range(3):
            turn = Rotation.random(random_state=int(rng.integers(1000)))
            size = (0.8,) * 3 if shape is Shape.SPHERE else (0.7, 0.7, 1.0)
            obstacles.append(Obstacle(shape, tuple(rng.uniform(-0.5, 0.5, 3)), tuple(turn.as_quat()), size))

    def inside(point, o):
        x, y, z = Rotation.from_quat(o.quaternion).inv().apply(point - np.array(o.position))
        if o.shape is Shape.BOX:
            return abs(x) <= 0.35 and abs(y) <= 0.35 and abs(z) <= 0.5
        return x * x + y * y + z * z <= 0.16 if o.shape is Shape.SPHERE else x * x + y * y <= 0.35**2 and abs(z) <= 0.5

    for o in obstacles:
        assert covered(points, [o]).tolist() == [inside(p, o) for p in points]
    assert covered(points, obstacles).tolist() == [any(inside(p, o) for o in obstacles) for p in points]
    assert covered(np.empty((0, 3)), obstacles).size == 0


def test_corners_are_half_a_diagonal_from_the_centre():
    """Eight corners per box, all at the same distance, with the box's centre as their mean."""
    boxes = block_scene(5)
    found = corners(boxes)
    assert found.shape == (5, 8, 3) and corners([]).shape == (0, 8, 3)
    for box, points in zip(boxes, found, strict=True):
        assert points.mean(axis=0) == pytest.approx(np.array(box.position))
        assert np.linalg.norm(points - box.position, axis=1) == pytest.approx(np.full(8, 0.05 * np.sqrt(3)))


def test_points_of_another_space_are_refused():
    """A picture of the sphere needs three coordinates, all finite."""
    with pytest.raises(ProblemError, match=r"path of A has shape \(4, 7\)"):
        Globe([], X, Y, {"A": np.zeros((4, 7))})
    with pytest.raises(ProblemError, match="goal"):
        Globe([], X, np.array([np.nan, 0, 1]))
