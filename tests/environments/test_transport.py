"""Upright transport: seeded problems whose ends are valid by pinocchio and coal, with the obstacles promised."""

import numpy as np
import pytest

from pipeline.environments.transport import STATIONS, UprightTransport
from pipeline.errors import ConfigError
from pipeline.robots import Shape
from pipeline.tasks import build
from tests.robots.named import named, settings
from tests.robots.test_arms_validity import plain


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("number", range(4))
def test_problems_are_valid(name, number):
    """Start and goal are level by pinocchio, 2 cm free by plain coal, low over the table, and at least 1 rad apart."""
    robot = named(name)
    problem = build(UprightTransport(settings(name)).task(7, number).leg)
    assert 15 <= len(problem.obstacles) <= 40
    assert {o.shape for o in problem.obstacles} <= {Shape.BOX, Shape.CYLINDER}
    assert len({o.name for o in problem.obstacles}) == len(problem.obstacles)
    assert any(o.name.startswith("board") for o in problem.obstacles) == (number % 2 == 1)
    assert np.linalg.norm(problem.start - problem.goal) > 1
    for q in (problem.start, problem.goal):
        assert ((robot.lower <= q) & (q <= robot.upper)).all()
        T = robot.pose(q, robot.tool)
        assert T.rotation[:, 2] @ STATIONS[name].level > np.cos(1e-3)
        assert 0.03 < T.translation[2] - STATIONS[name].top < 0.3
        assert plain(robot, problem.obstacles, q, 0.02, 0.0)


def test_a_seed_is_a_problem():
    """The same seed and number give the same problem to the bit; another seed or number another one."""
    family = UprightTransport(settings("panda"))
    first, again = (build(family.task(3, 5).leg) for _ in range(2))
    assert first.obstacles == again.obstacles
    np.testing.assert_array_equal(np.stack([first.start, first.goal]), np.stack([again.start, again.goal]))
    for seed, number in ((4, 5), (3, 7)):
        other = build(family.task(seed, number).leg)
        assert other.obstacles != first.obstacles and not np.array_equal(other.start, first.start)


def test_objects_stand_on_something():
    """Every object's underside is the table or a board, none stands over the table's edge, and boards are a shelf."""
    for number in range(6):
        problem = build(UprightTransport(settings("panda")).task(1, number).leg)
        table = next(o for o in problem.obstacles if o.name == "table")
        tops = [o.position[2] + o.size[2] / 2 for o in problem.obstacles if o.name.startswith(("table", "board"))]
        for o in problem.obstacles:
            if o.name.startswith("object"):
                assert np.abs(np.array(tops) - (o.position[2] - o.size[2] / 2)).min() < 1e-9
                assert (np.abs(np.array(o.position) - table.position)[:2] <= np.array(table.size)[:2] / 2 + 0.35).all()


def test_unknown_robot():
    """A robot without a station is refused with those that have one."""
    with pytest.raises(ConfigError, match="panda, kinova, baxter_right, not for 'olivia'"):
        UprightTransport(settings("olivia"))
