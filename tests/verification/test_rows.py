"""The verifier's equations: those of planning for every kind of a problem file, and regions by brute force."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from arms import PANDA
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from pipeline.constraints import TaskSpaceRegion, sphere_constraint
from pipeline.constraints.torus import torus_constraint
from pipeline.errors import ConfigError, RobotError
from pipeline.problems import read_problem
from pipeline.problems.build import build, statement_of
from pipeline.problems.file import ProblemFile, Where
from pipeline.problems.parts import PARTS
from pipeline.robots import Placement, point_robot
from pipeline.spec.statement import (
    Balanced,
    InRegion,
    Level,
    OnLine,
    OnSphere,
    OnTorus,
    Point,
    Posed,
    Region,
    Statement,
)
from pipeline.tasks import set_up
from pipeline.verification.kinematics import turns
from pipeline.verification.reader import place, read
from pipeline.verification.rows import Rows, rotation_vectors

EXAMPLES = Path(__file__).parents[2] / "examples"
INF = np.inf
TCP = "panda_hand_tcp"


def near_and_far(constraint, robot, rng: np.random.Generator) -> np.ndarray:
    """Configurations on the manifold, beside it by 1e-4 to 0.3, and anywhere (N, n)."""
    anywhere = rng.uniform(robot.lower, robot.upper, (40, robot.dimension))
    Q, converged = constraint.project_batch(anywhere)
    on = Q[converged]
    assert len(on)
    moved = rng.normal(size=on.shape) * 10 ** rng.uniform(-4, -0.5, (len(on), 1))
    return np.vstack([on, on + moved, anywhere])


@pytest.mark.parametrize("example", sorted(path.stem for path in EXAMPLES.glob("*.yaml")))
def test_examples_have_the_rows_of_planning(example):
    """||F|| of every example is planning's, on the manifold, beside it and far away; so are the conditions' points."""
    file = read_problem(EXAMPLES / f"{example}.yaml", goals=1)
    built = build(file)
    statement = statement_of(file)
    rows = Rows(statement, read(statement))
    Q = near_and_far(built.constraint, built.robot, np.random.default_rng(0))
    ours = np.linalg.norm(rows.values(Q), axis=1)
    theirs = np.linalg.norm(built.constraint.value_batch(Q), axis=1)
    assert np.abs(ours - theirs).max() < 1e-9
    assert statement.tolerance == built.constraint.tolerance
    assert len(statement.conditions) == sum(entry["kind"] == "balance" for entry in file.constraints)


LEFT_OPEN = [
    {"kind": "upright", "direction": None, "axis": [0.3, 0.2, 1.0]},
    {"kind": "plane", "normal": [1.0, 2.0, 2.0]},
    {"kind": "height"},
    {"kind": "line", "direction": [0.0, 3.0, 4.0]},
    {"kind": "position", "frame": "panda_link6"},
    {"kind": "pose"},
    {"kind": "closed_chain", "frame": "panda_link2", "other": "panda_link7"},
    {"kind": "feet", "frames": ["panda_link5"]},
    {"kind": "region", "x": 0.4, "roll": 3.141592653589793, "pitch": 0.0, "origin": {"xyz": [0.0, 0.1, 0.2]}},
    {"kind": "pose", "placement": {"xyz": [0.4, 0.1, 0.5], "rpy": [3.0, 0.2, 0.1]}},
]


@pytest.mark.parametrize("entry", LEFT_OPEN, ids=lambda entry: entry["kind"])
def test_what_is_left_open_is_that_of_the_start(entry):
    """What entries leave open is that of the start by the verifier's kinematics, and both sides have the same rows."""
    start = [0.1, -0.6, -0.2, -2.3, 0.1, 1.7, 0.5]
    whole = ProblemFile("panda", Where(configuration=tuple(start)), Where(joints={}), (entry,))
    robot = PANDA.robot()
    statement = statement_of(whole)
    constraint = set_up(statement).constraint
    values = Rows(statement, read(statement)).values
    Q = np.vstack([start, np.random.default_rng(1).uniform(robot.lower, robot.upper, (40, 7))])
    theirs = np.linalg.norm(constraint.value_batch(Q), axis=1)
    ours = np.linalg.norm(values(Q), axis=1)
    assert np.abs(ours - theirs).max() < 1e-9
    assert ours[0] < 1e-9 or entry["kind"] == "region" or "placement" in entry


