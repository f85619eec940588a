"""Malformed problem files end in one clear error each, before anything is planned or written."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.errors import ConfigError, ConstraintError, PipelineError, ProblemError, RobotError
from pipeline.planning import solve
from pipeline.planning.output import check_output, write_solution
from pipeline.problems import read_problem
from pipeline.problems.build import build

ROOT = Path(__file__).parents[2]
GOOD = yaml.safe_load((ROOT / "examples" / "upright_panda.yaml").read_text())
START = {"pose": {"xyz": [0.55, -0.35, 0.27], "rpy": [np.pi, 0.0, 0.0]}}


def changed(**changes):
    """The good problem with entries replaced, or removed where None."""
    return {k: v for k, v in {**GOOD, **changes}.items() if v is not None}


BOX = {"name": "b", "shape": "box", "size": [0.1, 0.1, 0.1], "xyz": [5.0, 0.0, 0.0]}
CASES = {
    "no robot": (changed(robot=None), ConfigError, "lacks robot"),
    "robot unknown": (changed(robot="pandas"), ConfigError, "'pandas' .did you mean 'panda'"),
    "robot of another kind": (changed(robot={"kind": "mjcf"}), ConfigError, "robot is 'mjcf'; choices: urdf"),
    "robot without joints": (
        changed(robot={"kind": "urdf", "parameters": {"urdf": "a", "tool": "t", "name": "n"}}),
        ConfigError,
        "lacks joints",
    ),
    "robot file missing": (
        changed(robot={"kind": "urdf", "parameters": {"urdf": "no.urdf", "joints": ["a"], "tool": "t", "name": "n"}}),
        RobotError,
        "no file 'no.urdf'",
    ),
    "misspelt key": (changed(constrains=[]), ConfigError, "'constrains' .*did you mean 'constraints'.*speed, seed$"),
    "folder": (changed(folder="/"), ConfigError, "unknown key 'folder'"),
    "no start": (changed(start=None), ConfigError, "lacks start"),
    "start empty": (changed(start={}), ConfigError, "this one has none"),
    "start twice": (changed(start={**START, "joints": {}}), ConfigError, "this one has joints, pose"),
    "start short": (
        changed(start={"configuration": [0.0] * 6}),
        ProblemError,
        "start has 6 joint values; 'panda' has 7",
    ),
    "start NaN": (changed(start={"configuration": [float("nan")] * 7}), ProblemError, "must be finite"),
    "start joint unknown": (
        changed(start={"joints": {"panda_joint9": 0.0}}),
        ProblemError,
        "'panda_joint9'.*did you mean",
    ),
    "start outside limits": (
        changed(start={"joints": {"panda_joint1": 4.0}, "project": False}),
        ProblemError,
        "start: joint panda_joint1 is 4, outside its limits",
    ),
    "start off the manifold": (
        changed(start={"joints": {"panda_joint6": 2.5}}),
        ProblemError,
        "off the manifold 'upright",
    ),
    "start in collision": (
        changed(obstacles=[{**BOX, "size": [0.3, 0.3, 0.3], "xyz": [0.55, -0.35, 0.4]}], grasps=[]),
        ProblemError,
        "start: .* none is valid; the first is in collision: .* with b",
    ),
    "goal out of reach": (
        changed(goal={"pose": {"xyz": [2, 0, 0.3], "rpy": [np.pi, 0, 0]}}),
        ProblemError,
        r"goal: inverse kin.* the nearest is 1\.\d+ \(m and rad\) from the target",
    ),
    "goal in millimetres": (
        changed(goal={"pose": {"xyz": [500, 300, 300], "rpy": [np.pi, 0, 0]}}),
        ProblemError,
        "goal: inverse kin.*are these millimetres",
    ),
    "goal in degrees": (
        changed(goal={"region": {"x": 0.5, "y": 0.3, "z": 0.3, "roll": 90, "pitch": 0}}),
        ProblemError,
        "goal: inverse kin.*are these degrees",
    ),
    "start in degrees": (
        changed(start={"joints": {"panda_joint1": 45}}),
        ProblemError,
        "panda_joint1 is 45, outside its limits .*are these degrees",
    ),
    "goal against the constraint": (
        changed(goal={"pose": {"xyz": [0.5, 0.3, 0.4]}}),
        ProblemError,
        "goal: inverse kinematics",
    ),
    "goal value unknown": (changed(goal={"values": {"door": 1.0}}), ProblemError, "goal names a joint .* 'door'"),
    "pose of two numbers": (changed(goal={"pose": {"xyz": [1.0, 2.0]}}), ConfigError, "three finite numbers"),
    "frame unknown": (changed(goal={**START, "frame": "hand"}), RobotError, "no frame 'hand'"),
    "region crossed": (
        changed(goal={"region": {"x": [1.0, 0.0]}}),
        ConstraintError,
        "x of a region has bounds 1.0 and 0.0",
    ),
    "region of words": (changed(goal={"region": {"x": "left"}}), ConfigError, "region.x is 'left'"),
    "height out of reach": (
        changed(constraints=[{"kind": "height", "value": 5.0}], goal={"region": {"x": [0.3, 0.4]}}),
        ConstraintError,
        r"panda_hand_tcp from the plane \[m\] by -",
    ),
    "rows that depend": (
        changed(
            constraints=[{"kind": "height", "value": 0.3}, {"kind": "plane", "point": [0, 0, 0.3]}],
            start={"region": {"x": [0.4, 0.5], "y": 0.0}},
        ),
        ConstraintError,
        "rank 1 of 2",
    ),
    "kind of a list": (changed(constraints=[{"kind": ["upright"]}]), ConfigError, "kind is"),
    "axis of two": (
        changed(constraints=[{"kind": "upright", "axis": [0, 1], "direction": None}], start={"joints": {}}),
        ConstraintError,
        "three finite numbers",
    ),
    "adherence of nothing": (
        changed(adherence={"kind": "projection", "parameters": {"resolution": "x"}}),
        ConfigError,
        "resolution",
    ),
    "constraint without kind": (
        changed(constraints=[{"frame": "panda_hand"}]),
        ConfigError,
        r"constraints\[0\].kind is 'None'",
    ),
    "constraint unknown": (changed(constraints=[{"kind": "uprigth"}]), ConfigError, "did you mean 'upright'"),
    "constraint key": (
        changed(constraints=[{"kind": "upright", "frames": "x"}]),
        ConfigError,
        "'frames'.*did you mean 'frame'",
    ),
    "constraint frame": (changed(constraints=[{"kind": "upright", "frame": "x"}]), RobotError, "no frame 'x'"),
    "constraint zero axis": (
        changed(constraints=[{"kind": "upright", "axis": [0, 0, 0]}]),
        ConstraintError,
        "axis is .* must not be zero",
    ),
    "over-constrained": (
        changed(constraints=[{"kind": "pose", "placement": {}}, {"kind": "height", "value": 1.0}]),
        ConstraintError,
        "7 rows on 7 variables",
    ),
    "left open without a start": (changed(constraints=[{"kind": "height"}]), ConfigError, "height.value is left open"),
    "conditions only": (
        changed(
            robot="pholus",
            constraints=[{"kind": "balance", "frames": ["contact_1"] * 3}],
            start={"joints": {}},
            grasps=[],
        ),
        ConstraintError,
        "span no polygon",
    ),
    "obstacle shape": (changed(obstacles=[{**BOX, "shape": "cone"}]), ConfigError, "shape is 'cone'; choices: box"),
    "obstacle size": (changed(obstacles=[{**BOX, "size": [0.1, -0.1, 0.1]}]), ProblemError, "1 or 3 numbers above 0"),
    "mesh of no size": (
        changed(obstacles=[{**BOX, "shape": "mesh", "size": [1.0, 0.0, 1.0], "file": "a.obj"}]),
        ProblemError,
        "is a scale: it must be 1 or 3 numbers other than 0",
    ),
    "obstacle size of words": (changed(obstacles=[{**BOX, "size": "big"}]), ProblemError, "1 or 3 numbers above 0"),
    "millimetres": (changed(obstacles=[{**BOX, "size": [100, 100, 400]}]), ProblemError, "are these millimetres"),
    "far away": (changed(obstacles=[{**BOX, "xyz": [500.0, 0, 0]}]), ProblemError, "are these millimetres"),
    "obstacle pose": (changed(obstacles=[{**BOX, "xyz": [0, 0, float("inf")]}]), ConfigError, "three finite numbers"),
    "mesh without file": (changed(obstacles=[{**BOX, "shape": "mesh"}]), ProblemError, "mesh 'b' has no file"),
    "mesh missing": (
        changed(obstacles=[{**BOX, "shape": "mesh", "file": "no.stl"}], grasps=[]),
        ProblemError,
        "no mesh",
    ),
    "octree missing": (
        changed(obstacles=[{**BOX, "shape": "octree", "file": "no.csv"}]),
        ProblemError,
        "cannot be read",
    ),
    "grasp without name": (changed(grasps=[{**BOX, "name": ""}]), RobotError, "name of its own"),
    "grasp touches nothing": (
        changed(grasps=[{**BOX, "xyz": [0, 0, 0.1], "touches": ["chair"]}]),
        ProblemError,
        "'chair'; there are: .*bottle",
    ),
    "grasp frame": (changed(grasps=[{**BOX, "frame": "x"}]), RobotError, "no frame 'x'"),
    "chain free": (changed(chain={"regions": [{"yaw": [0, 1]}]}), RobotError, "'chain_0_x' has limits"),
    "planner unknown": (changed(planner="prm"), ConfigError, "planner is 'prm'; there are: .*rrtconnect"),
    "sampler learned": (changed(sampler="compnetx_batch"), ConfigError, "sampler is 'compnetx'; choices: uniform"),
    "FMT* on directions": (changed(planner="fmt"), ConfigError, "draws from the manifold"),
    "adherence of a number": (changed(adherence=3), ConfigError, "adherence is 3"),
    "time limit": (changed(time_limit=0.0), ConfigError, "time_limit is 0.0 s"),
    "margin": (changed(margin=-0.01), ConfigError, "margin is -0.01 m"),
    "speed": (changed(speed=2.0), ConfigError, "speed is 2.0; it must be at least 0.001 and at most 1"),
    "speed of nothing": (changed(speed=1e-12), ConfigError, "speed is 1e-12"),
    "goals": (changed(goals=0), ConfigError, "goals is 0"),
    "goals without end": (
        changed(goals=10**9),
        ConfigError,
        "goals is 1000000000; it must be at least 1 and at most 100",
    ),
    "spacing too fine": (changed(spacing=1e-9), ConfigError, "spacing is 1e-09; it must be at least 0.0001"),
    "names twice": (changed(obstacles=[BOX, BOX]), ConfigError, "'b' more than once"),
    "goal anywhere": (changed(goal={"region": {}}), ConfigError, "has region that say nothing"),
    "goal anywhere from a frame": (
        changed(goal={"region": {"x": [-np.inf, np.inf], "origin": {"xyz": [9, 9, 9]}}}),
        ConfigError,
        "has region that say nothing",
    ),
    "goal of no values": (changed(goal={"values": {}}), ConfigError, "has values that say nothing"),
    "seed": (changed(seed=-1), ConfigError, "seed is -1"),
    "a list": ([1, 2], ProblemError, "holds a list"),
    "nothing": (None, ProblemError, "holds nothing"),
}


@pytest.mark.parametrize("case", CASES)
def test_malformed_problem(case, tmp_path):
    """Each is refused by its own message, naming the value and the choices or bounds."""
    content, kind, message = CASES[case]
    path = tmp_path / "problem.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(kind, match=message):
        solve(read_problem(path))


@pytest.mark.parametrize("text", ["a: [", "\x00", "a: &a [*a]\n? [*b]", "- {", "%YAML 9"], ids=range(5))
def test_no_yaml(text, tmp_path):
    """What is no YAML is refused as that, or as no problem."""
    path = tmp_path / "problem.yaml"
    path.write_text(text)
    with pytest.raises(PipelineError):
        read_problem(path)


def test_missing_file():
    """A problem file that does not exist is named."""
    with pytest.raises(ProblemError, match=r"nowhere\.yaml cannot be read"):
        read_problem("nowhere.yaml")


def test_fuzzed_files(tmp_path):
    """Files with bytes changed at random are solved or refused, never anything else."""
    rng, good = np.random.default_rng(0), (ROOT / "examples" / "upright_panda.yaml").read_bytes()
    path, refused = tmp_path / "problem.yaml", 0
    for _ in range(150):
        text = bytearray(good)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(text)))
            if rng.random() < 0.5:
                text[at] = int(rng.integers(32, 127))
            else:
                del text[at : at + int(rng.integers(1, 9))]
        path.write_bytes(bytes(text))
        try:
            solve(read_problem(path, time_limit=0.2))
        except PipelineError:
            refused += 1
    assert refused > 30


JUNK = (None, True, -1, 0, 1e-12, float("nan"), float("inf"), "x", [], [1, 2], {}, {"kind": 3})


@pytest.mark.parametrize("group", ["planner", "sampler", "adherence", "robot"])
def test_fuzzed_settings(group):
    """Settings with one value replaced by junk plan or are refused, never anything else; most of it is refused."""
    name = {"robot": "panda", "planner": "rrtconnect_arm", "sampler": "directions", "adherence": "atlas_arm"}[group]
    good = yaml.safe_load((ROOT / "conf" / group / f"{name}.yaml").read_text())
    example, refused, asked = ROOT / "examples" / "upright_panda.yaml", 0, 0
    for key in good["parameters"]:
        for junk in JUNK:
            content = {**good, "parameters": {**good["parameters"], key: junk}}
            asked += 1
            try:
                solve(read_problem(example, time_limit=0.05, shortcuts=2, **{group: content}))
            except PipelineError as error:
                refused += 1
                assert str(error)
    assert refused > asked / 2


def test_time_limit_holds_for_shortcuts_too():
    """Shortcuts without end stop with the time limit; only the last check of the path comes after it."""
    found = solve(read_problem(ROOT / "examples" / "upright_panda.yaml", time_limit=0.3, shortcuts=10**9))
    assert found.solved and found.setup > 0 and found.seconds < 5.0


def test_failure_names_bodies_in_contact():
    """Where nothing is found, the summary names what is in contact at many configurations: a post before the arm."""
    box = {"name": "post", "shape": "box", "size": [0.1, 0.1, 1.2], "xyz": [0.18, 0.0, 0.6]}
    content = {"obstacles": [*GOOD["obstacles"], box], "grasps": [], "time_limit": 1e-6}
    pairs = solve(read_problem(ROOT / "examples" / "upright_panda.yaml", **content)).summary()["often_in_contact"]
    assert any("with post" in pair for pair in pairs) and all(0.1 < share <= 1 for share in pairs.values())


def test_a_robot_beside_its_problem(tmp_path):
    """Files and packages of a robot are found from the problem's folder."""
    urdf = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><joint name="one" type="revolute">
      <parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
      <limit lower="-3" upper="3" velocity="1" effort="0"/></joint>
      <joint name="two" type="revolute"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
      <limit lower="-3" upper="3" velocity="1" effort="0"/></joint></robot>"""
    for folder in ("mine/problems", "mine/packages/p"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "r.urdf").write_text(urdf)
    content = {
        "constraints": [{"kind": "plane", "point": [0.5, 0, 0], "normal": [1, 0, 0]}],
        "start": {"values": {"one": -1.0471975511965976}},
        "goal": {"values": {"one": 1.0471975511965976}},
    }
    path = tmp_path / "mine" / "problems" / "problem.yaml"

    def robot(uri: str, *package_dirs: str) -> dict:
        given = {"name": "r", "urdf": uri, "joints": ["one", "two"], "tool": "c", "package_dirs": list(package_dirs)}
        return {"robot": {"kind": "urdf", "parameters": given}}

    for found in (robot("r.urdf"), robot("package://p/r.urdf", "../packages")):
        path.write_text(yaml.safe_dump({**content, **found}))
        assert build(read_problem(path)).robot.dimension == 2
    for missing in ("s.urdf", "s" * 300):
        path.write_text(yaml.safe_dump({**content, **robot(missing)}))
        with pytest.raises(RobotError, match=f"no file '{missing}'; looked for .*mine/problems/{missing}"):
            build(read_problem(path))


@pytest.mark.parametrize("place", ["file", "file/out", "/proc/out", "/", ".", "o" * 300])
def test_an_output_that_cannot_be_written(place, tmp_path, monkeypatch):
    """A file, what is below one, the folder this runs in, what the system does not let be: refused, all untouched."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(ConfigError, match=r"output is .* (cannot be written|is a file|cannot be replaced)"):
        check_output(Path(place) if place == "." else tmp_path / place)
    assert (tmp_path / "file").read_text() == "mine" and sorted(p.name for p in tmp_path.iterdir()) == ["file", "here"]


