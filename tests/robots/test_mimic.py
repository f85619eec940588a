"""Joints that mimic others stand where pinocchio puts them when every follower is set by hand."""

import xml.etree.ElementTree as ET
from itertools import permutations

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import following
from pipeline.errors import RobotError
from tests.robots.test_urdf import SHARE, TINY, tiny

SLIDER = """<link name="e"/><joint name="three" type="prismatic"><parent link="d"/><child link="e"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="1" velocity="0" effort="0"/></joint></robot>"""


def test_mimicking_joints(tmp_path):
    """A joint that mimics another stands where that one puts it; led by a joint of the group it is refused."""
    two = '<joint name="two" type="continuous">'
    text = TINY.replace(two, two + '<mimic joint="one" multiplier="2" offset="0.1"/>')
    slider = text.replace("</robot>", SLIDER)
    robot = tiny(tmp_path, slider, joints=("three",), fixed={"one": 0.4}).robot()
    pose = robot.pose(np.zeros(1), "c")
    assert pose.rotation == pytest.approx(pin.utils.rotate("z", 0.4) @ pin.utils.rotate("y", 0.9))
    assert robot.velocity.tolist() == [1.0]  # a limit of 0 is none
    with pytest.raises(RobotError, match="'two' mimics 'one'"):
        tiny(tmp_path, text, joints=("one",)).robot()


def gripper(order: tuple[str, ...]) -> str:
    """A hand whose joints stand in the file in this order: `near` follows `lead`, `far` follows `near`, `end` `far`."""
    mimics = {"near": ("lead", -1.0, 0.0), "far": ("near", 2.0, 0.1), "end": ("far", 0.5, -0.02)}
    limits = {"one": "-2 2", "lead": "0.02 0.08", "near": "0 0.001", "far": "", "end": ""}
    joints = {}
    for name, bounds in limits.items():
        low, high = bounds.split() if bounds else ("", "")
        limit = f'<limit lower="{low}" upper="{high}" velocity="1" effort="0"/>' if bounds else ""
        leader, multiplier, offset = mimics.get(name, ("", 0, 0))
        mimic = f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>' if leader else ""
        kind, axis, parent = ("revolute", "0 0 1", "a") if name == "one" else ("prismatic", "0 1 0", "link_one")
        joints[name] = (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="link_{name}"/>'
            f'<axis xyz="{axis}"/>{limit}{mimic}</joint>'
        )
    links = "".join(f'<link name="link_{name}"/>' for name in limits)
    return f'<robot name="g"><link name="a"/>{links}{"".join(joints[name] for name in order)}</robot>'


def test_followers_follow_in_any_order(tmp_path):
    """Followers stand where their leaders put them, followers of followers too, in any order and without limits."""
    for order in permutations(("lead", "near", "far", "end")):
        for fixed in ({}, {"lead": 0.06}):
            robot = tiny(tmp_path, gripper(("one", *order)), joints=("one",), tool="a", fixed=fixed).robot()
            at = {name: robot.pose(np.zeros(1), f"link_{name}").translation[1] for name in ("one", *order)}
            lead = fixed.get("lead", 0.05)  # else the middle of its limits
            expected = {"one": 0, "lead": lead, "near": -lead, "far": 0.1 - 2 * lead, "end": 0.03 - lead}
            assert at == pytest.approx(expected, abs=1e-12)


BAD_FOLLOWERS = {
    "in the group": ({"joints": ("one", "near")}, "'near' .* mimics 'lead' .* leave it out of `joints`.*'lead' stands"),
    "led by the group": ({"joints": ("one", "lead")}, "'near' mimics 'lead', but a variable .* leave 'lead' out"),
    "far from the group": ({"joints": ("far", "lead")}, "mimics .*, but a variable .* leave 'lead' out"),
    "put elsewhere": ({"fixed": {"far": 0.5}}, "fixed puts joint 'far' .* at 0.5, but it mimics 'near' and stands at"),
}


@pytest.mark.parametrize("case", BAD_FOLLOWERS)
def test_followers_that_cannot_be_are_refused(case, tmp_path):
    """A follower or its leader in the group, or a follower fixed where it does not stand, is refused with a way out."""
    settings, message = BAD_FOLLOWERS[case]
    text = gripper(("one", "lead", "near", "far", "end"))
    with pytest.raises(RobotError, match=message):
        tiny(tmp_path, text, **{"joints": ("one",), "tool": "a", **settings}).robot()
    for loop in ('joint="far" multiplier="-1.0"', 'joint="near" multiplier="-1.0"'):
        with pytest.raises(RobotError, match=r"in a loop: .*near"):
            tiny(tmp_path, text.replace('joint="lead" multiplier="-1.0"', loop), joints=("one",), tool="a").robot()


def test_a_follower_without_a_leader(tmp_path):
    """A joint that mimics one the file lacks is refused, unless it is said where it stands."""
    text = gripper(("one", "lead", "near", "far", "end")).replace('joint="lead" multiplier', 'joint="leed" multiplier')
    given = {"joints": ("one",), "tool": "a"}
    with pytest.raises(
        RobotError, match=r"'near' .* mimics a joint that does not exist .* 'leed' .did you mean 'lead'"
    ):
        tiny(tmp_path, text, **given).robot()
    with pytest.raises(RobotError, match=r"'far' .* mimics"):
        tiny(tmp_path, text, fixed={"near": 0.3}, **given).robot()
    robot = tiny(tmp_path, text, fixed={"near": 0.3, "far": 0.7, "end": 0.0}, **given).robot()
    assert robot.pose(np.zeros(1), "link_near").translation[1] == pytest.approx(0.3)


