"""Robots as the verifier reads them: joints, frames, bodies and masses are those of pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import TaskSpaceRegion, chain
from pipeline.errors import RobotError
from pipeline.robots import Geometry, Obstacle, Placement, Shape, UrdfRobot, attach
from pipeline.spec.statement import Carried, ChainSpec, Point, Region, Statement
from pipeline.verification.centre import centre_of_faces
from pipeline.verification.kinematics import WORLD, Kinematics
from pipeline.verification.reader import read, resting
from tests.robots.named import ROBOT_NAMES, configurations, named, settings

BRANCHES = """<robot name="branches"><link name="root"/>
  <link name="a"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.4 0 0"/><mass value="2"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="b"><collision><origin xyz="0 0 0.1" rpy="0 1 0"/>
    <geometry><box size="0.1 0.2 0.3"/></geometry></collision>
  </link>
  <link name="c"/><link name="d"/><link name="e"/><link name="f"/>
  <joint name="ab" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="1 2 3"/>
    <axis xyz="1 2 2"/><limit lower="0.2" upper="0.6" velocity="1" effort="1"/></joint>
  <joint name="ra" type="revolute"><parent link="root"/><child link="a"/><origin xyz="1 0 0" rpy="0.3 -0.2 0.1"/>
    <axis xyz="0 1 1"/><limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
  <joint name="bc" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 1 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0" velocity="1" effort="1"/><mimic joint="cd" multiplier="2" offset="0.1"/></joint>
  <joint name="cd" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0 0 1"/><axis xyz="1 0 0"/>
    <mimic joint="de" multiplier="-0.5"/></joint>
  <joint name="de" type="continuous"><parent link="d"/><child link="e"/><origin xyz="0.2 0 0"/></joint>
  <joint name="ef" type="fixed"><parent link="e"/><child link="f"/><origin xyz="0 0.3 0" rpy="0 0 1"/></joint>
</robot>"""


def check_frames(ours: Kinematics, model: pin.Model, Q: np.ndarray) -> None:
    """Every frame of pinocchio's model is where ours is, at the rows of Q (T, n), to 1e-12."""
    data = model.createData()
    R, p = ours.joint_poses(Q)
    for t, q in enumerate(Q):
        pin.framesForwardKinematics(model, data, q)
        for number, frame in enumerate(model.frames):
            rotation, position = ours.placed(R[t : t + 1], p[t : t + 1], *ours.frame(frame.name))
            assert np.abs(rotation[0] - data.oMf[number].rotation).max() < 1e-12, frame.name
            assert np.abs(position[0] - data.oMf[number].translation).max() < 1e-12, frame.name


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_frames_bodies_masses(name):
    """Frames, bodies, limits and the centre of mass of every named robot are those of pinocchio's model."""
    robot, ours = named(name), read(Statement(settings(name), (), 1e-3))
    assert ours.names == robot.joint_names
    assert np.array_equal(ours.lower, robot.lower) and np.array_equal(ours.upper, robot.upper)
    Q = configurations(robot, np.random.default_rng(0), 5)
    check_frames(ours, robot.model, Q)
    planned = {body.split(" (")[0] for body in robot.body_names}
    assert {body.name for body in ours.bodies} == planned
    assert {body.name for body in ours.bodies if body.base} == {name.split(" (")[0] for name in robot.base}
    if sum(inertia.mass for inertia in list(robot.model.inertias)[1:]) > 0:
        centres = [pin.centerOfMass(robot.model, robot.model.createData(), q) for q in Q]
        assert np.abs(ours.centre_of_mass(Q) - centres).max() < 1e-12


def test_shapes_are_where_pinocchio_has_them():
    """Boxes, cylinders and spheres of files have the poses that pinocchio's geometry has, and so have meshes."""
    for name in ("sawyer", "olivia", "ur5", "panda"):
        robot = replace(settings(name), geometry=Geometry.MESHES).robot()
        ours = read(Statement(settings(name), (), 1e-3))
        q = configurations(robot, np.random.default_rng(1), 1)
        R, p = ours.joint_poses(q)
        placements = pin.GeometryData(robot.geometry)
        pin.updateGeometryPlacements(robot.model, robot.model.createData(), robot.geometry, placements, q[0])
        there = {body.name: i for i, body in enumerate(robot.geometry.geometryObjects)}
        for body in ours.bodies:
            rotation, position = ours.placed(R, p, body.joint, body.placement)
            other = placements.oMg[there[body.name]]
            assert np.abs(rotation[0] - other.rotation).max() < 1e-12
            assert np.abs(position[0] - other.translation).max() < 1e-12
            shape = robot.geometry.geometryObjects[there[body.name]].geometry
            assert body.geometry.getNodeType() == shape.getNodeType()
            body.geometry.computeLocalAABB()
            shape.computeLocalAABB()
            assert np.abs(np.array(body.geometry.aabb_local.max_) - shape.aabb_local.max_).max() < 1e-9


