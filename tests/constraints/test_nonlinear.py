"""Nonlinear programs over target sets, against Gauss-Newton, closed forms, SLSQP and pinocchio."""

import time

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

from pipeline.constraints import (
    Constraint,
    TaskSpaceRegion,
    balanced,
    closed_chain,
    feet_on_ground,
    height,
    intersection,
    line,
    plane,
    pose,
    position,
    sphere_constraint,
    upright,
)
from pipeline.constraints import ipopt as ipopt_module
from pipeline.constraints import structure as structure_module
from pipeline.constraints.cone import cone
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.nonlinear import NonlinearProgram
from pipeline.constraints.targets import at_pose, in_region, with_values
from pipeline.errors import ConstraintError
from pipeline.robots import Placement
from pipeline.robots.model import point_robot
from tests.robots.named import configurations, named

BOTH = [InverseKinematics, NonlinearProgram]
PANDA = named("panda")
INF = np.inf
DOWN = (0, 0, -1)


def arm(name: str):
    """An arm with its hand down at a pose near by, which is exactly down; and a configuration to begin with."""
    robot = named(name)
    constraint = upright(robot, robot.tool, direction=DOWN)
    begin = constraint.project(robot.rest if robot.rest is not None else np.full(robot.dimension, 0.5)).q
    T = robot.pose(begin, robot.tool)
    wanted = pin.SE3(pin.utils.rotate("z", 0.3) @ T.rotation, T.translation + np.array([0.02, 0.04, -0.03]))
    return robot, [constraint], at_pose(robot, robot.tool, wanted), begin


def tray(name: str):
    """Two arms with a tray, eight rows on fourteen variables, which goes into a box."""
    robot = named(name)
    relative = robot.pose(robot.rest, "left_gripper").actInv(robot.pose(robot.rest, "right_gripper"))
    T = robot.pose(robot.rest, "left_gripper")
    region = TaskSpaceRegion(
        (0.02, -0.1, 0.05, *[-INF] * 3), (0.08, 0.1, 0.1, *[INF] * 3), Placement(tuple(T.translation))
    )
    level = upright(robot, "left_gripper", direction=tuple(T.rotation[:, 2]))
    both = [closed_chain(robot, "left_gripper", "right_gripper", relative), level]
    return robot, both, in_region(robot, "left_gripper", region), robot.rest


CASES = {"panda": arm, "ur5": arm, "kinova": arm, "baxter_both": tray}


@pytest.mark.parametrize("name", CASES)
def test_both_solvers_meet_the_same_targets(name):
    """From starts near by both arrive on all constraints and within limits, and the program's ends are as near."""
    robot, constraints, target, begin = CASES[name](name)
    newton, program = (kind(robot, constraints, target) for kind in BOTH)
    rng, met = np.random.default_rng(0), 0
    for _ in range(8):
        start = np.clip(begin + 0.05 * rng.normal(size=robot.dimension), robot.lower, robot.upper)
        rough, best = newton.solve(start), program.solve(start)
        if rough is None or best is None:
            continue
        met += 1
        for q in (rough, best):
            assert all(constraint.satisfied(q) for constraint in constraints)
            assert ((q >= robot.lower) & (q <= robot.upper)).all()
            assert InverseKinematics(robot, constraints, target).solve(q) is not None
        assert np.linalg.norm(best - start) < np.linalg.norm(rough - start) + 1e-3
    assert met >= 7


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_many_starts_arrive_by_either(name):
    """From anywhere they find about as many solutions, where pinocchio has the hand; turning joints are canonical."""
    robot, constraints, target, begin = CASES[name](name)
    counts = []
    for kind in BOTH:
        found = list(kind(robot, constraints, target).solutions(np.random.default_rng(1), 24, begin))
        counts.append(len(found))
        places = np.array([robot.pose(q, robot.tool).translation for q in found])
        assert np.linalg.norm(places - places.mean(axis=0), axis=1).max() < 3e-3
        if robot.turns is not None:
            assert np.abs(np.array(found)[:, robot.turns.places]).max() <= np.pi
    assert min(counts) > 6 and counts[1] > 0.7 * counts[0]


