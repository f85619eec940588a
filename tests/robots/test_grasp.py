"""What is carried has its mass where it is, by pinocchio and by hand."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import balanced
from pipeline.errors import RobotError
from pipeline.robots import Obstacle, Shape, attach
from tests.robots import meshes
from tests.robots.named import configurations, named
from tests.robots.worlds import rotation

TURNED = (0.1, -0.5, 0.2, 0.8)


@pytest.mark.parametrize(
    "name, frame", [("panda", "panda_hand_tcp"), ("pholus", "ball2"), ("baxter_right", "right_gripper")]
)
@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_centre_of_mass_with_a_load(name, frame, kind, tmp_path):
    """The symbolic centre of mass is pinocchio's, and the robot's own and the load's at its place, weighted by hand."""
    robot, place, mass = named(name), np.array([0.1, -0.2, 0.3]), 4.5
    load = Obstacle(Shape.BOX, tuple(place), TURNED, (0.2, 0.3, 0.4), "load")
    middle = np.zeros(3)
    if kind == "mesh":
        file = meshes.write(tmp_path / "corner.obj", meshes.corner())
        load, middle = replace(load, shape=Shape.MESH, file=file), np.array([-0.2, -0.3, 0.0]) / 12
    loaded = attach(robot, load, frame, mass=mass)
    q = ca.SX.sym("q", robot.dimension)
    symbolic = ca.Function("c", [q], [loaded.symbolic_centre_of_mass(q)])
    data, own = loaded.model.createData(), robot.model.createData()
    total = sum(inertia.mass for inertia in list(robot.model.inertias)[1:])
    for value in configurations(robot, np.random.default_rng(0), 5):
        found = np.array(symbolic(value)).ravel()
        np.testing.assert_allclose(found, pin.centerOfMass(loaded.model, data, value), atol=1e-9)
        there = robot.pose(value, frame).act(place + rotation(TURNED) @ middle)
        by_hand = (total * pin.centerOfMass(robot.model, own, value) + mass * there) / (total + mass)
        np.testing.assert_allclose(found, by_hand, atol=1e-9)
        np.testing.assert_allclose(
            pin.centerOfMass(robot.model, own, value), pin.centerOfMass(named(name).model, own, value)
        )


def test_a_load_tips_the_balance():
    """A robot in balance is not with a load in its hand, and the load's weight decides."""
    robot = named("pholus")
    feet = [robot.pose(robot.rest, f"contact_{i}").translation for i in range(1, 5)]
    load = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.1,) * 3, "load")
    hand = robot.pose(robot.rest, robot.tool).translation
    held = [balanced(attach(robot, load, robot.tool, mass=mass), feet).holds(robot.rest) for mass in (0.0, 1.0, 5000.0)]
    low, high = np.min(feet, axis=0), np.max(feet, axis=0)
    outside = not ((low < hand) & (hand < high))[:2].all()
    assert held == [True, True, not outside] and outside


@pytest.mark.parametrize("mass", [-1.0, np.nan, np.inf])
def test_masses_that_are_none(mass):
    """A mass that is negative or not finite is refused with its value."""
    load = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.1,) * 3, "load")
    with pytest.raises(RobotError, match=f"the mass of 'load' is {mass} kg"):
        attach(named("panda"), load, "panda_hand_tcp", mass=mass)


def test_the_robot_is_left_as_it_is():
    """Attaching changes neither model nor geometry of the robot it is given, and what may touch is added up."""
    robot = named("panda")
    before = robot.model.inertias[7].mass, len(robot.geometry.geometryObjects), dict(robot.touching)
    load = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.1,) * 3, "load")
    one = attach(robot, load, "panda_hand_tcp", ["panda_link2_0"], mass=2.0)
    two = attach(one, replace(load, name="other"), "panda_link4", {"load": 0.003})
    assert (robot.model.inertias[7].mass, len(robot.geometry.geometryObjects), dict(robot.touching)) == before
    assert two.model.inertias[7].mass == pytest.approx(before[0] + 2.0)
    assert two.touching == {("load", "panda_link2_0"): None, ("other", "load"): 0.003}
