"""SRDFs are held against the robots they are used with."""

import logging
import re
from collections import defaultdict
from pathlib import Path

import pytest

from pipeline.errors import RobotError
from pipeline.robots import UrdfRobot, semantics
from pipeline.robots.description import SHARE, read_srdf
from pipeline.robots.semantics import check_semantics
from pipeline.robots.xml import read_xml
from tests.robots.test_xml import chain

URDF = chain(3)


def arm(folder: Path, *pairs: tuple[str, str], state: str = "", **joints: float) -> UrdfRobot:
    """Return a robot of four links, with an SRDF that names pairs of links and joints of a state called home."""
    disabled = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="x"/>' for a, b in pairs)
    values = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in joints.items())
    (folder / "r.urdf").write_text(URDF)
    (folder / "r.srdf").write_text(f'<robot name="r">{disabled}<group_state name="home">{values}</group_state></robot>')
    return UrdfRobot(
        name="r", urdf=str(folder / "r.urdf"), srdf=str(folder / "r.srdf"), joints=("j0",), tool="l3", state=state
    )


@pytest.fixture
def warnings(caplog, monkeypatch):
    """What is logged, as if nothing had been before."""
    semantics._warn_once.cache_clear()
    caplog.set_level(logging.WARNING)
    return lambda: [record.message for record in caplog.records]


def test_names_that_exist_are_taken_in_silence(tmp_path, warnings):
    """An SRDF whose names all exist says what it says, without a word."""
    made = arm(tmp_path, ("l0", "l1"), ("l1", "l3"), state="home", j0=0.5, j1=-0.25).robot()
    assert made.rest.tolist() == [0.5] and warnings() == []


def test_some_that_do_not_exist_are_named_once(tmp_path, warnings):
    """Links, and joints of the state in use, that do not exist are logged with the file and what was meant, once."""
    asked = arm(tmp_path, ("l0", "l1"), ("l1", "lx3"), ("gripper", "l0"), state="home", j0=0.5, jj2=1.0)
    for _ in range(3):
        assert asked.robot().rest.tolist() == [0.5]
    links, joints = warnings()
    assert re.search(
        r"r\.srdf names links that the robot does not have: 'lx3' \(did you mean 'l3'\?\), 'gripper'; ", links
    )
    assert re.search(r"r\.srdf names joints that the robot does not have: 'jj2' \(did you mean 'j2'\?\); ", joints)


def test_a_long_list_is_cut(tmp_path, warnings):
    """Of many links that do not exist five are named and the rest counted."""
    arm(tmp_path, ("l0", "l1"), *((f"finger{i}", "l0") for i in range(40))).robot()
    (said,) = warnings()
    assert said.count("finger") == 5 and "and 35 more" in said


def test_another_robots_srdf_is_refused(tmp_path, warnings):
    """Where no link, or no joint of the state in use, exists, the error names them and those that do."""
    with pytest.raises(RobotError, match=r"r\.srdf names links .* 'panda_link0', 'panda_link1'; .* l0, l1, l2, l3"):
        arm(tmp_path, ("panda_link0", "panda_link1")).robot()
    with pytest.raises(RobotError, match=r"r\.srdf names joints .* 'r/j0' \(did you mean 'j0'\?\); .* j0, j1, j2"):
        arm(tmp_path, ("l0", "l1"), state="home", **{"r/j0": 0.5}).robot()
    assert arm(tmp_path, ("l0", "l1"), **{"r/j0": 0.5}).robot().dimension == 1  # a state that is not used
    assert warnings() == []


def test_every_srdf_that_is_shipped_goes_with_its_robots(warnings):
    """Every SRDF of example-robot-data is taken with every URDF of its robot's name in its folder.

    Some name links that reduced models of their robots lack, which is why that is no error.
    """
    robots = defaultdict(list)
    for path in sorted(SHARE.rglob("*.urdf")):
        root = read_xml(path)
        robots[root.get("name")].append((path, root))
    checked, lacking = 0, set()
    for path in sorted(SHARE.rglob("*.srdf")):
        for urdf, root in robots[read_xml(path).get("name")]:
            if urdf.parents[1] in path.parents:
                before = len(warnings())
                check_semantics(read_srdf(path), path, root)
                checked += 1
                lacking |= {urdf.stem} if len(warnings()) > before else set()
    assert checked > 30 and {"solo", "talos_left_arm", "anymal"} <= lacking and len(lacking) < checked / 4