def test_branches_followers_and_order(tmp_path):
    """A prismatic joint with an oblique axis, followers of followers in any order, and `joints` in another order."""
    path = tmp_path / "branches.urdf"
    path.write_text(BRANCHES)
    made = UrdfRobot(str(path), ("ab", "ra"), "f", "branches", fixed={"de": 0.8, "cd": -0.4}, rest={"ab": 0.3})
    ours, robot = read(Statement(made, (), 1e-3)), made.robot()
    assert ours.names == ("ab", "ra") and ours.turning.tolist() == [False, True]
    Q = configurations(robot, np.random.default_rng(2), 5)
    check_frames(ours, robot.model, Q)
    # Said otherwise: every joint that stands moves, at the value that the file puts it to.
    free = path.with_name("free.urdf")
    text = BRANCHES.replace('<mimic joint="cd" multiplier="2" offset="0.1"/>', "").replace('lower="0" upper="0"', "")
    text = text.replace(
        '<mimic joint="de" multiplier="-0.5"/>', '<limit lower="-9" upper="9" velocity="1" effort="1"/>'
    )
    text = text.replace('<axis xyz="0 0 1"/>\n    <limit ', '<axis xyz="0 0 1"/>\n    <limit lower="-9" upper="9" ')
    free.write_text(text)
    moving = read(Statement(replace(made, urdf=str(free), joints=("ra", "ab", "bc", "cd", "de"), fixed={}), (), 1e-3))
    stand = np.tile([-0.4 * 2 + 0.1, -0.4, 0.8], (5, 1))
    for one, other in zip(
        ours.frame_poses(Q, "f"), moving.frame_poses(np.hstack([Q[:, ::-1], stand]), "f"), strict=True
    ):
        assert np.abs(one - other).max() < 1e-12


def test_file_that_changed_is_read_anew(tmp_path):
    """A description that is written again counts as it is now."""
    path = tmp_path / "branches.urdf"
    path.write_text(BRANCHES)
    made = UrdfRobot(str(path), ("ra",), "f", "branches")
    before = read(Statement(made, (), 1e-3)).frame_poses(np.zeros((1, 1)), "a")[1]
    path.write_text(BRANCHES.replace('xyz="1 0 0" rpy="0.3', 'xyz="1.5 0 0" rpy="0.3'))
    assert np.allclose(read(Statement(made, (), 1e-3)).frame_poses(np.zeros((1, 1)), "a")[1] - before, [[0.5, 0, 0]])


def test_chain_and_carried_bodies():
    """A chain's variables, limits and frames, and what is carried with its mass, are those that planning has."""
    robot, place = named("panda"), Placement((0.6, 0.1, 0.4), (0.3, -0.4, 2.0))
    held, end = Placement((-0.06, -0.3, 0.0), (0.1, 0.2, 0.3)), Placement((0.0, 0.1, 0.0), (0.0, 1.5, 0.2))
    bounds = [
        ((0, -0.1, 0, 0.2, 0, -1.3), (0, 0.2, 0, 0.2, 0, 0.05)),
        ((0, 0, 0, -0.5, -0.4, -9), (0, 0, 0, 0.5, 0.4, 9)),
    ]
    planned = chain(
        robot, [TaskSpaceRegion(*b, p, e) for b, p, e in zip(bounds, (place, held), (held, end), strict=True)]
    )
    cup = Obstacle(Shape.CYLINDER, (0.0, 0.02, 0.1), (0.1, 0.2, 0.3, 0.9273618495495703), (0.06, 0.06, 0.2), "cup")
    lid = Obstacle(Shape.BOX, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.3, 0.3, 0.01), "lid")
    larger = attach(attach(planned.robot, cup, "panda_hand_tcp", mass=3.0), lid, "chain_1", mass=2.0)
    said = ChainSpec(
        tuple(Region(*b, p, e) for b, p, e in zip(bounds, (place, held), (held, end), strict=True)), "panda_hand_tcp"
    )
    carried = (Carried(cup, "panda_hand_tcp", 3.0), Carried(lid, "chain_1", 2.0))
    ours = read(Statement(settings("panda"), (), 1e-3, carried=carried, chain=said))
    assert ours.names == larger.joint_names
    assert np.array_equal(ours.lower, larger.lower) and np.array_equal(ours.upper, larger.upper)
    Q = configurations(larger, np.random.default_rng(3), 5)
    check_frames(ours, larger.model, Q)
    placements, data = pin.GeometryData(larger.geometry), larger.model.createData()
    pin.updateGeometryPlacements(larger.model, data, larger.geometry, placements, Q[0])
    R, p = ours.joint_poses(Q[:1])
    for body, pose in zip(ours.bodies[-2:], list(placements.oMg)[-2:], strict=True):
        rotation, position = ours.placed(R, p, body.joint, body.placement)
        assert (
            np.abs(rotation[0] - pose.rotation).max() < 1e-12 and np.abs(position[0] - pose.translation).max() < 1e-12
        )
    centres = [pin.centerOfMass(larger.model, data, q) for q in Q]
    assert np.abs(ours.centre_of_mass(Q) - centres).max() < 1e-12


