"""Robots read from URDF and SRDF: the named ones are what their files and sources say, and bad files are refused."""

import re
import sysconfig
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml

from pipeline.errors import ConfigError, RobotError
from pipeline.robots import ROBOTS, Geometry, Movable, UrdfRobot, Validity
from pipeline.schema import Choice
from tests.robots.named import FOLDER, ROBOT_NAMES, configurations, named

SHARE = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
DIMENSIONS = {
    "baxter_right": 7,
    "baxter_both": 14,
    "panda": 7,
    "sawyer": 7,
    "olivia": 17,
    "pholus": 41,
    "ur5": 6,
    "kinova": 6,
}
FRAMES = {
    "baxter_right": ["right_gripper", "right_lower_elbow"],
    "baxter_both": ["left_gripper", "right_gripper"],
    "panda": ["panda_hand_tcp", "panda_link4"],
    "sawyer": ["right_hand", "right_l3"],
    "olivia": ["left_palm", "right_palm"],
    "pholus": ["ball1", "ball2", "contact_1", "contact_2", "contact_3", "contact_4"],
    "ur5": ["tool0", "forearm_link"],
    "kinova": ["j2s6s200_end_effector", "j2s6s200_link_3"],
}


def test_every_config_is_tested():
    """The robots in conf/robot are those these tests know."""
    assert set(ROBOT_NAMES) == set(DIMENSIONS) == set(FRAMES)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_rests_free(name):
    """Every named robot has its joints, velocities, limits where joints do not turn, and rests valid within them."""
    robot = named(name)
    assert robot.dimension == DIMENSIONS[name] == len(robot.joint_names)
    np.testing.assert_array_equal(np.isfinite([robot.lower, robot.upper]), [~robot.turning] * 2)
    assert np.isfinite(robot.box).all() and (robot.velocity > 0).all()
    validity = Validity(robot, [])
    assert validity.valid(robot.rest)
    # A floating base and twenty leg joints anywhere mostly put legs into each other.
    free = np.mean([validity.free(q) for q in configurations(robot, np.random.default_rng(0), 300)])
    assert (0.02 if name == "pholus" else 0.3) < free < 1


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_symbolic_kinematics(name):
    """Poses of frames as expressions are pinocchio's, at random configurations."""
    robot, rng = named(name), np.random.default_rng(1)
    q = ca.SX.sym("q", robot.dimension)
    poses = ca.Function("poses", [q], [part for frame in FRAMES[name] for part in robot.symbolic_pose(q, frame)])
    data = robot.model.createData()
    for configuration in configurations(robot, rng, 10):
        found = [np.asarray(part) for part in poses(configuration)]
        pin.framesForwardKinematics(robot.model, data, configuration)
        for frame, R, p in zip(FRAMES[name], found[::2], found[1::2], strict=True):
            expected = data.oMf[robot.model.getFrameId(frame)]
            np.testing.assert_allclose(R, expected.rotation, atol=1e-11)
            np.testing.assert_allclose(p[:, 0], expected.translation, atol=1e-11)
            assert robot.pose(configuration, frame).isApprox(expected, 1e-12)


@pytest.mark.parametrize("name", ["baxter_right", "panda", "pholus"])
def test_centre_of_mass(name):
    """The centre of mass as an expression is pinocchio's."""
    robot, q = named(name), ca.SX.sym("q", DIMENSIONS[name])
    com = ca.Function("com", [q], [robot.symbolic_centre_of_mass(q)])
    data = robot.model.createData()
    for configuration in configurations(robot, np.random.default_rng(2), 10):
        expected = pin.centerOfMass(robot.model, data, configuration)
        np.testing.assert_allclose(np.asarray(com(configuration))[:, 0], expected, atol=1e-11)


def test_a_robot_without_mass_has_no_centre():
    """Sawyer's description has no masses: asking for its centre of mass says so."""
    with pytest.raises(RobotError, match="no mass"):
        named("sawyer").symbolic_centre_of_mass(ca.SX.sym("q", 7))


