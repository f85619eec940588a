"""Tasks that differ in their numbers share what is compiled, and nothing of it shows in their values."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import (
    TaskSpaceRegion,
    balanced,
    chain,
    closed_chain,
    intersection,
    line,
    plane,
    position,
    sphere_constraint,
    structure_of,
    upright,
)
from pipeline.constraints import native as native_module
from pipeline.constraints import structure as structure_module
from pipeline.errors import ConstraintError
from pipeline.manifolds import AdherenceParameters, AtlasAdherence, AtlasParameters, ProjectionAdherence
from pipeline.robots import Numbers, Obstacle, Placement, Shape, Validity, attach
from tests.robots.named import configurations, named


@pytest.fixture(autouse=True)
def anew():
    """Every test begins without structures."""
    structure_module.forget()


def numbers(rng: np.random.Generator) -> np.ndarray:
    """Three numbers, the least first: which axis is nearest to be across a direction decides where its zeros are."""
    return np.sort(rng.uniform(0.2, 0.9, 3))


def hinge(rng: np.random.Generator) -> Placement:
    return Placement(tuple(numbers(rng)), (0.0, 0.0, float(rng.uniform(0.1, 1.0))))


def door(robot, rng):
    """A door whose hinge and handle stand somewhere else each time."""
    low, high = np.zeros(6), np.zeros(6)
    low[5] = -float(rng.uniform(1, 2))
    regions = [
        TaskSpaceRegion(tuple(low), tuple(high), hinge(rng)),
        TaskSpaceRegion(tuple(low), tuple(high), hinge(rng)),
    ]
    return chain(robot, regions).constraint


def region(robot, rng):
    fixed = numbers(rng).tolist()
    low = [fixed[0], -np.inf, fixed[1], fixed[2], -np.inf, -np.inf]
    high = [fixed[0], np.inf, fixed[1], fixed[2], np.inf, np.inf]
    return TaskSpaceRegion(tuple(low), tuple(high), hinge(rng)).constraint(robot)


MAKERS = {
    "upright": lambda robot, rng: upright(robot, robot.tool, numbers(rng), numbers(rng)),
    "plane": lambda robot, rng: plane(robot, robot.tool, numbers(rng), numbers(rng)),
    "line": lambda robot, rng: line(robot, robot.tool, numbers(rng), numbers(rng)),
    "position": lambda robot, rng: position(robot, robot.tool, numbers(rng)),
    "sphere": lambda robot, rng: sphere_constraint(robot, robot.tool, float(rng.uniform(0.3, 0.8))),
    "pose": lambda robot, rng: closed_chain(robot, "universe", robot.tool, hinge(rng).se3()),
    "region": region,
    "door": door,
    "both": lambda robot, rng: intersection(
        plane(robot, robot.tool, numbers(rng), numbers(rng)), plane(robot, "panda_link5", numbers(rng), numbers(rng))
    ),
}


@pytest.mark.parametrize("kind", MAKERS)
def test_one_structure_for_all_numbers(kind, monkeypatch):
    """Constraints made anew share a structure, and have the values of one whose numbers are constants."""
    robot, rng = named("panda"), np.random.default_rng(1)
    made = [MAKERS[kind](robot, np.random.default_rng(seed)) for seed in range(3)]
    assert len({id(constraint.structure) for constraint in made}) == 1
    monkeypatch.setattr(Numbers, "__call__", lambda self, values: ca.SX(ca.DM(np.asarray(values, float))))
    for seed, constraint in enumerate(made):
        plain = MAKERS[kind](robot, np.random.default_rng(seed))
        assert not len(plain.numbers) and len(constraint.numbers)
        for q in rng.uniform(-1, 1, (5, constraint.n)):
            np.testing.assert_allclose(constraint.value(q), plain.value(q), atol=1e-14)
            np.testing.assert_allclose(constraint.jacobian(q), plain.jacobian(q), atol=1e-13)


def test_a_hundred_doors_cost_one_compilation(monkeypatch):
    """Whole edges, projections and the motion of bodies are compiled for the first door only."""
    compiled = []
    monkeypatch.setattr(structure_module, "native", lambda function, _: compiled.append(function.name()))
    robot, panel = named("panda"), Obstacle(Shape.BOX, (0, 0, 0), (0, 0, 0, 1), (0.02, 0.4, 0.6), "panel")
    counts = []
    for seed in range(100 if native_module.find_compiler() else 3):
        rng = np.random.default_rng(seed)
        low, high = np.zeros(6), np.zeros(6)
        low[5] = -float(rng.uniform(1, 2))
        held = chain(robot, [TaskSpaceRegion(tuple(low), tuple(high), hinge(rng))] * 2)
        carrying = attach(held.robot, panel, "chain_0")
        for kind, parameters in (
            (ProjectionAdherence, AdherenceParameters(native=True)),
            (AtlasAdherence, AtlasParameters(native=True)),
        ):
            kind(held.constraint, Validity(carrying, ()), parameters)
        counts.append(len(compiled))
    assert counts[0] > 0 and counts[-1] == counts[0]


def test_limits_and_tolerance_are_those_of_the_task():
    """Walks of two tasks of one structure end at their own limits, and are as exact as they ask for."""
    robot = named("panda")
    narrow = replace(robot, upper=np.minimum(robot.upper, 1.5))
    found = {}
    for limits, tolerance in ((robot, 1e-3), (narrow, 1e-3), (robot, 1e-6)):
        constraint = upright(limits, robot.tool, tolerance=tolerance)
        space = ProjectionAdherence(constraint, Validity(limits, ()), AdherenceParameters())
        Q, converged = constraint.project_batch(configurations(robot, np.random.default_rng(0), 4000))
        Q = Q[converged & ((Q >= robot.lower) & (Q <= robot.upper)).all(axis=1)]
        inside = (Q <= narrow.upper).all(axis=1)
        walks = [space.traverse(a, b) for a, b in zip(Q[inside][:15], Q[~inside], strict=False)]
        states = np.concatenate([walk.states[:-1] for walk in walks])
        found[limits is narrow, tolerance] = states
        assert np.linalg.norm(constraint.value_batch(states), axis=1).max() < tolerance
        assert (states <= limits.upper).all()
    assert (found[False, 1e-3] > narrow.upper).any()
    assert np.linalg.norm(upright(robot, robot.tool).value_batch(found[False, 1e-3]), axis=1).max() > 1e-6


def test_zero_and_one_stay_in_the_expression():
    """They are no arguments, so that expressions stay as short as without."""
    p = Numbers()
    made = p(np.array([[0.0, 1.0, -1.0], [0.5, 2.0, 0.5]]))
    assert p.values.tolist() == [0.5, 2.0, 0.5]
    function = ca.Function("f", [p.symbols], [ca.densify(made)])
    np.testing.assert_array_equal(np.array(function([7.0, 8.0, 9.0])), [[0, 1, -1], [7, 8, 9]])
    assert made.nnz() == 5
    np.testing.assert_array_equal(np.array(ca.DM(p(1.0))), [[1.0]])


def test_balance_takes_polygon_and_load_as_numbers():
    """Other feet and another load in the hand do not make the condition anew, and slack is that of pinocchio."""
    robot, rng = named("panda"), np.random.default_rng(0)
    structures = set()
    for seed in range(3):
        rng = np.random.default_rng(seed)
        body = Obstacle(Shape.SPHERE, tuple(numbers(rng)), (0, 0, 0, 1), (0.1, 0.1, 0.1), "load")
        loaded = attach(robot, body, robot.tool, mass=float(rng.uniform(1, 4)))
        angles = np.sort(rng.uniform(0, 2 * np.pi, 3) / 3 + np.array([0, 2, 4]) * np.pi / 3)
        feet = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        condition = balanced(loaded, feet, 0.01)
        structures.add(id(condition._structure))
        Q = configurations(robot, rng, 20)
        slacks = condition.slack_rows(Q)
        for q, slack in zip(Q, slacks, strict=True):
            com = pin.centerOfMass(loaded.model, loaded.model.createData(), q)[:2]
            nearest = min(
                float(np.linalg.det([b - a, com - a])) / float(np.linalg.norm(b - a))
                for a, b in zip(feet[:, :2], np.roll(feet[:, :2], -1, axis=0), strict=True)
            )
            assert slack.min() == pytest.approx(nearest - 0.01, abs=1e-9)
            np.testing.assert_array_equal(condition.slack(q), slack)
            steps = 1e-6 * np.eye(len(q))
            differences = np.stack([(condition.slack(q + e) - condition.slack(q - e)) / 2e-6 for e in steps], axis=1)
            np.testing.assert_allclose(condition.jacobian(q), differences, atol=1e-7)
    assert len(structures) == 1


def test_other_symbols_are_refused():
    """Rows may depend on configuration and numbers only; the message names what else there is."""
    q, x = ca.SX.sym("q", 2), ca.SX.sym("x")
    with pytest.raises(ConstraintError, match=r"this row depends on symbols .* \['x'\]"):
        structure_of(q, q[0] * x, ca.SX(0, 1), "this row")
