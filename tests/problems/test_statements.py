"""The same problem said in two ways has the same verdict; what is not taken to the letter is said."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import yaml

from pipeline.errors import ProblemError
from pipeline.planning import solve
from pipeline.planning.output import write_solution
from pipeline.problems import read_problem
from pipeline.problems.build import build
from pipeline.recording import read_recording
from pipeline.robots import Validity
from tests.robots.named import named

ROOT = Path(__file__).parents[2]
UPRIGHT = ROOT / "examples" / "upright_panda.yaml"


def listed(*order: int) -> dict:
    """Panda with its joints listed in another order."""
    panda = yaml.safe_load((ROOT / "conf" / "robot" / "panda.yaml").read_text())
    panda["parameters"]["joints"] = [panda["parameters"]["joints"][i] for i in order]
    return panda


def test_joints_in_another_order(tmp_path):
    """With `joints` listed backwards, start, path, files and recording are all in that order, of the same robot."""
    plain, order = build(read_problem(UPRIGHT)), [6, 5, 4, 3, 2, 1, 0]
    start = {"pose": None, "configuration": plain.starts[0][order].tolist()}
    found = solve(read_problem(UPRIGHT, robot=listed(*order), start=start, time_limit=60.0))
    assert found.solved
    robot, tool = found.built.robot, plain.robot.tool
    names = [f"panda_joint{i + 1}" for i in order]
    np.testing.assert_array_equal(found.built.starts[0][order], plain.starts[0])
    assert plain.constraint.distance(found.path[-1][order]) < 1e-3
    for q in found.path[::20]:
        assert robot.pose(q, tool).isApprox(plain.robot.pose(q[order], tool), 1e-9)
        assert plain.exact.free(q[order])
    summary = write_solution(found, tmp_path / "out", picture=False)
    frame = pd.read_csv(tmp_path / "out" / "path.csv")
    assert list(frame.columns) == ["time_s", *names] and summary["joints"] == names
    np.testing.assert_allclose(frame.to_numpy()[:, 1:], found.path, atol=1e-9)
    stored = read_recording(tmp_path / "out" / "recording.mcap")
    assert stored.joint_names == tuple(names)
    np.testing.assert_allclose(stored.states, found.path, atol=1e-12)
    with pytest.raises(ProblemError, match="joint panda_joint7 is 9"):
        build(
            read_problem(
                UPRIGHT, robot=listed(*order), start={**start, "configuration": [9.0, *start["configuration"][1:]]}
            )
        )


def test_a_door_with_joints_in_another_order():
    """A chain's values come after the joints as they are listed, and the door opens as far."""
    order = [3, 0, 6, 1, 5, 2, 4]
    found = solve(read_problem(ROOT / "examples" / "door_panda.yaml", robot=listed(*order), time_limit=60.0))
    assert found.solved
    assert found.built.robot.joint_names[:8] == (*(f"panda_joint{i + 1}" for i in order), "door_0_yaw")
    assert found.path[-1][7] == pytest.approx(-0.8, abs=1e-3)


GOALS = {
    "angles turns later": {"roll": np.pi - 2 * np.pi, "pitch": 4 * np.pi},
    "the other angles": {"roll": 0.0, "pitch": np.pi},
    "from a frame on its side": {"roll": 0.0, "pitch": np.pi / 2, "x": [-0.3, -0.3], "y": 0.35, "z": [0.45, 0.65],
                                 "origin": {"rpy": [0.0, np.pi / 2, 0.0]}},
}  # fmt: skip


@pytest.mark.parametrize("words", GOALS)
def test_a_goal_in_other_words(words):
    """A goal region said in other words is as reachable, and its configurations are in the region as first said."""
    plain = read_problem(UPRIGHT)
    region = plain.goal.region.region()
    built = build(read_problem(UPRIGHT, goal={"region": GOALS[words]}))
    assert len(built.goals) == 10
    for q in built.goals:
        T = built.robot.pose(q, built.robot.tool)
        assert np.abs(region.displacement(T)[:3]).max() < 1.1e-3
        assert np.arccos(-T.rotation[2, 2]) < 2e-3  # the hand's z axis is down


def test_a_constraint_beyond_a_quarter_turn():
    """A hand that is kept at a pitch of 2, or at one of a quarter turn, is planned for as any other, and is there."""
    for pitch in (2.0, np.pi / 2):
        constraint = {"kind": "region", "roll": 0.0, "pitch": pitch}
        place, free = {"x": [0.3, 0.5], "z": [0.3, 0.6]}, {"roll": None, "pitch": None}
        ends = {
            "start": {"pose": None, "region": {**place, "y": [-0.4, -0.2]}},
            "goal": {"region": {**place, **free, "y": [0.2, 0.4]}},
        }
        found = solve(read_problem(UPRIGHT, constraints=[constraint], obstacles=[], grasps=[], time_limit=60.0, **ends))
        assert found.solved
        for q in found.path[::10]:
            down = found.built.robot.pose(q, found.built.robot.tool).rotation[2]
            wanted = (pin.utils.rotate("y", pitch))[2]
            assert np.arccos(np.clip(down @ wanted, -1, 1)) < 1.1e-3