def test_fixed_joints_stand_where_they_are_told():
    """Baxter's group of one arm has its tool where the whole robot has it, with the other joints as configured."""
    robot = named("baxter_right")
    model = pin.buildModelFromUrdf(str(SHARE / "baxter_description/urdf/baxter.urdf"))
    whole, data = pin.neutral(model), model.createData()
    standing = {"left_s0": -0.08, "left_s1": -1.0, "left_e0": -1.19, "left_e1": 1.94, "left_w0": 0.67, "left_w1": 1.03,
                "left_w2": -0.5}  # fmt: skip
    for name, value in standing.items():
        whole[model.joints[model.getJointId(name)].idx_q] = value
    for q in configurations(robot, np.random.default_rng(3), 5):
        for name, value in zip(robot.joint_names, q, strict=True):
            whole[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, whole)
        for frame in ("right_gripper", "left_gripper"):
            assert robot.pose(q, frame).isApprox(data.oMf[model.getFrameId(frame)], 1e-12)


def turn(axis: str, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis as a homogeneous matrix, written out."""
    c, s, T = np.cos(angle), np.sin(angle), np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T[i, i] = T[j, j] = c
    T[i, j], T[j, i] = -s, s
    return T


def shift(*xyz: float) -> np.ndarray:
    """Translation as a homogeneous matrix."""
    T = np.eye(4)
    T[:3, 3] = xyz
    return T


SAWYER = [  # origin, roll, pitch, yaw, limits, velocity, of the makers' table
    ((0, 0, 0.08), (0, 0, 0), -3.0503, 3.0503, 1.74),
    ((0.081, 0.05, 0.237), (-np.pi / 2, np.pi / 2, 0), -3.8095, 2.2736, 1.328),
    ((0, -0.14, 0.1425), (np.pi / 2, 0, 0), -3.0426, 3.0426, 1.957),
    ((0, -0.042, 0.26), (-np.pi / 2, 0, 0), -3.0439, 3.0439, 1.957),
    ((0, -0.125, -0.1265), (np.pi / 2, 0, 0), -2.9761, 2.9761, 3.485),
    ((0, 0.031, 0.275), (-np.pi / 2, 0, 0), -2.9761, 2.9761, 3.485),
    ((0, -0.11, 0.1053), (-np.pi / 2, -0.17453, 3.1416), -4.7124, 4.7124, 4.545),
]


def test_sawyer_is_its_table():
    """Sawyer's hand is where a product of the published table's matrices has it; its limits are the table's."""
    robot = named("sawyer")
    np.testing.assert_allclose(robot.lower, [row[2] for row in SAWYER])
    np.testing.assert_allclose(robot.upper, [row[3] for row in SAWYER])
    np.testing.assert_allclose(robot.velocity, [row[4] for row in SAWYER])
    for q in configurations(robot, np.random.default_rng(4), 10):
        T = np.eye(4)
        for (xyz, (roll, pitch, yaw), *_), angle in zip(SAWYER, q, strict=True):
            T = T @ shift(*xyz) @ turn("z", yaw) @ turn("y", pitch) @ turn("x", roll) @ turn("z", angle)
        T = T @ shift(0, 0, 0.0245) @ turn("z", 1.570796)
        np.testing.assert_allclose(robot.pose(q, "right_hand").homogeneous, T, atol=1e-9)


def test_olivia_has_the_published_lengths():
    """Shoulder to elbow is 0.300 m, elbow to wrist 0.314 m, wrist to palm 0.127 m; the shoulders are 1.17 m high."""
    robot, straight = named("olivia"), np.zeros(17)
    for side, sign in (("left", 1), ("right", -1)):
        place = {n: robot.pose(straight, f"{side}_{n}").translation for n in ("shoulder_yaw", "wrist_pitch", "palm")}
        assert place["shoulder_yaw"][2] + 0.027 == pytest.approx(1.17, abs=1e-3)
        assert place["shoulder_yaw"][2] + 0.027 - place["wrist_pitch"][2] == pytest.approx(0.614, abs=1e-3)
        assert place["wrist_pitch"][2] - place["palm"][2] == pytest.approx(0.127, abs=1e-9)
        assert place["palm"][1] == pytest.approx(sign * 0.2295, abs=1e-9)


def test_olivia_is_symmetric():
    """Mirrored configurations put the palms at mirrored places."""
    robot, rng = named("olivia"), np.random.default_rng(5)
    mirror = np.array([1, -1, 1, -1, 1, -1, -1])  # roll and yaw change sign, pitch does not: see the joint order
    mirror = np.where([("roll" in n or "yaw" in n) for n in robot.joint_names[3:10]], -1, 1) * np.abs(mirror)
    for _ in range(5):
        arm = rng.uniform(-0.5, 0.5, 7)
        q = np.concatenate([np.zeros(3), arm, mirror * arm])
        left, right = (robot.pose(q, f"{side}_palm").translation for side in ("left", "right"))
        np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-9)