BALL = point_robot(0.01, (-2, -2, -2), (2, 2, 0.5))


def test_nearest_point_of_a_sphere():
    """It is the radial projection, or, where that is above a limit, the nearest point of the circle at the limit."""
    program = NonlinearProgram(BALL, sphere_constraint(BALL, "point", 1.0))
    for guess in np.random.default_rng(0).uniform(-1.5, 1.5, (30, 3)):
        nearest = guess / np.linalg.norm(guess)
        if nearest[2] > 0.5:
            nearest = np.r_[np.sqrt(0.75) * guess[:2] / np.linalg.norm(guess[:2]), 0.5]
        np.testing.assert_allclose(program.solve(guess), nearest, atol=1e-4)


def kept(robot, constraint, q) -> bool:
    """Whether a configuration is within limits and half the tolerance, as target sets promise."""
    within = ((q >= robot.lower) & (q <= robot.upper)).all()
    return bool(within) and constraint.satisfied(q) and constraint.distance(q) <= constraint.tolerance / 2


@pytest.mark.parametrize("limit", [1.0, 100.0, 1e4])
def test_ends_on_limits_are_within_the_tolerance(limit):
    """Where a plane's nearest point is on limits it is found, to tight tolerances too, however large limits are."""
    robot, q = point_robot(0.01, (-limit,) * 3, (limit,) * 3), ca.SX.sym("q", 3)
    for tolerance in (1e-3, 1e-5, 1e-7):
        for total, guess, nearest in ((1.5, (2.0, 0.0, 3.0), (1, 0.5, 1)), (-2.0, (0.0, 0.1, -0.2), (-1, -1, -0.2))):
            constraint = Constraint("plane", q, q[0] + q[1] - total * limit, tolerance)
            found = NonlinearProgram(robot, constraint).solve(limit * np.array(guess))
            assert kept(robot, constraint, found)
            np.testing.assert_allclose(found, limit * np.array(nearest), atol=1e-3 * limit)


def test_tight_tolerances_of_an_arm():
    """Of an arm, a third of whose solutions are on limits, all are within 1e-8, and nearly every start arrives."""
    constraint = upright(PANDA, PANDA.tool, direction=DOWN, tolerance=1e-8)
    found = list(NonlinearProgram(PANDA, constraint).solutions(np.random.default_rng(0), 30))
    at_limit = [min((q - PANDA.lower).min(), (PANDA.upper - q).min()) < 1e-6 for q in found]
    assert len(found) > 25 and sum(at_limit) > 5
    assert all(kept(PANDA, constraint, q) for q in found)


def test_what_is_judged_is_what_is_returned(monkeypatch):
    """Where IPOPT ends beyond a limit, the configuration at the limit is judged: it is on the manifold, or is none."""
    structure_module.forget()
    monkeypatch.setitem(ipopt_module._OPTIONS, "ipopt.bound_relax_factor", 1e-3)
    robot, q = point_robot(0.01, (-1,) * 3, (1,) * 3), ca.SX.sym("q", 3)
    ends = []
    for slope in (0.1, 1.0):
        constraint = Constraint("plane", q, slope * (q[0] - 1) + q[1] - 0.5, tolerance=1e-4)
        ends.append(NonlinearProgram(robot, constraint).solve(np.array([2.0, 0.5, 0.0])))
        assert ends[-1] is None or kept(robot, constraint, ends[-1])
    assert [end is None for end in ends] == [False, True]
    structure_module.forget()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_any_objective(scale):
    """A linear objective is least on a sphere against its direction; within the tolerance, whatever its scale."""
    direction = np.array([0.4, -0.7, 0.3])

    def objective(q, guess, p):
        return scale * ca.dot(p(direction), q)

    constraint = sphere_constraint(BALL, "point", 1.0)
    q = NonlinearProgram(BALL, constraint, objective=objective).solve(np.array([0.1, 0.2, -0.9]))
    np.testing.assert_allclose(q, -direction / np.linalg.norm(direction), atol=1e-3)
    assert constraint.satisfied(q)