def test_every_kind_is_known():
    """All kinds of constraints that a problem file has are among those tested here, and balance in its example."""
    assert set(PARTS) == {entry["kind"] for entry in LEFT_OPEN} | {"balance"}


def test_balance_left_open():
    """The points of a balance are where the feet are at the start."""
    file = read_problem(EXAMPLES / "balance_pholus.yaml", goals=1)
    built = build(file)
    (term,) = statement_of(file).conditions
    assert isinstance(term, Balanced)
    frames = next(entry["frames"] for entry in file.constraints if entry["kind"] == "balance")
    points = [built.robot.pose(built.starts[0], frame).translation for frame in frames]
    assert np.abs(np.array(term.points) - points).max() < 1e-6


def smallest_turn(R: np.ndarray, fixed: tuple[bool, ...], angles: np.ndarray) -> float:
    """The smallest angle from an orientation to any with the fixed angles, over the free ones, by search."""
    free = [i for i in range(3) if not fixed[i]]

    def off(values: np.ndarray) -> float:
        at = np.array(angles, float)
        at[free] = values
        yaw_pitch_roll = Rotation.from_euler("ZYX", at[::-1])
        return float((yaw_pitch_roll.inv() * Rotation.from_matrix(R)).magnitude())

    if not free:
        return off(np.zeros(0))
    grid = np.array(list(product(np.linspace(-np.pi, np.pi, 13)[:-1], repeat=len(free))))
    begins = grid[np.argsort([off(values) for values in grid])[:4]]
    options = {"xatol": 1e-9, "fatol": 1e-9, "maxiter": 2000}
    return min(float(minimize(off, begin, method="Nelder-Mead", options=options).fun) for begin in begins)


@pytest.mark.parametrize("fixed", [f for f in product((True, False), repeat=3) if any(f)])
@pytest.mark.parametrize("pitch", [0.4, 2.0, -2.5, np.pi / 2, -np.pi / 2, 7.0])
def test_regions_by_brute_force(fixed, pitch):
    """The rows of fixed angles are as long as the smallest turn that meets them, beyond a quarter turn of pitch too."""
    rng = np.random.default_rng(2)
    angles = np.array([rng.uniform(-4, 4), pitch, rng.uniform(-4, 4)])
    bounds = [
        (0.1, 0.1),
        (-INF, INF),
        (-0.2, -0.2),
        *((a, a) if f else (-INF, INF) for a, f in zip(angles, fixed, strict=True)),
    ]
    lower, upper = zip(*bounds, strict=True)
    origin, end = Placement((0.3, 0.1, 0.5), (0.4, -0.3, 1.0)), Placement((0.0, 0.1, 0.2), (1.0, 0.5, -0.4))
    statement = Statement(PANDA, (InRegion(TCP, Region(lower, upper, origin, end)),), 1e-3)
    kinematics = read(statement)
    Q = rng.uniform(kinematics.lower, kinematics.upper, (3, 7))
    rows = Rows(statement, kinematics).values(Q)
    R, p = kinematics.frame_poses(Q, TCP)
    robot = PANDA.robot()
    planned = TaskSpaceRegion(lower, upper, origin, end).constraint(robot, TCP).value_batch(Q)
    assert np.abs(np.linalg.norm(rows, axis=1) - np.linalg.norm(planned, axis=1)).max() < 1e-6
    for t in range(len(Q)):
        inside = Rotation.from_euler("ZYX", origin.rpy[::-1]).inv() * Rotation.from_matrix(R[t])
        turned = inside * Rotation.from_euler("ZYX", end.rpy[::-1]).inv()
        off = np.linalg.inv(np.array(Rotation.from_euler("ZYX", origin.rpy[::-1]).as_matrix())) @ (p[t] - origin.xyz)
        off = off - turned.apply(end.xyz)
        assert rows[t, :2] == pytest.approx([off[0] - 0.1, off[2] + 0.2], abs=1e-12)
        assert np.linalg.norm(rows[t, 2:]) == pytest.approx(smallest_turn(turned.as_matrix(), fixed, angles), abs=2e-5)