def test_pholus_stands():
    """At rest Pholus' four feet are on a plane to 7 mm and its mass is over them."""
    robot = named("pholus")
    feet = np.array([robot.pose(robot.rest, f"contact_{i}").translation for i in range(1, 5)])
    assert np.ptp(feet[:, 2]) < 0.007
    assert abs(feet[:, 2].mean()) < 1e-3
    data = robot.model.createData()
    com = pin.centerOfMass(robot.model, data, robot.rest)
    assert (feet[:, :2].min(axis=0) < com[:2]).all() and (com[:2] < feet[:, :2].max(axis=0)).all()
    assert sum(inertia.mass for inertia in robot.model.inertias) == pytest.approx(117.1, abs=0.1)


def test_floating_base_is_free():
    """The six virtual joints of Pholus put its pelvis at x, y, z with yaw, pitch and roll in that order."""
    robot, rng = named("pholus"), np.random.default_rng(6)
    root = "pelvis"
    q = robot.rest.copy()
    q[:6] = rng.uniform(-0.5, 0.5, 6)
    expected = shift(*q[:3]) @ turn("z", q[3]) @ turn("y", q[4]) @ turn("x", q[5])
    np.testing.assert_allclose(robot.pose(q, root).homogeneous, expected, atol=1e-12)


TINY = """<robot name="tiny">
  <link name="a"/>
  <link name="b"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="c"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="d"/>
  <joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="0"/></joint>
  <joint name="two" type="continuous">
    <parent link="b"/><child link="c"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="c"/><child link="d"/><origin xyz="0.5 0 0"/></joint>
</robot>
"""


def tiny(tmp_path: Path, text: str = TINY, **settings) -> UrdfRobot:
    """A robot of two joints in a file of its own."""
    path = tmp_path / "tiny.urdf"
    path.write_text(text)
    return replace(UrdfRobot(str(path), ("one", "two"), "d", "tiny"), **settings)


def test_continuous_joints_turn_unless_they_get_limits(tmp_path):
    """A joint without limits turns without end unless it is given some; a file of one's own is enough."""
    robot, bounded = tiny(tmp_path).robot(), tiny(tmp_path, continuous=3.0).robot()
    np.testing.assert_array_equal(robot.upper, [1, np.inf])
    np.testing.assert_array_equal(robot.turning, [False, True])
    np.testing.assert_allclose(bounded.lower, [-1, -3])
    assert not bounded.turning.any()
    swapped = tiny(tmp_path, joints=("two", "one"), rest={"two": 7.0}).robot()
    np.testing.assert_array_equal(swapped.turning, [True, False])
    assert swapped.rest[0] == 7.0 and tiny(tmp_path, joints=("one",), fixed={"two": -9.0}).robot().dimension == 1
    assert robot.pose(np.array([0.0, np.pi / 2]), "d").translation == pytest.approx([1, 0, -0.5])


def test_a_base_that_may_face_anywhere_turns(tmp_path):
    """Of a floating base those angles turn without end whose limits are a turn or more apart."""
    bounds = {axis: (-1.0, 1.0) for axis in ("x", "y", "z", "yaw", "pitch", "roll")}
    for yaw, turns in (((-np.pi, np.pi), True), ((0.0, 9.0), True), ((-3.1, 3.1), False)):
        base = {"joints": ("base_x", "base_yaw", "two"), "floating": {**bounds, "yaw": yaw}}
        robot = tiny(tmp_path, **base, continuous=2.0).robot()
        assert robot.turning.tolist() == [False, turns, False] and np.isinf(robot.upper[1]) == turns


def test_fixed_joint_can_be_made_movable(tmp_path):
    """A fixed joint named movable turns about its axis, from its new origin, under its new name."""
    movable = {"end": Movable("three", (0, 0, 1), -2.0, 2.0, xyz=(0.2, 0, 0))}
    robot = tiny(tmp_path, joints=("one", "two", "three"), movable=movable).robot()
    assert robot.joint_names == ("one", "two", "three")
    pose = robot.pose(np.array([0, 0, 0.5]), "d")
    assert pose.translation == pytest.approx([1.2, 0, 0]) and pin.log3(pose.rotation) == pytest.approx([0, 0, 0.5])