def test_optimum_is_that_of_slsqp():
    """From the same starts SLSQP ends at the same least distance on an arm, with limits and a condition that act."""
    robot = named("panda")
    constraint = position(robot, robot.tool, (0.45, 0.2, 0.35))
    condition = cone(robot, robot.tool, 0.2, direction=DOWN)
    program = NonlinearProgram(robot, constraint, conditions=[condition])
    rng, acting, same = np.random.default_rng(2), 0, 0
    for _ in range(8):
        guess = np.clip(robot.rest + 0.4 * rng.normal(size=7), robot.lower, robot.upper)
        q = program.solve(guess)
        other = minimize(
            lambda x, guess=guess: ((x - guess) ** 2).sum(),
            guess,
            jac=lambda x, guess=guess: 2 * (x - guess),
            bounds=list(zip(robot.lower, robot.upper, strict=True)),
            constraints=[
                {"type": "eq", "fun": constraint.value, "jac": constraint.jacobian},
                {"type": "ineq", "fun": condition.slack, "jac": condition.jacobian},
            ],
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 300},
        )
        if q is None or not other.success:
            continue
        acting += condition.slack(q)[0] < 1e-4
        same += abs(np.linalg.norm(q - guess) - np.sqrt(other.fun)) < 1e-3
        assert condition.holds(q)
    assert same >= 6 and acting >= 4


def test_gradient_is_normal_at_an_optimum():
    """Where nothing but equations acts the objective's gradient is a combination of their rows (Lagrange)."""
    robot = named("ur5")
    constraint = height(robot, robot.tool, 0.3)
    program = NonlinearProgram(robot, constraint)
    for guess in configurations(robot, np.random.default_rng(0), 5) / 4:
        q = program.solve(guess)
        tangents, _ = constraint.frame(q)
        assert np.linalg.norm(q - guess) > 0.01
        assert np.linalg.norm(tangents.T @ (q - guess)) < 1e-4 * np.linalg.norm(q - guess)


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("more", [(), (((0, 0, 0), (0.6, -0.8, 0)),), (((0, 0, 0.2), (0, 0, 1)),) * 2])
def test_intersection_with_as_many_rows_as_variables(kind, more):
    """A sphere meets a line in two points, also where planes say so again; no `Constraint` has so many rows."""
    robot = point_robot(0.01, (-2, -2, -2), (2, 2, 2))
    parts = [sphere_constraint(robot, "point", 1.0), line(robot, "point", (0, 0, 0.2), (0.8, 0.6, 0))]
    parts += [plane(robot, "point", *one) for one in more]
    with pytest.raises(ConstraintError, match="0 < rows < variables"):
        intersection(*parts)
    found = np.array(list(kind(robot, parts).solutions(np.random.default_rng(0), 20)))
    point = np.sqrt(0.96) * np.array([0.8, 0.6, 0.0])
    ends = np.array([point, -point]) + np.array([0, 0, 0.2])
    apart = np.linalg.norm(found[:, None] - ends, axis=2)  # (m, 2)
    assert len(found) > 15 and apart.min(axis=1).max() < 2e-3 and set(apart.argmin(axis=1)) == {0, 1}


@pytest.mark.parametrize("kind", BOTH)
def test_intersections_of_an_arm(kind):
    """A hand that is down at a pose has eight rows on seven variables, and each constraint its own tolerance."""
    robot, _, _, begin = CASES["panda"]("panda")
    wanted = pin.SE3(pin.rpy.rpyToMatrix(np.pi, 0, 0.3), robot.pose(begin, robot.tool).translation)
    exact = pose(robot, robot.tool, wanted, tolerance=1e-2)
    down = upright(robot, robot.tool, direction=DOWN, tolerance=1e-5)
    found = list(kind(robot, [down, exact]).solutions(np.random.default_rng(0), 10, begin))
    assert len(found) >= 3 and all(down.satisfied(q) and exact.satisfied(q) for q in found)