def test_sphere_and_torus():
    """A point's distance from the sphere and from the torus is that of planning's constraints, and of closed forms."""
    Q = np.random.default_rng(3).uniform(-3, 3, (50, 3))
    robot = point_robot(0.001, [-3.5] * 3, [3.5] * 3)
    said = {
        OnSphere("point", 1.2): sphere_constraint(robot, "point", 1.2),
        OnTorus(2.0, 1.0): torus_constraint(robot, "point"),
    }
    for saying, constraint in said.items():
        statement = Statement(Point(0.001, (-3.5,) * 3, (3.5,) * 3), (saying,), 1e-3)
        assert np.abs(Rows(statement, read(statement)).values(Q) - constraint.value_batch(Q)).max() < 1e-12


def test_said_otherwise():
    """A region that fixes all is the pose; one that fixes x and z of a turned frame is the line along its y axis."""
    at = Placement((0.4, 0.1, 0.5), (3.0, 0.2, 0.1))
    fixed, along = (0.0,) * 6, ((0.0, -INF, 0.0, -INF, -INF, -INF), (0.0, INF, 0.0, INF, INF, INF))
    pairs = [
        (Posed(TCP, at), InRegion(TCP, Region(fixed, fixed, at))),
        (OnLine(TCP, at.xyz, tuple(place(at).R[:, 1])), InRegion(TCP, Region(*along, at))),
        (
            Level(TCP, (0, 0, 2), (0, 0, -1)),
            InRegion(TCP, Region((-INF,) * 3 + (np.pi, 0, -INF), (INF,) * 3 + (np.pi, 0, INF))),
        ),
    ]
    kinematics = read(Statement(PANDA, (), 1e-3))
    Q = np.random.default_rng(4).uniform(kinematics.lower, kinematics.upper, (30, 7))
    for pair in pairs:
        one, other = (
            np.linalg.norm(Rows(Statement(PANDA, (saying,), 1e-3), kinematics).values(Q), axis=1) for saying in pair
        )
        assert np.abs(one - other).max() < 1e-9


def test_rotation_vectors():
    """Rotation vectors are scipy's from the identity to half a turn, and turn their axis by their length."""
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(60, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = np.concatenate([np.zeros(1), 10 ** np.linspace(-12, 0, 29), np.pi - 10 ** np.linspace(-9, 0, 30)])
    R = np.array([turns(axis, np.array([angle]))[0] for axis, angle in zip(axes, angles, strict=True)])
    assert np.abs(rotation_vectors(R) - angles[:, None] * axes).max() < 1e-7


def test_refusals():
    """Intervals, regions that fix nothing and frames that do not exist are refused with what is there."""
    kinematics = read(Statement(PANDA, (), 1e-3))
    wide = Region((0, 0, 0, 0, 0, -0.1), (0, 0, 0, 0, 0, 0.1))
    for saying, error, words in (
        (InRegion(TCP, wide), ConfigError, "intervals need a chain"),
        (InRegion(TCP, Region((-INF,) * 6, (INF,) * 6)), ConfigError, "some must be equal"),
        (Level("panda_hand_tpc", (0, 0, 1), (0, 0, 1)), RobotError, TCP),
    ):
        with pytest.raises(error, match=words):
            Rows(Statement(PANDA, (saying,), 1e-3), kinematics)
