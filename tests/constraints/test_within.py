"""Values within bounds, in the forms that solvers and checks take, against plain numpy and regions' own distances."""

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Condition, TaskSpaceRegion, cone
from pipeline.constraints.cone import in_cone
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.within import Within
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers
from tests.robots.named import configurations, named
from tests.robots.worlds import differences

INF = np.inf
LOWER = np.array([0.5, -1.0, -INF, -INF, 0.3])
UPPER = np.array([0.5, 0.2, 0.7, INF, INF])


def rows(make, n: int = 5):
    """What `make` writes of q and numbers, as a function of q."""
    q, p = ca.SX.sym("q", n), Numbers()
    made = make(q, p)
    function = ca.Function("rows", [q, p.symbols], [ca.densify(made)])
    return lambda x: np.array(function(x, p.values)).reshape(-1)


@pytest.mark.parametrize("inset", [0.0, 0.1, 5.0])
def test_outside_is_the_difference_from_the_nearest_value_inside(inset):
    """Rows are x - clip(x): 0 inside an interval, signed outside; equations stay, intervals shrink to their middle."""
    kept = np.minimum(inset, (UPPER - LOWER) / 2)
    outside = rows(lambda q, p: Within(q, LOWER, UPPER).inset(inset).outside(p))
    for x in np.random.default_rng(0).uniform(-2, 2, (100, 5)):
        np.testing.assert_allclose(outside(x), x - np.clip(x, LOWER + kept, UPPER - kept), atol=1e-15)


def test_slack_is_negative_outside_only():
    """A row a finite bound, which is the distance to it; equations are refused."""
    bounds = slice(1, None)
    slack = rows(lambda q, p: Within(q[bounds], LOWER[bounds], UPPER[bounds]).slack(p)[0])
    for x in np.random.default_rng(0).uniform(-2, 2, (100, 5)):
        np.testing.assert_allclose(slack(x), [x[1] + 1.0, 0.2 - x[1], 0.7 - x[2], x[4] - 0.3], atol=1e-15)
    with pytest.raises(ConstraintError, match=r"value 0 has equal bounds 0\.5"):
        Within(ca.SX.sym("q", 5), LOWER, UPPER).slack(Numbers())


def test_regions_are_values_within_bounds():
    """How far a pose is outside of a region's values is the region's own distance, which numpy computes."""
    robot, rng = named("panda"), np.random.default_rng(0)
    lower, upper = (0.3, -INF, 0.2, -0.4, -0.3, 2.8), (0.5, 0.1, 0.2, 0.3, 0.2, 3.9)
    region = TaskSpaceRegion(lower, upper)
    outside = rows(lambda q, p: region.within(robot.symbolic_pose(q, robot.tool, p), p).outside(p), 7)
    Q = configurations(robot, rng, 50)
    found = [np.linalg.norm(outside(q)) for q in Q]
    np.testing.assert_allclose(found, [region.distance(robot.pose(q, robot.tool)) for q in Q], atol=1e-9)


MALFORMED = {
    "another number": (([0.0, 0.0], [1.0]), "1 values have 2 lower and 1 upper"),
    "crossed": (([1.0], [0.0]), "a value has bounds 1.0 and 0.0"),
    "not a number": (([np.nan], [0.0]), "a value has bounds nan and 0.0"),
    "nothing": (([INF], [INF]), "a value has bounds inf and inf"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_bounds_are_refused(case):
    """Bounds that no value is within, or too many of them, are refused with the bounds."""
    bounds, message = MALFORMED[case]
    with pytest.raises(ConstraintError, match=message):
        Within(ca.SX.sym("q"), *(np.array(side) for side in bounds))


def tilts(robot, Q: np.ndarray, axis, direction) -> np.ndarray:
    """Angles between an axis of the tool and a direction, by pinocchio."""
    units = [np.array(v) / np.linalg.norm(v) for v in (axis, direction)]
    return np.array([np.arccos(np.clip(units[1] @ robot.pose(q, robot.tool).rotation @ units[0], -1, 1)) for q in Q])


@pytest.mark.parametrize("angle", [0.1, 1.2, 2.5])
def test_cone_is_an_angle_within_a_bound(angle):
    """The condition holds exactly where pinocchio's angle is within; derivatives and batch are those of its slack."""
    robot, axis, direction = named("ur5"), (1.0, 0.2, 0.0), (0.1, 0.0, -2.0)
    condition = cone(robot, robot.tool, angle, axis, direction)
    Q = configurations(robot, np.random.default_rng(0), 300)
    found = tilts(robot, Q, axis, direction)
    assert [condition.holds(q) for q in Q] == (found <= angle).tolist()
    if angle > 1:
        assert 10 < (found <= angle).sum() < 290
    slack = condition.slack_rows(Q)
    np.testing.assert_array_equal(slack, [condition.slack(q) for q in Q])
    near = np.abs(found - angle) < 0.05
    np.testing.assert_allclose(slack[near, 0], (angle - found)[near], rtol=0.3, atol=1e-3)  # [rad], to first order
    np.testing.assert_allclose(condition.jacobian(Q[0]), differences(condition.slack, Q[0]), atol=1e-5)


def test_cone_bends_no_more_than_its_bound():
    """Second differences along random chords stay below the bound by which chords are proven."""
    robot = named("panda")
    condition = cone(robot, robot.tool, 0.8)
    assert condition.proven
    rng = np.random.default_rng(0)
    shares = []
    for q, step in zip(configurations(robot, rng, 200), rng.normal(size=(200, 7)), strict=True):
        h = 1e-3
        second = (condition.slack(q + h * step) - 2 * condition.slack(q) + condition.slack(q - h * step)) / h**2
        shares.append(abs(second[0]) / condition._bend(step[None])[0])
    assert 0.2 < max(shares) <= 1


def test_cone_as_a_target():
    """Inverse kinematics ends inside the cone by pinocchio, not only on its surface."""
    robot = named("panda")
    inverse = InverseKinematics(robot, (), in_cone(robot, robot.tool, 0.1, direction=(0, 0, -1)))
    found = np.array(list(inverse.solutions(np.random.default_rng(0), 40)))
    assert len(found) > 30 and tilts(robot, found, (0, 0, 1), (0, 0, -1)).max() < 0.1


@pytest.mark.parametrize("angle", [0.0, 1e-3, np.pi, np.nan])
def test_cones_need_an_opening(angle):
    """An angle of which nothing or everything is left is refused, and the message names what is meant instead."""
    robot = named("panda")
    with pytest.raises(ConstraintError, match="`upright`"):
        in_cone(robot, robot.tool, angle)


def test_conditions_of_intervals():
    """A condition of values within bounds names value and bound of the row that fails."""
    q = ca.SX.sym("q", 2)
    condition = Condition.within("box", q, Within(q, np.array([-1.0, 0.0]), np.array([1.0, INF])), ["x [m]", "y [m]"])
    assert condition.labels == ("x [m] at least -1", "x [m] at most 1", "y [m] at least 0")
    assert condition.holds(np.array([0.5, 0.1])) and not condition.holds(np.array([1.5, 0.1]))
    assert "x [m] at most 1 by -0.5" in condition.reason(np.array([1.5, 0.1]))