def test_targets_of_other_numbers_compile_once(monkeypatch):
    """Poses, heights, cones, objectives and tolerances that differ in their numbers share one program."""
    structure_module.forget()
    made = []
    monkeypatch.setattr(ipopt_module.ca, "nlpsol", lambda *a, kept=ca.nlpsol: made.append(a) or kept(*a))
    robot, rng = named("panda"), np.random.default_rng(0)
    reached = 0
    for i in range(30):
        constraint = height(robot, robot.tool, float(rng.uniform(0.3, 0.6)), tolerance=10.0 ** -rng.integers(2, 5))
        x, y = rng.uniform(0.3, 0.5), rng.uniform(-0.3, 0.3)
        region = TaskSpaceRegion((x, y, *[-INF] * 4), (x + 0.1, y + 0.1, *[INF] * 4), Placement((0.01, 0.02, 0.0)))
        weight = float(rng.uniform(2, 3))

        def objective(q, guess, p, weight=weight):
            return p(weight) * ca.sumsqr(q - guess)

        condition = cone(robot, robot.tool, float(rng.uniform(0.3, 1)), direction=DOWN)
        target = in_region(robot, robot.tool, region)
        program = NonlinearProgram(robot, constraint, target, [condition], objective)
        if i % 10 == 0:
            q = program.solve(robot.rest)
            assert q is not None and constraint.satisfied(q) and condition.holds(q)
            reached += region.distance(robot.pose(q, robot.tool)) < 1e-5
    assert len(made) == 1 and reached == 3


def test_balance_acts():
    """Pholus leans as far as its feet allow to reach ahead: the margin is met to the micrometre, and not without it."""
    robot = named("pholus")
    points = {foot: robot.pose(robot.rest, foot).translation for foot in (f"contact_{i}" for i in range(1, 5))}
    feet, condition = feet_on_ground(robot, points), balanced(robot, list(points.values())).kept(0.15)
    region = TaskSpaceRegion((1.05, -0.6, 0.4, *[-INF] * 3), (1.1, -0.5, 0.5, *[INF] * 3))
    free, kept = (
        NonlinearProgram(robot, feet, in_region(robot, robot.tool, region), conditions).solve(robot.rest)
        for conditions in ((), [condition])
    )
    assert condition.slack(free).min() < 0.15 - 1e-3
    assert 0.15 <= condition.slack(kept).min() < 0.15 + 1e-5
    assert region.distance(robot.pose(kept, robot.tool)) == 0 and feet.satisfied(kept)
    assert np.linalg.norm(kept - robot.rest) > np.linalg.norm(free - robot.rest)


@pytest.mark.parametrize("kind", BOTH)
def test_conditions_hold_by_either(kind):
    """Every configuration that is yielded meets the conditions with their margins."""
    robot = named("panda")
    condition = cone(robot, robot.tool, 0.3, direction=DOWN).kept(0.1)
    found = list(kind(robot, height(robot, robot.tool, 0.4), None, [condition]).solutions(np.random.default_rng(0), 20))
    assert len(found) > 10 and all(condition.holds(q) for q in found)


def infeasible(robot):
    down = upright(robot, robot.tool, direction=DOWN)
    high = pin.SE3(pin.rpy.rpyToMatrix(np.pi, 0, 0), np.array([0.4, 0.0, 2.0]))
    return {
        "out of reach": ([down], at_pose(robot, robot.tool, high), ()),
        "against each other": ([height(robot, robot.tool, 0.3), height(robot, robot.tool, 0.31)], None, ()),
        "upright in a cone upside down": ([down], None, [cone(robot, robot.tool, 1.0)]),
        "beyond a limit": ([down], with_values([(0, float(robot.upper[0]) + 0.1)]), ()),
    }


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("case", infeasible(named("panda")))
def test_what_is_infeasible_is_none(kind, case):
    """No configuration is returned where there is none; how near the tries came is kept."""
    robot = named("panda")
    solver = kind(robot, *infeasible(robot)[case])
    assert not list(solver.solutions(np.random.default_rng(0), 6, robot.rest))
    assert solver.tried == 6 and max(solver.nearest) > 1e-3