def test_point():
    """The point mass has three sliding joints and one ball, and is where its configuration says."""
    ours = read(Statement(Point(0.001, (-1.1,) * 3, (1.1,) * 3), (), 1e-3))
    Q = np.random.default_rng(4).uniform(-1, 1, (6, 3))
    R, p = ours.frame_poses(Q, "point")
    assert ours.names == ("x", "y", "z") and not ours.turning.any()
    assert np.array_equal(p, Q) and np.array_equal(R, np.broadcast_to(np.eye(3), R.shape))
    assert ours.bodies[0].geometry.radius == 0.001 and ours.bodies[0].joint != WORLD


def test_centre_of_wound_faces():
    """The centre of a box and of two boxes does not depend on how faces are wound; an open box's is its own."""
    rng = np.random.default_rng(5)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * [0.2, 0.4, 0.8]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    turned = np.array([face[::-1] if rng.random() < 0.5 else face for face in faces.tolist()])
    for wound in (faces, faces[:, ::-1], turned):
        assert np.allclose(centre_of_faces(corners, wound), [0.1, 0.2, 0.4])
    both = centre_of_faces(np.vstack([corners, corners + np.array([1.0, 0.0, 0.0])]), np.vstack([turned, faces + 8]))
    assert np.allclose(both, [0.6, 0.2, 0.4])
    assert np.allclose(centre_of_faces(corners, faces[:10])[:2], [0.1, 0.2])  # without its lid: lower
    assert centre_of_faces(corners, faces[:10])[2] < 0.39


def test_unknown_frame_is_named():
    """A frame that does not exist is an error that names those there are."""
    with pytest.raises(RobotError, match="panda_hand_tcp"):
        read(Statement(settings("panda"), (), 1e-3)).frame("panda_hand_tpc")


def test_leader_wins_over_states(tmp_path):
    """A state of the SRDF that puts followers elsewhere moves nothing, one that puts their leader elsewhere does."""
    path, srdf = tmp_path / "branches.urdf", tmp_path / "branches.srdf"
    path.write_text(BRANCHES)
    srdf.write_text(
        '<robot name="branches"><group_state name="a" group="g"><joint name="de" value="0.8"/>'
        '<joint name="cd" value="2"/><joint name="bc" value="-2"/></group_state></robot>'
    )
    made = UrdfRobot(str(path), ("ab", "ra"), "f", "branches", srdf=str(srdf), state="a")
    fixed = replace(made, state="", fixed={"de": 0.8})
    Q = np.random.default_rng(6).uniform(0.2, 0.6, (4, 2))
    one, other = (read(Statement(said, (), 1e-3)).frame_poses(Q, "f") for said in (made, fixed))
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    check_frames(read(Statement(made, (), 1e-3)), made.robot().model, Q)
    assert np.array_equal(resting(made), made.robot().rest)
    with pytest.raises(RobotError, match="mimics 'de'"):
        read(Statement(replace(made, joints=("ab", "de")), (), 1e-3))


def test_shapes_that_links_say_otherwise(tmp_path):
    """A cylinder that its link calls a capsule is one, as pinocchio has it; continuous joints get limits."""
    path = tmp_path / "capsule.urdf"
    path.write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision name="rod"><geometry>'
        '<cylinder radius="0.1" length="0.4"/></geometry></collision><collision name="can"><geometry>'
        '<cylinder radius="0.2" length="0.3"/></geometry></collision>'
        '<collision_checking><capsule name="rod"/></collision_checking></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    made = UrdfRobot(str(path), ("j",), "b", "r", continuous=3.0)
    ours, planned = read(Statement(made, (), 1e-3)), made.robot().geometry.geometryObjects
    assert [type(body.geometry) for body in ours.bodies] == [type(body.geometry) for body in planned]
    assert [body.geometry.radius for body in ours.bodies] == [0.1, 0.2]
    assert (ours.lower[0], ours.upper[0], bool(ours.turning[0])) == (-3.0, 3.0, True)
