"""Without bounds a voxel grid is the space that the robot reaches."""

import numpy as np
import pytest

from pipeline.errors import ConfigError
from pipeline.perception import Perception, VoxelParameters
from pipeline.perception.reach import reached
from pipeline.robots import UrdfRobot
from pipeline.spec.statement import Point

POLE = """<robot name="pole"><link name="base"/><link name="pole"/><link name="tip"/>
<joint name="turn" type="revolute"><origin xyz="0.5 0 0"/><parent link="base"/><child link="pole"/><axis xyz="0 0 1"/>
<limit lower="-3.1416" upper="3.1416" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><origin xyz="1 0 0.2"/><parent link="pole"/><child link="tip"/></joint></robot>"""


def test_a_pole_reaches_a_circle(tmp_path):
    """A tip 1 m from a joint that turns about z reaches 1 m to all sides of it, from the joint's height to its own."""
    (tmp_path / "pole.urdf").write_text(POLE)
    pole = UrdfRobot(str(tmp_path / "pole.urdf"), ("turn",), "tip", "pole")
    expected = [[-0.5, -1.0, 0.0], [1.5, 1.0, 0.2]]
    np.testing.assert_allclose(reached(pole), expected, atol=1e-3)
    assert reached(pole).tobytes() == reached(pole).tobytes()
    free = Perception(0, VoxelParameters(lower=None, upper=None))
    np.testing.assert_allclose(free.of(pole).bounds, expected, atol=1e-3)


def test_given_bounds_stay():
    """Bounds that a file gives stay what they are; a point reaches its limits; without a robot there are no bounds."""
    point = Point(0.001, (-1.0, -2.0, -3.0), (1.0, 2.0, 3.0))
    assert Perception(0, VoxelParameters()).of(point) == VoxelParameters()
    without = VoxelParameters(lower=None, upper=None)
    assert Perception(0, without).of(point).bounds.tolist() == [[-1, -2, -3], [1, 2, 3]]
    with pytest.raises(ConfigError, match="voxel bounds are empty"):
        without.bounds  # noqa: B018 (the property raises)
    with pytest.raises(ConfigError, match="or both none"):
        VoxelParameters(lower=None)