MIMICKING = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_joint1"),
    "baxter": ("baxter_description/urdf/baxter.urdf", "head_pan"),
    "romeo": ("romeo_description/urdf/romeo.urdf", "NeckYaw"),
    "pr2": ("pr2_description/urdf/pr2.urdf", "head_pan_joint"),
    "tiago_pro": ("tiago_pro_description/robots/tiago_pro.urdf", "head_1_joint"),
    "talos": ("talos_data/robots/talos_full_v2.urdf", "head_1_joint"),
}


@pytest.mark.parametrize("name", MIMICKING)
def test_grippers_of_known_robots(name, tmp_path):
    """All frames are where pinocchio has them in the whole robot, with every follower put where its leader says."""
    file, joint = MIMICKING[name]
    root, rng = ET.parse(SHARE / file).getroot(), np.random.default_rng(13)
    for link in root.findall("link"):
        for shape in (*link.findall("collision"), *link.findall("visual")):
            link.remove(shape)  # of no concern here, and slow to load
    mimics = {str(j.get("name")): j.find("mimic").attrib for j in root.findall("joint") if j.find("mimic") is not None}
    moving = {str(j.get("name")): j for j in root.findall("joint") if j.get("type") in ("revolute", "prismatic")}
    model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    led = {m["joint"] for m in mimics.values()} & set(moving)
    fixed = {n: rng.uniform(*(float(moving[n].find("limit").get(k)) for k in ("lower", "upper"))) for n in sorted(led)}
    q = pin.neutral(model)
    for other, element in moving.items():
        low, high = (float(element.find("limit").get(key, 0)) for key in ("lower", "upper"))
        value = fixed.get(other, 0.0 if low <= 0 <= high else (low + high) / 2)
        if other in mimics:
            m = mimics[other]
            value = float(m.get("multiplier", 1)) * fixed[m["joint"]] + float(m.get("offset", 0))
        q[model.joints[model.getJointId(other)].idx_q] = value
    robot = tiny(tmp_path, ET.tostring(root, encoding="unicode"), joints=(joint,), tool="universe", fixed=fixed).robot()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    at = q[[model.joints[model.getJointId(joint)].idx_q]]
    for frame, placed in zip(model.frames, data.oMf, strict=True):
        if frame.type == pin.FrameType.BODY:
            assert robot.pose(at, frame.name).isApprox(placed, 1e-9), frame.name


def test_followers_in_the_group_have_an_equation(tmp_path):
    """A group of a leader and all its followers has a row for each, which is 0 exactly where pinocchio would put them;
    limits are what the leader's leave, and a group that lacks a follower is refused."""
    group = ("end", "one", "lead", "far", "near")
    robot = tiny(tmp_path, gripper(("far", "one", "near", "lead", "end")), joints=group, tool="a").robot()
    constraint, rng = following(robot), np.random.default_rng(3)
    assert (constraint.k, constraint.n) == (3, 5)
    at = {name: robot.joint_names.index(name) for name in group}
    for _ in range(20):
        lead = rng.uniform(0.02, 0.08)
        put = {"one": rng.uniform(-2, 2), "lead": lead, "near": -lead, "far": 0.1 - 2 * lead, "end": 0.03 - lead}
        q = np.array([put[name] for name in group])
        assert np.abs(constraint.value(q)).max() < 1e-12
        assert ((robot.lower <= q) & (q <= robot.upper)).all()
        moved = q.copy()
        moved[at["far"]] += 0.02
        assert np.linalg.norm(constraint.value(moved)) == pytest.approx(0.02)
    assert robot.lower[at["end"]] == pytest.approx(-0.05 - 0.01) and robot.upper[at["end"]] == pytest.approx(
        0.01 + 0.01
    )
    assert np.abs(constraint.value(robot.rest)).max() < 1e-12
    with pytest.raises(RobotError, match=r"'near' mimics 'lead', but .* name 'near' in `joints` too"):
        tiny(tmp_path, gripper(("one", "lead", "near", "far", "end")), joints=("lead", "far", "end"), tool="a").robot()


def test_a_follower_turns_no_further_than_its_leader(tmp_path):
    """A follower of a joint that turns without end is refused with the setting that gives it limits, and then moves."""
    two = '<joint name="two" type="continuous">'
    text = TINY.replace(two, two + '<mimic joint="one" multiplier="2" offset="0.1"/>')
    with pytest.raises(RobotError, match=r"'two' .* mimics 'one', one of which turns without end: set `continuous`"):
        tiny(tmp_path, text, joints=("one", "two")).robot()
    robot = tiny(tmp_path, text, joints=("one", "two"), continuous=3.0).robot()
    low, high = (bounds[0] for bounds in (robot.lower, robot.upper))
    assert robot.lower[1] == pytest.approx(2 * low + 0.1 - 0.01) and robot.upper[1] == pytest.approx(2 * high + 0.11)