def test_a_pose_that_misses_a_constraint_a_little_is_met():
    """Poses of projected configurations are on a manifold to its tolerance only; both are met within theirs."""
    robot = named("sawyer")
    constraint = upright(robot, robot.tool, direction=DOWN)
    begin = constraint.project(robot.rest).q
    T = pin.SE3(robot.pose(begin, robot.tool))
    T.rotation = T.rotation @ pin.utils.rotate("x", 8e-4)
    q = NonlinearProgram(robot, constraint, at_pose(robot, robot.tool, T)).solve(begin)
    assert constraint.satisfied(q) and np.linalg.norm(pin.log6(T.actInv(robot.pose(q, robot.tool))).vector) < 1.1e-3


def test_time_is_over_within_a_solve(monkeypatch):
    """A solve looks at the clock between its iterations; `solutions` tries once whatever the time is."""
    robot, constraints, target, begin = CASES["panda"]("panda")
    program = NonlinearProgram(robot, constraints, target)
    assert program.solve(begin) is not None
    looks = iter(range(1000))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(looks)))
    assert program.solve(begin, until=3.0) is None and next(looks) == 4
    assert len(list(program.solutions(np.random.default_rng(0), 20, begin, until=0.0))) == 1 and program.tried == 1
    monkeypatch.undo()
    assert program.solve(begin) is not None


def test_same_seed_same_configurations():
    """Solutions repeat to the bit, from another object of the same structure too."""
    robot, constraints, target, begin = CASES["ur5"]("ur5")
    runs = [
        np.array(list(NonlinearProgram(robot, constraints, target).solutions(np.random.default_rng(3), 6, begin)))
        for _ in range(2)
    ]
    assert len(runs[0]) and np.array_equal(*runs)


DOWNWARDS = upright(PANDA, PANDA.tool)
x = ca.SX.sym("x")
NONSENSE = {
    "nothing": (lambda: InverseKinematics(PANDA, ()), "nothing is asked of 'panda'"),
    "another robot": (lambda: NonlinearProgram(named("ur5"), DOWNWARDS), r"its 6 variables; they have .*, 7\)"),
    "another condition": (
        lambda: InverseKinematics(named("ur5"), (), None, [cone(PANDA, PANDA.tool, 1.0)]),
        "6 variables",
    ),
    "two objectives": (lambda: NonlinearProgram(PANDA, DOWNWARDS, objective=lambda q, g, p: q[:2]), "has 2 values"),
    "symbols": (lambda: NonlinearProgram(PANDA, DOWNWARDS, objective=lambda q, g, p: q[0] * x), r"symbols .* \['x'\]"),
    "short guess": (lambda: NonlinearProgram(PANDA, DOWNWARDS).solve(np.zeros(6)), "7 finite numbers"),
    "no number": (lambda: InverseKinematics(PANDA, DOWNWARDS).solve(np.full(7, np.nan)), "7 finite numbers"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_refused(case):
    """What makes no target set, objective or guess is refused with what there is."""
    make, message = NONSENSE[case]
    with pytest.raises(ConstraintError, match=message):
        make()


def test_limits_and_objective_alone():
    """Without equations the least objective within limits is found: the guess, at the limits it is beyond."""
    guess = np.array([1.0, -3.0, 1.0])
    np.testing.assert_allclose(NonlinearProgram(BALL, ()).solve(guess), [1.0, -2.0, 0.5], atol=1e-6)
