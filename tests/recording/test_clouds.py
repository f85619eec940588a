import coal
import numpy as np
import pytest

from pipeline.recording.clouds import spread
from pipeline.robots.surfaces import triangles

BOX = np.array([1.0, 0.5, 0.1])


@pytest.mark.parametrize("turn", [0, 5])
def test_points_are_spread_by_area(turn):
    """Each face of a box has its share of the points, all over it, in whichever order its triangles come."""
    vertices, faces = triangles(coal.Box(*BOX))
    points = spread(vertices, np.roll(faces, turn, axis=0), 600)
    on = np.abs(np.abs(points) - BOX / 2) < 1e-12  # (600, 3): on a face across x, y or z
    assert on.any(axis=1).all()
    areas = np.array([BOX[1] * BOX[2], BOX[0] * BOX[2], BOX[0] * BOX[1]])
    for axis, area in enumerate(areas):
        for side in (-1, 1):
            there = points[on[:, axis] & (points[:, axis] * side > 0)]
            assert abs(len(there) / 600 - area / (2 * areas.sum())) < 0.01
    top = np.delete(points[on[:, 2] & (points[:, 2] > 0)], 2, axis=1)
    cells = np.histogram2d(*top.T, bins=5, range=[(-0.5, 0.5), (-0.25, 0.25)])[0]
    assert cells.min() > 0.5 * cells.mean() and cells.max() < 1.6 * cells.mean()


def test_points_are_the_same_at_every_call():
    """Nothing is left to chance."""
    vertices, faces = triangles(coal.Capsule(0.1, 0.4))
    np.testing.assert_array_equal(spread(vertices, faces, 300), spread(vertices, faces, 300))


def test_triangles_without_area_get_no_points():
    """A face that is a line has no points, a shape of such faces or of none has none at all."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    points = spread(vertices, np.array([[3, 3, 0], [0, 1, 2], [1, 3, 3]]), 50)
    assert len(points) == 50 and (points[:, 2] == 0).all() and (points.sum(axis=1) <= 1 + 1e-12).all()
    assert spread(vertices, np.array([[3, 3, 0]]), 50).shape == (0, 3)
    assert spread(np.empty((0, 3)), np.empty((0, 3), int), 50).shape == (0, 3)
