"""Descriptions from strangers are read or refused in one line: however deep, long or large what they say is."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pipeline.errors import ProblemError, RobotError
from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.robots.description import SHARE, read_srdf, read_urdf
from pipeline.robots.xml import DEEPEST, check_mesh, read_xml

LONGEST = 500  # links in a row, as the message says


def chain(count: int, kind: str = "revolute") -> str:
    """Return a URDF of `count` joints one after the other, the first of which turns."""
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="{kind if i else "revolute"}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def nested(count: int, inside: str = "") -> str:
    """Return a robot of two links with `count` elements inside each other beside them."""
    return chain(1).replace("</robot>", "<x>" * count + inside + "</x>" * count + "</robot>")


def robot(path: Path, text: str, **settings) -> UrdfRobot:
    path.write_text(text)
    return UrdfRobot(name="r", urdf=str(path), joints=("j0",), **{"tool": "l1", **settings})


def refused(path: Path, *said: str):
    """A context in which a RobotError of one line must name the file and say every one of `said`."""
    words = "".join(rf"[^\n]*{re.escape(word)}" for word in said)
    return pytest.raises(RobotError, match=rf"\A[^\n]*{re.escape(str(path))}{words}[^\n]*\Z")


@pytest.mark.parametrize("kind", ["revolute", "fixed"])
@pytest.mark.parametrize("count", [LONGEST, 5000, 20_000])
def test_long_chains_are_refused(tmp_path, kind, count):
    """A chain longer than the bound is refused with it, before anything calls itself once for each link."""
    with refused(tmp_path / "r.urdf", f"more than {LONGEST} links one after the other; at most {LONGEST} are read"):
        robot(tmp_path / "r.urdf", chain(count, kind)).robot()


def test_the_longest_chain_is_read(tmp_path):
    """A chain at the bound is read, and all of it can be planned for: its tool turns by the sum of all angles."""
    count = LONGEST - 1
    asked = robot(tmp_path / "r.urdf", chain(count), tool=f"l{count}")
    made = replace(asked, joints=tuple(f"j{i}" for i in range(count))).robot()
    assert made.dimension == count
    q = ca.SX.sym("q", count)
    rotation = ca.Function("rotation", [q], [made.symbolic_pose(q, f"l{count}").rotation])
    turned = np.array(rotation(np.full(count, 1e-3)))
    np.testing.assert_allclose(turned[:, 0], [np.cos(count * 1e-3), np.sin(count * 1e-3), 0.0], atol=1e-12)


def test_many_short_branches_are_no_chain(tmp_path):
    """Thousands of links are fine where they do not hang on each other."""
    hands = "".join(
        f'<link name="h{i}"/><joint name="f{i}" type="fixed"><parent link="l1"/><child link="h{i}"/></joint>'
        for i in range(2000)
    )
    assert robot(tmp_path / "r.urdf", chain(1).replace("</robot>", f"{hands}</robot>")).robot().dimension == 1


@pytest.mark.parametrize("count", [DEEPEST, 1000, 100_000])
def test_deep_xml_is_refused(tmp_path, count):
    """Elements deeper in each other than the bound are refused with it, in URDF and SRDF."""
    (tmp_path / "r.urdf").write_text(nested(count))
    for read in (read_urdf, read_srdf, read_xml):
        with refused(tmp_path / "r.urdf", f"more than {DEEPEST} elements inside each other"):
            read(tmp_path / "r.urdf")


def test_xml_at_the_bound_is_read(tmp_path):
    """Elements as deep as the bound, and any number beside each other, are read, and pinocchio takes them."""
    assert robot(tmp_path / "r.urdf", nested(DEEPEST - 2, "<y/>" * 1000)).robot().dimension == 1


@pytest.mark.parametrize("text", ["", "<robot", "\x00", "<a/><b/>", "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&d;</a>"])
def test_what_is_no_xml_is_refused(tmp_path, text):
    """What is cut off or no XML is refused by name."""
    (tmp_path / "r.urdf").write_text(text)
    with refused(tmp_path / "r.urdf", "is not XML"):
        read_xml(tmp_path / "r.urdf")


MESH = (
    '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
    '<library_visual_scenes><visual_scene id="s">{}</visual_scene></library_visual_scenes></COLLADA>'
)


def test_deep_meshes_are_refused(tmp_path):
    """A mesh that is XML is refused as deep as a description, before it crashes the library that reads it."""
    (tmp_path / "m.dae").write_text("\ufeff" + MESH.format("<node>" * 10_000 + "</node>" * 10_000))
    collision = '<link name="l0"><collision><geometry><mesh filename="m.dae"/></geometry></collision></link>'
    text = chain(1).replace('<link name="l0"/>', collision)
    with refused(tmp_path / "m.dae", f"more than {DEEPEST} elements"):
        robot(tmp_path / "r.urdf", text).robot()
    here = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
    with pytest.raises(ProblemError, match=f"mesh 'm' cannot be read: .*m.dae has more than {DEEPEST} elements"):
        Obstacle(Shape.MESH, *here, "m", str(tmp_path / "m.dae")).geometry()
    (tmp_path / "m.stl").write_bytes(b"solid" + bytes(100))
    check_mesh(tmp_path / "m.stl")  # no XML: for its own library to judge


WHOLE = """<robot name="r"><link name="l0"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 0" rpy="0 0 0"/>
<geometry><box size="1 1 1"/></geometry></collision></link><link name="l1"><collision><geometry>
<cylinder radius="1" length="1"/></geometry></collision></link><link name="l2"/><link name="l3"/>
<joint name="j0" type="revolute"><origin xyz="0 0 3" rpy="0 0 0"/><parent link="l0"/><child link="l1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/><dynamics damping="1" friction="0"/>
<safety_controller soft_lower_limit="0" soft_upper_limit="0" k_position="1" k_velocity="1"/></joint>
<joint name="j1" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="j2" type="revolute"><parent link="l2"/><child link="l3"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="j1" multiplier="1" offset="0"/></joint></robot>"""
NUMBERS = [match.span() for match in re.finditer(r'(?<=[" ])-?\d+(?=[" ])', WHOLE)]


@pytest.mark.parametrize("number", ["9" * 400, "-1e400", "nan", "0x10", "one"])
def test_every_number_is_looked_at(tmp_path, capfd, number):
    """With any one number of a description replaced by one that no float holds, or by a word, it is refused by name.

    Libraries underneath would leave out what the number belongs to, a mass say, and print to the console.
    """
    assert len(NUMBERS) > 50 and robot(tmp_path / "r.urdf", WHOLE).robot().dimension == 1
    for begin, end in NUMBERS:
        with refused(tmp_path / "r.urdf", "it must be"):
            robot(tmp_path / "r.urdf", WHOLE[:begin] + number + WHOLE[end:]).robot()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("what", ["/dev/zero", "fifo"])
def test_what_is_no_ordinary_file_is_not_read(tmp_path, what):
    """A device or a pipe given as URDF, SRDF or mesh is refused at once: reading it might never end."""
    if what == "fifo":
        os.mkfifo(tmp_path / "odd")
    odd = what if what != "fifo" else str(tmp_path / "odd")
    with pytest.raises(RobotError, match=f"there is no file {odd!r}"):
        UrdfRobot(name="r", urdf=odd, joints=("j0",), tool="l1").robot()
    with pytest.raises(RobotError, match=f"there is no file {odd!r}"):
        robot(tmp_path / "r.urdf", chain(1), srdf=odd).robot()
    collision = f'<link name="l0"><collision><geometry><mesh filename="{odd}"/></geometry></collision></link>'
    with pytest.raises(RobotError, match=f"there is no file {odd!r}"):
        robot(tmp_path / "r.urdf", chain(1).replace('<link name="l0"/>', collision)).robot()


@pytest.mark.parametrize("ending", ["urdf", "srdf", "dae"])
def test_what_is_shipped_is_far_from_the_bounds(ending):
    """Every description and mesh of example-robot-data is less than a fifth as deep as the bound."""

    def depth(element) -> int:
        return 1 + max(map(depth, element), default=0)

    files = sorted(SHARE.rglob(f"*.{ending}"))
    assert len(files) > 5 and max(depth(read_xml(file)) for file in files) < DEEPEST / 5


def test_the_command_line_says_it_in_one_line(tmp_path):
    """The command that plans with a robot 5000 links long ends in one line and status 1, not in a crash."""
    robot(tmp_path / "r.urdf", chain(5000))
    (tmp_path / "p.yaml").write_text(
        "robot: {kind: urdf, parameters: {name: r, urdf: r.urdf, joints: [j0], tool: l1}}\n"
        "constraints: [{kind: height, value: 0.0}]\nstart: {joints: {}}\ngoal: {joints: {j0: 1.0}}\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, str(root / "stages" / "plan.py"), "problem=p.yaml", "output=out"], cwd=tmp_path, text=True,
        env={**os.environ, "PYTHONPATH": str(root)}, capture_output=True,
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.startswith("RobotError: ") and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
