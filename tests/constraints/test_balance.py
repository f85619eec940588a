"""Static balance: feet where they stand, centre of mass over them, by pinocchio and plain geometry."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import Condition, balanced, feet_on_ground
from pipeline.errors import ConfigError, ConstraintError
from pipeline.robots import Validity
from tests.robots.named import named
from tests.robots.worlds import differences

FEET = tuple(f"contact_{i}" for i in range(1, 5))


def standing():
    """Pholus, where its feet stand at rest, and the constraint that keeps them there."""
    robot = named("pholus")
    points = {foot: robot.pose(robot.rest, foot).translation for foot in FEET}
    return robot, points, feet_on_ground(robot, points)


def test_feet_stay():
    """Twelve rows on 41 variables; noisy configurations project to ones whose feet are where they stood."""
    robot, points, constraint = standing()
    assert (constraint.k, constraint.n) == (12, 41)
    rng = np.random.default_rng(1)
    Q, converged = constraint.project_batch(robot.rest + rng.normal(scale=0.25, size=(30, 41)))
    assert converged.mean() > 0.9
    for q in Q[converged]:
        for foot, point in points.items():
            np.testing.assert_allclose(robot.pose(q, foot).translation, point, atol=1e-3)
    np.testing.assert_allclose(constraint.jacobian(Q[0]), differences(constraint.value, Q[0]), atol=1e-6)


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_balance_is_point_in_polygon(margin):
    """The condition holds exactly when pinocchio's centre of mass is inside the feet's rectangle less the margin."""
    robot, points, _ = standing()
    contacts = np.array(list(points.values()))
    low, high = contacts[:, :2].min(axis=0), contacts[:, :2].max(axis=0)
    # A rectangle, so that the polygon is known without a hull.
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    condition = balanced(robot, corners, margin)
    rng, data, verdicts = np.random.default_rng(2), robot.model.createData(), []
    for _ in range(200):
        q = robot.rest.copy()
        q[:6] += rng.normal(scale=0.2, size=6)
        com = pin.centerOfMass(robot.model, data, q)[:2]
        inside = min((com - low).min(), (high - com).min()) - margin
        if abs(inside) > 1e-6:
            verdicts.append(condition.holds(q))
            assert verdicts[-1] == (inside > 0)
            assert condition.slack(q).min() == pytest.approx(inside, abs=1e-9) or inside > 0
    assert 20 < sum(verdicts) < 180


def test_balance_is_part_of_validity():
    """A robot that leans out of its feet is not free although nothing collides."""
    robot, points, _ = standing()
    condition = balanced(robot, list(points.values()), 0.02)
    validity = Validity(robot, [], conditions=[condition])
    assert validity.free(robot.rest)
    leaning = robot.rest.copy()
    leaning[0] += 0.55  # the base forward, feet and all: the polygon stays where it was
    assert Validity(robot, []).free(leaning) and not validity.free(leaning)
    least = condition.slack(leaning).min()
    assert "not meeting balance: centre of mass inside edge" in validity.reason(leaning)
    assert f"by {least:.3g}, at least 0" in validity.reason(leaning)


def test_margin_may_be_as_large_as_a_circle_in_the_polygon():
    """A margin just below the radius of the largest circle leaves its centre, though not the mean of the corners."""
    robot = standing()[0]
    balanced(robot, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 0.292)
    balanced(robot, [(0, 0, 0), (0.01, 0, 0), (0, 0.01, 0), (1, 0, 0), (0, 1, 0)], 0.292)


MALFORMED = {
    "line": (lambda r: balanced(r, [(0, 0, 0), (1, 1, 0), (2, 2, 0)]), ConstraintError, "span no polygon"),
    "two": (lambda r: balanced(r, [(0, 0, 0), (1, 1, 0)]), ConstraintError, "span no polygon"),
    "flat": (lambda r: balanced(r, [(0, 0), (1, 1), (0, 1)]), ConstraintError, r"shape \(3, 2\)"),
    "margin": (lambda r: balanced(r, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 0.5), ConstraintError, "leaves nothing"),
    "margin beyond the largest circle": (
        lambda r: balanced(r, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 0.294),  # its radius is 1 - 1 / sqrt(2)
        ConstraintError,
        "no more than 0.2929 m fit into it",
    ),
    "negative margin": (
        lambda r: balanced(r, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], -0.1),
        ConfigError,
        "margin is -0.1 m",
    ),
    "no feet": (lambda r: feet_on_ground(r, {}), ConstraintError, "at least one foot"),
    "labels": (
        lambda r: Condition("c", *(lambda q: (q, q))(__import__("casadi").SX.sym("q", 2)), ["one"]),
        ConstraintError,
        "2 rows and 1 labels",
    ),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_is_refused(case):
    """Malformed balance conditions are refused with the reason."""
    make, kind, message = MALFORMED[case]
    with pytest.raises(kind, match=message):
        make(named("pholus"))
