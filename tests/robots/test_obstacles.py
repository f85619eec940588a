"""Obstacles survive tables unchanged; rows that describe none are refused."""

import numpy as np
import pandas as pd
import pytest

from pipeline.errors import ProblemError
from pipeline.files import read_table, write_table
from pipeline.robots import PRIMITIVES, Obstacle, Shape, Validity, obstacles_from_frame, obstacles_to_frame
from pipeline.robots.obstacles import COLUMNS
from tests.robots.worlds import ball, random_obstacles, rotation

OBSTACLES = random_obstacles(np.random.default_rng(0), 6)


def test_round_trip_through_a_file(tmp_path):
    """Obstacles written to parquet and read back are equal to the last bit, in order; none stay none."""
    for obstacles in (OBSTACLES, []):
        write_table(obstacles_to_frame(obstacles), tmp_path / "scene.parquet", "scene")
        frame = read_table(tmp_path / "scene.parquet", "scene")
        assert tuple(frame.columns) == COLUMNS
        assert obstacles_from_frame(frame) == tuple(obstacles)


def test_rotation_is_the_quaternions():
    """An obstacle's rotation matrix is that of its quaternion (x, y, z, w), whatever the quaternion's length."""
    for obstacle in OBSTACLES:
        np.testing.assert_allclose(obstacle.rotation, rotation(obstacle.quaternion), atol=1e-12)


def corrupted(**values) -> pd.DataFrame:
    frame = obstacles_to_frame(OBSTACLES)
    for column, value in values.items():
        frame.loc[2, column] = value
    return frame


@pytest.mark.parametrize(
    "values, message",
    [
        ({"shape": "cone"}, r"unknown obstacle shape 'cone'; known: \['box', 'sphere', 'cylinder'\]"),
        ({"x": np.nan}, "not finite"),
        ({"qw": np.inf}, "not finite"),
        ({"size_z": np.nan}, "not finite"),
        ({"size_y": 0.0}, "size 0.0 m"),
        ({"size_x": -0.25}, "size -0.25 m"),
        ({"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 0.0}, "quaternion"),
    ],
)
def test_bad_rows_are_refused(values, message):
    """One row with an unknown shape, a value that is not finite, an empty size or no rotation refuses the scene."""
    with pytest.raises(ProblemError, match=message):
        obstacles_from_frame(corrupted(**values))


@pytest.mark.parametrize("shape", [*PRIMITIVES, Shape.OCTREE])
@pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
def test_impossible_sizes_and_poses_have_no_geometry(shape, value):
    """A size that is not above 0 m or a pose that is not finite is refused with name and value."""
    points = np.zeros((1, 3))
    sized = Obstacle(shape, (0, 0, 0), (0, 0, 0, 1), (0.1, 0.1, value), name="cup", points=points)
    with pytest.raises(ProblemError, match=rf"{shape.value} 'cup' has size .*{value}.*; sizes must be above 0 m"):
        Validity(ball(), [sized])
    if not np.isfinite(value):
        placed = Obstacle(shape, (0, value, 0), (0, 0, 0, 1), (0.1, 0.1, 0.1), name="cup", points=points)
        with pytest.raises(ProblemError, match=rf"{shape.value} 'cup' is at .*{value}.*: not finite"):
            Validity(ball(), [placed])