def test_a_rounding_beyond_a_limit_is_taken_at_it():
    """A start or goal a rounding beyond a limit is at the limit, which is said; farther beyond it is refused."""
    file = read_problem(UPRIGHT, obstacles=[], grasps=[])
    q = build(file).starts[0].copy()
    limit = build(file).robot.upper[6]
    q[6] = limit
    for end in ("start", "goal"):
        given = {"pose": None, "region": None, "configuration": [*q[:6], limit + 1e-9]}
        built = build(read_problem(UPRIGHT, obstacles=[], grasps=[], **{end: given}))
        assert (built.starts if end == "start" else built.goals)[0][6] == limit
        (note,) = built.notes
        assert note.startswith(f"{end}: joint panda_joint7 is 2.8973000") and note.endswith("taken at the limit")
        with pytest.raises(ProblemError, match=rf"{end}: joint panda_joint7 is 2\.89731, outside .*, 2\.8973\]"):
            build(
                read_problem(
                    UPRIGHT, obstacles=[], grasps=[], **{end: {**given, "configuration": [*q[:6], limit + 1e-5]}}
                )
            )
    with pytest.raises(ProblemError, match=r"goal: joint panda_joint1 is 3, outside its limits"):
        build(read_problem(UPRIGHT, goal={"region": None, "values": {"panda_joint1": 3.0}}))
    with pytest.raises(ProblemError, match=r"goal: joint panda_joint1 is nan, outside its limits"):
        build(read_problem(UPRIGHT, goal={"region": None, "values": {"panda_joint1": float("nan")}}))


def test_notes_are_in_the_result(tmp_path):
    """What was not taken to the letter stands in the result; nothing does where all was."""
    built = build(read_problem(UPRIGHT))
    assert built.notes == ()
    values = {"panda_joint7": float(built.robot.upper[6]) + 1e-8}
    found = solve(
        read_problem(UPRIGHT, goal={"region": None, "values": values}, obstacles=[], grasps=[], time_limit=1e-3)
    )
    write_solution(found, tmp_path / "out", picture=False)
    (note,) = json.loads((tmp_path / "out" / "result.json").read_text())["notes"]
    assert "panda_joint7" in note


def test_the_margin_is_kept_from_what_conditions_bound():
    """In planning the centre of mass stays `margin` inside of where the condition has it, in the check 0."""
    file = read_problem(ROOT / "examples" / "balance_pholus.yaml", margin=0.03)
    built = build(file)
    assert [c.margin for c in built.validity.conditions] == [0.03] and [c.margin for c in built.exact.conditions] == [
        0.0
    ]
    (condition,) = built.validity.conditions
    q = built.starts[0]
    assert condition.slack(q).min() > 0.03 and not condition.kept(condition.slack(q).min() + 1e-6).holds(q)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-1, -1, -1)])
def test_a_negative_scale_mirrors_a_mesh(signs, tmp_path):
    """A mesh of a problem file at a negative scale is as far from the robot as the box that it is then."""
    corners = [(x, y, z) for x in (0.1, 0.3) for y in (0.2, 0.5) for z in (0.0, 0.4)]
    quads = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    faces = [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in quads]
    (tmp_path / "box.obj").write_text("\n".join(["v {} {} {}".format(*corner) for corner in corners] + faces))
    middle = [float(sign * value) for sign, value in zip(signs, (0.2, 0.35, 0.2), strict=True)]
    mesh = {"name": "it", "shape": "mesh", "file": "box.obj", "size": list(signs), "xyz": [0.5, 0.0, 0.5]}
    box = {
        "name": "it",
        "shape": "box",
        "size": [0.2, 0.3, 0.4],
        "xyz": [m + at for m, at in zip(middle, (0.5, 0, 0.5), strict=True)],
    }
    found = []
    for one in (mesh, box):
        (tmp_path / "p.yaml").write_text(yaml.safe_dump({**yaml.safe_load(UPRIGHT.read_text()), "obstacles": [one]}))
        scene = [body.obstacle(tmp_path) for body in read_problem(tmp_path / "p.yaml").obstacles]
        found.append(Validity(named("panda"), scene).clearance(named("panda").rest))
    assert found[0] == pytest.approx(found[1], abs=1e-6)