def test_neighbours_do_not_collide_without_an_srdf(tmp_path):
    """Without an SRDF bodies of neighbouring joints are not checked; with one, only what it disables."""
    assert not len(tiny(tmp_path).robot().geometry.collisionPairs)
    srdf = tmp_path / "tiny.srdf"
    srdf.write_text('<robot name="tiny"><disable_collisions link1="a" link2="d"/></robot>')
    assert len(tiny(tmp_path, srdf=str(srdf)).robot().geometry.collisionPairs) == 1
    ignored = tiny(tmp_path, srdf=str(srdf), ignored=(("c", "b"),)).robot()
    assert not len(ignored.geometry.collisionPairs)


BAD_FILES = {
    "no XML": ("<robot", "is not XML"),
    "empty": ("", "is not XML"),
    "other XML": ("<sdf/>", "outermost element is <sdf>"),
    "no links": ('<robot name="r"/>', "no links"),
    "link without a name": (TINY.replace('<link name="a"/>', "<link/>"), "a <link> of .* has no name"),
    "link twice": (TINY.replace('<link name="d"/>', '<link name="d"/><link name="d"/>'), "two of <link name='d'>"),
    "joint twice": (TINY.replace('joint name="two"', 'joint name="one"'), "two of <joint name='one'>"),
    "unknown link": (TINY.replace('child link="c"', 'child link="cc"'), "'two' .* child link 'cc' .did you mean 'c'"),
    "no parent": (TINY.replace('<parent link="a"/>', ""), "'one' .* parent link"),
    "child of two": (
        TINY.replace('<parent link="c"/><child link="d"/>', '<parent link="a"/><child link="b"/>'),
        "two joints",
    ),
    "loop": (TINY.replace('<link name="a"/>', "").replace('parent link="a"', 'parent link="c"'), "loop"),
    "two trees": (TINY.replace('<link name="a"/>', '<link name="a"/><link name="z"/>'), "2 root links .a, z"),
    "joint type": (TINY.replace('type="continuous"', 'type="hinge"'), "'two' .* type 'hinge'; there are: revolute"),
    "no limit": (re.sub(r"<limit.*/>", "", TINY), "'one' .* no <limit>"),
    "no range": (TINY.replace('lower="-1" upper="1" ', ""), "'one' .* limits 0.0 and 0.0.*0 where left out"),
    "mimic of nobody": (TINY.replace("<axis", "<mimic/><axis", 1), "<mimic> of joint 'one' of .* names no joint"),
    "mimic no number": (TINY.replace("<axis", '<mimic joint="two" offset="x"/><axis', 1), "offset='x' in a <mimic>"),
    "mimic of two": (TINY.replace("<axis", '<mimic joint="two" offset="1 2"/><axis', 1), "must be a number"),
    "mimic of itself": (TINY.replace("<axis", '<mimic joint="one"/><axis', 1), "in a loop: one, one"),
    "limits crossed": (TINY.replace('lower="-1"', 'lower="2"'), "lower limit 2.0 above its upper limit 1.0"),
    "limit no number": (TINY.replace('lower="-1"', 'lower="low"'), "lower='low'"),
    "velocity below 0": (TINY.replace('velocity="1"', 'velocity="-1"'), "'one' .* has velocity limit -1.0"),
    "no effort": (TINY.replace(' effort="0"', ""), "<limit> of joint 'one' of .* has no effort"),
    "no robot's name": (TINY.replace(' name="tiny"', ""), "<robot> of .* has no name"),
    "effort no number": (TINY.replace('effort="0"', 'effort=""'), "effort=''"),
    "origin of two": (TINY.replace('xyz="1 0 0"', 'xyz="1 0"'), "xyz='1 0' in a <origin>; it must be 3 numbers"),
    "NaN": (TINY.replace('xyz="1 0 0"', 'xyz="nan 0 0"'), "xyz='nan 0 0' .* finite"),
    "radius infinite": (TINY.replace('radius="0.1"', 'radius="inf"'), "radius='inf'"),
    "mesh missing": (
        TINY.replace('<sphere radius="0.1"/>', '<mesh filename="no.stl"/>'),
        "no file 'no.stl'; looked for",
    ),
    "mesh package missing": (
        TINY.replace('<sphere radius="0.1"/>', '<mesh filename="package://p/no.stl"/>'),
        "no file 'package://p/no.stl'",
    ),
    "capsule": (TINY.replace('<sphere radius="0.1"/>', '<capsule radius="0.1" length="1"/>'), "holds <capsule>"),
    "no shape": (TINY.replace('<sphere radius="0.1"/>', ""), "link 'b' .* holds nothing"),
    "box of two": (TINY.replace('size="0.1 0.1 0.1"', 'size="0.1 0.1"'), "size='0.1 0.1'; it must be 3 above 0"),
    "negative radius": (TINY.replace('radius="0.1"', 'radius="-0.1"'), "radius='-0.1'"),
    "sphere without radius": (TINY.replace('radius="0.1"', ""), "a <sphere> of link 'b' .* has no radius"),
    "mass no number": (
        TINY.replace('<link name="d"/>', '<link name="d"><inertial><mass value="m"/></inertial></link>'),
        "value='m'",
    ),
    "mesh without file": (TINY.replace('<sphere radius="0.1"/>', "<mesh/>"), "has no filename"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_files_are_refused(case, tmp_path):
    """Every malformed description is refused with a message that names what is wrong and where."""
    text, message = BAD_FILES[case]
    with pytest.raises(RobotError, match=message):
        tiny(tmp_path, text).robot()


def test_broken_mesh_is_refused(tmp_path):
    """A mesh file of garbage is an error with the robot's file in it, not a crash."""
    (tmp_path / "bad.stl").write_bytes(b"solid nothing\n\x00\xff")
    with pytest.raises(RobotError, match=r"tiny\.urdf"):
        tiny(tmp_path, TINY.replace('<sphere radius="0.1"/>', '<mesh filename="bad.stl"/>')).robot()


BAD_SETTINGS = {
    "no such joint": ({"joints": ("one", "tow")}, "'tow' .did you mean 'two'.*one, two"),
    "no joint": ({"joints": ()}, "one or more"),
    "joint twice": ({"joints": ("one", "one")}, "repeated: .'one'"),
    "no such tool": ({"tool": "e"}, "no frame 'e'; there are: .*d"),
    "rest unknown": ({"rest": {"on": 0.0}}, "rest .* 'on' .did you mean 'one'"),
    "rest outside": ({"rest": {"one": 2.0}}, "'one' .* rests at 2.0; its limits are -1.0 and 1.0"),
    "rest not in group": ({"joints": ("one",), "rest": {"two": 0.0}}, "name it in fixed"),
    "fixed in group": ({"fixed": {"two": 0.0}}, "name it in rest"),
    "fixed unknown": ({"fixed": {"x": 0.0}}, "fixed .* 'x'"),
    "no such file": ({"urdf": "nowhere.urdf"}, "no file 'nowhere.urdf'"),
    "no such package": ({"urdf": "package://nowhere/a.urdf"}, "no file 'package://nowhere/a.urdf'; looked for"),
    "no such srdf": ({"srdf": "nowhere.srdf"}, "no file 'nowhere.srdf'"),
    "no such state": ({"state": "home"}, "no state 'home'; there are: none"),
    "floating bounds": ({"floating": {"x": (0.0, 1.0)}}, "needs x, y, z, yaw, pitch, roll"),
    "movable unknown": ({"movable": {"no": Movable("m", (0, 0, 1), -1, 1)}}, "'no'; there are: one, two, end"),
    "movable moves": ({"movable": {"one": Movable("m", (0, 0, 1), -1, 1)}}, "revolute already"),
    "movable axis": ({"movable": {"end": Movable("m", (0, 0, 0), -1, 1)}}, "needs an axis"),
    "floating bound": (
        {"floating": dict.fromkeys(("x", "y", "z", "yaw", "pitch", "roll"), (1.0,))},
        "floating.x is .1.0.",
    ),
    "ignored link": ({"ignored": (("b", "cc"),)}, "ignored .* 'cc' .did you mean 'c'"),
    "ignored triple": ({"ignored": (("b", "c", "d"),)}, "pairs of links"),
    "movable renamed": ({"movable": {"end": Movable("one", (0, 0, 1), -1, 1)}}, "another joint"),
}


@pytest.mark.parametrize("case", BAD_SETTINGS)
def test_bad_settings_are_refused(case, tmp_path):
    """Every setting that does not fit the file is refused with a message that names what there is."""
    settings, message = BAD_SETTINGS[case]
    with pytest.raises(RobotError, match=message):
        tiny(tmp_path, **settings).robot()


def test_a_urdf_is_no_srdf(tmp_path):
    """A URDF given as SRDF is refused: it would disable nothing."""
    (tmp_path / "other.urdf").write_text(TINY)
    with pytest.raises(RobotError, match=r"other\.urdf is no SRDF"):
        tiny(tmp_path, srdf=str(tmp_path / "other.urdf")).robot()


JUNK = ("", "x", "nan", "-1", "0", "1e300", "1 2", "a", "b", "0.5", "0 1 0", "0 0 0", "0 0 0 0", "prismatic", "\u00e9")


def test_fuzzed_descriptions(tmp_path, capfd):
    """Descriptions changed at random, values and bytes, are read or refused, never anything else, and quietly so."""
    rng, outcomes = np.random.default_rng(1), []
    for number in range(600):
        text = TINY
        for _ in range(int(rng.integers(1, 3))):
            spans = [m.span(1) for m in re.finditer('"([^"]*)"', text)] if number % 3 else [(0, len(text))]
            first, end = spans[int(rng.integers(len(spans)))]
            if number % 3:
                text = text[:first] + JUNK[int(rng.integers(len(JUNK)))] + text[end:]
            else:
                at = int(rng.integers(first, end))
                text = text[:at] + text[at + int(rng.integers(1, 9)) :]
        try:
            robot = tiny(tmp_path, text).robot()
            outcomes.append(bool(np.isfinite(robot.pose(robot.rest, "d").translation).all()))
        except RobotError as error:
            outcomes.append(None)
            assert "tiny" in str(error)
    assert outcomes.count(None) > 200 and outcomes.count(True) > 30 and False not in outcomes
    assert capfd.readouterr().err == ""  # what the parsers below say is said on the console only


def test_continuous_limit_must_be_positive(tmp_path):
    """A limit for continuous joints of 0 or less is refused."""
    with pytest.raises(ConfigError, match=r"robot\.continuous is 0"):
        tiny(tmp_path, continuous=0.0)


def test_bad_srdf_is_refused(tmp_path):
    """An SRDF that is no XML, or has a state that is no number, is refused."""
    srdf = tmp_path / "tiny.srdf"
    for text, message in (
        ("{}", "is not XML"),
        ("<robot><group_state name='s'><joint name='one' value='x'/></group_state></robot>", "value='x'"),
    ):
        srdf.write_text(text)
        with pytest.raises(RobotError, match=message):
            tiny(tmp_path, srdf=str(srdf)).robot()


@pytest.mark.parametrize("kind", Geometry)
def test_geometry_kinds_nest(kind):
    """Whatever Panda's meshes become, what collides as a mesh collides as its hull or primitive too."""
    settings = Choice(**yaml.safe_load((FOLDER / "panda.yaml").read_text())).make(ROBOTS, "robot")
    meshes, other = (Validity(replace(settings, geometry=g).robot(), []) for g in (Geometry.MESHES, kind))
    rng = np.random.default_rng(7)
    Q = configurations(other.robot, rng, 300)
    hit = [not meshes.free(q) for q in Q]
    assert 5 < sum(hit) < 295
    assert all(not other.free(q) for q, collides in zip(Q, hit, strict=True) if collides)


def test_a_link_may_have_its_joints_name(tmp_path):
    """A frame name that is a link's and a joint's means the link; where pinocchio cannot cope the name is given."""
    text = TINY.replace('"c"', '"two"')
    robot = tiny(tmp_path, text, tool="two").robot()
    assert robot.pose(np.zeros(2), "two").translation == pytest.approx([1, 0, 0])
    with pytest.raises(RobotError, match=r'name="two".*rename the joint or the link'):
        tiny(tmp_path, text, joints=("two",), tool="two").robot()


def test_movable_replaces_axis_and_limits(tmp_path):
    """An axis and limits that the fixed joint has in the file give way to those of `movable`."""
    end = '<joint name="end" type="fixed">'
    text = TINY.replace(end, end + '<axis xyz="1 0 0"/><limit lower="-0.1" upper="0.1" velocity="1" effort="0"/>')
    movable = {"end": Movable("three", (0, 0, 1), -2.0, 2.0)}
    robot = tiny(tmp_path, text, joints=("one", "two", "three"), movable=movable).robot()
    assert robot.upper[2] == 2.0
    assert robot.pose(np.array([0, 0, 0.5]), "d").rotation == pytest.approx(pin.utils.rotate("z", 0.5))