def test_an_output_behind_a_link(tmp_path):
    """A link to an empty folder stays one; the result is where it points."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_solution(
        solve(read_problem(ROOT / "examples" / "line_sawyer.yaml", time_limit=60.0)), tmp_path / "link", False
    )
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real" / "path.csv").is_file()


def command(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "stages/plan.py", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=300
    )


def test_command_writes_a_result(tmp_path):
    """The command of the README solves an example and writes its files; entries can be changed on the command line."""
    out = tmp_path / "out"
    done = command("problem=examples/line_sawyer.yaml", f"output={out}", "picture=false", "+changes.seed=3")
    assert done.returncode == 0, done.stderr
    assert "status: solved" in done.stdout
    assert {p.name for p in out.iterdir()} == {"result.json", "path.csv", "recording.mcap", "layout.json"}


def test_command_leaves_nothing_half_written(tmp_path):
    """A problem that is refused ends with one line and status 1, and no output; a folder of others is not replaced."""
    bad = tmp_path / "bad.yaml"
    bad.write_text(yaml.safe_dump(changed(robot="pandas")))
    done = command(f"problem={bad}", f"output={tmp_path / 'out'}")
    assert done.returncode == 1 and done.stderr.startswith("ConfigError: robot is 'pandas'")
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "out").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    done = command("problem=examples/line_sawyer.yaml", f"output={tmp_path / 'mine'}")
    assert done.returncode == 1 and "thesis.txt" in done.stderr
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
    done = command()
    assert done.returncode == 1 and "name a problem and an output" in done.stderr
