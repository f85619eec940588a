"""Variables in the order of a list: the same robot, by its kinematics, limits, lever arms and verdicts."""

from dataclasses import replace
from itertools import permutations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml

from pipeline.manifolds.displacement import Displacement
from pipeline.robots import ROBOTS, Obstacle, Shape, Validity, attach
from pipeline.robots.bending import centre_of_mass_bend
from pipeline.robots.virtual import VirtualJoint, with_virtual_chain
from pipeline.schema import Choice
from tests.robots.named import FOLDER, configurations, named
from tests.robots.test_urdf import FRAMES, tiny


@pytest.mark.parametrize("name", ["panda", "baxter_both", "olivia"])
def test_joints_are_in_the_order_they_are_listed(name):
    """A group listed in another order has the same robot with its variables in that order, everywhere."""
    settings = Choice(**yaml.safe_load((FOLDER / f"{name}.yaml").read_text())).make(ROBOTS, "robot")
    robot, rng = named(name), np.random.default_rng(14)
    order = rng.permutation(robot.dimension)
    other = replace(settings, joints=tuple(np.array(robot.joint_names)[order])).robot()
    assert other.joint_names == tuple(robot.joint_names[i] for i in order)
    for attribute in ("lower", "upper", "rest", "velocity"):
        np.testing.assert_array_equal(getattr(other, attribute), getattr(robot, attribute)[order])
    np.testing.assert_allclose(other.lever_arms[0], robot.lever_arms[0][:, order])
    np.testing.assert_allclose(other.lever_arms[1], robot.lever_arms[1][:, order])
    places = rng.uniform(-1, 1, (400, 3))
    places = places[np.hypot(places[:, 0], places[:, 1]) > 0.8][:80]  # none in what stands at the origin
    balls = [Obstacle(Shape.SPHERE, tuple(p), (0, 0, 0, 1), (0.1,) * 3, f"ball {i}") for i, p in enumerate(places)]
    x, spoken = ca.SX.sym("x", robot.dimension), FRAMES[name][-1]
    place = ca.Function("place", [x], [other.symbolic_pose(x, spoken).position])
    held = [attach(with_virtual_chain(r, [VirtualJoint(3, pin.SE3.Identity(), -1.0, 1.0, "v")]), balls[0], r.tool)
            for r in (robot, other)]  # fmt: skip
    Q = configurations(robot, rng, 32)
    for count in (3, 80):  # in a list, and in a tree
        one, two = (Validity(r, balls[:count]) for r in (robot, other))
        assert [one.free(q) for q in Q] == [two.free(q[order]) for q in Q]
        np.testing.assert_array_equal(one.all_free(Q.reshape(16, 2, -1)), two.all_free(Q[:, order].reshape(16, 2, -1)))
    for q in Q[:5]:
        assert other.pose(q[order], spoken).isApprox(robot.pose(q, spoken), 1e-12)
        np.testing.assert_allclose(np.asarray(place(q[order]))[:, 0], robot.pose(q, spoken).translation, atol=1e-9)
        whole = [held[0].pose(np.append(q, 0.3), spoken), held[1].pose(np.append(q[order], 0.3), spoken)]
        assert whole[0].isApprox(whole[1], 1e-12)
    assert held[1].joint_names == (*other.joint_names, "v")


SLIDING = """<robot name="sliding"><link name="a"/>{links}
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
    <limit lower="-0.4" upper="0.7" velocity="1" effort="0"/></joint>
  <joint name="turn" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0.3 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
  <joint name="lift" type="prismatic"><parent link="c"/><child link="d"/><origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" velocity="1" effort="0"/></joint>
  <joint name="bow" type="revolute"><parent link="d"/><child link="e"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="0"/></joint></robot>"""
LINK = """<link name="{name}"><inertial><mass value="1"/><origin xyz="0.1 0 0.2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.1 0 0"/><geometry><box size="0.3 0.1 0.1"/></geometry></collision></link>"""


@pytest.mark.parametrize("order", list(permutations(range(4)))[::5])
def test_bounds_on_motion_heed_the_order(order, tmp_path):
    """How far bodies and the centre of mass move along a chord is the same in any order, sliding joints among them."""
    text = SLIDING.format(links="".join(LINK.format(name=name) for name in "bcde"))
    names, rng, order = ("slide", "turn", "lift", "bow"), np.random.default_rng(16), list(order)
    robot, other = (
        tiny(tmp_path, text, joints=tuple(names[i] for i in listed), tool="e").robot() for listed in (range(4), order)
    )
    Q = rng.uniform(robot.lower, robot.upper, (20, 4))
    np.testing.assert_allclose(Displacement(other).rates(Q[:, order]), Displacement(robot).rates(Q), rtol=1e-9)
    steps = np.diff(Q, axis=0)
    bends = centre_of_mass_bend(other)(steps[:, order]), centre_of_mass_bend(robot)(steps)
    np.testing.assert_allclose(*bends, rtol=1e-9)
    np.testing.assert_allclose(other.lever_arms[0], robot.lever_arms[0][:, order])
