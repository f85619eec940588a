"""What a network is told of a task: found from the constraints themselves, and refused where it was never learned."""

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.environments.door import DoorOpening
from pipeline.errors import ProblemError
from pipeline.learning.task_kinds import kind_of, task_input, task_kinds, task_vector
from pipeline.robots import Numbers, Robot
from pipeline.tasks import set_up
from tests.robots.named import settings
from tests.robots.worlds import ball, sphere


def plane(robot: Robot, height: float, tilt: float = 0.3) -> Constraint:
    """z + tilt x = height."""
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    return Constraint("plane", q, q[2] + p(tilt) * q[0] - p(height), labels=[f"z at {height} [m]"], numbers=p)


def test_tasks_that_differ_in_nothing_need_no_words():
    """Tasks of one kind with equal numbers make no input."""
    robot = ball()
    kinds = task_kinds([(robot, sphere())] * 3, centre=False)
    assert len(kinds) == 1 and task_input(kinds) == 0
    assert task_vector(kinds, 0, sphere().numbers).shape == (0,)


def test_only_what_differs_is_said():
    """Of two numbers the one that differs is an input, from -1 to 1 over the tasks that were learned."""
    robot = ball()
    kinds = task_kinds([(robot, plane(robot, height)) for height in (0.2, 0.7, 0.3)], centre=False)
    assert len(kinds) == 1 and task_input(kinds) == 1
    for height, expected in ((0.2, -1.0), (0.7, 1.0), (0.45, 0.0), (0.95, 2.0)):
        np.testing.assert_allclose(task_vector(kinds, 0, plane(robot, height).numbers), [expected], atol=1e-12)


def test_another_value_of_what_never_differed_is_refused():
    """A number that was the same in all tasks has to be that one."""
    robot = ball()
    kinds = task_kinds([(robot, plane(robot, height)) for height in (0.2, 0.7)], centre=False)
    with pytest.raises(ProblemError, match=r"is 0\.4, and 0\.3 in all tasks"):
        task_vector(kinds, 0, plane(robot, 0.5, tilt=0.4).numbers)


def test_several_kinds():
    """Tasks of several kinds are told apart, in whatever order they come, and shorter ones are filled up."""
    robot = ball()
    tasks = [(robot, sphere()), (robot, plane(robot, 0.2)), (robot, plane(robot, 0.7))]
    for order in (tasks, tasks[::-1]):
        kinds = task_kinds(order, centre=False)
        assert len(kinds) == 2 and task_input(kinds) == 3
        told = {
            tuple(task_vector(kinds, kind_of(kinds, robot, constraint), constraint.numbers)) for _, constraint in tasks
        }
        assert len(told) == 3


def test_an_unknown_kind_is_refused():
    """A task of another constraint or robot is refused, with what is known."""
    robot = ball()
    kinds = task_kinds([(robot, sphere())], centre=False)
    with pytest.raises(ProblemError, match=r"learned tasks of sphere\[\*\] \(3 joints\), not of z at 0\.2"):
        kind_of(kinds, robot, plane(robot, 0.2))


def test_doors_are_one_kind():
    """A hundred doors, hinged left and right anywhere, are tasks of one kind that tells where the hinge is."""
    family = DoorOpening(settings("panda"))
    setups = [set_up(family.scene(i, np.random.default_rng([3, i]))[0]) for i in range(100)]
    kinds = task_kinds([(setup.robot, setup.constraint) for setup in setups], centre=True)
    assert len(kinds) == 1
    assert kinds[0].codec.size == setups[0].robot.dimension
    told = np.array([task_vector(kinds, 0, setup.constraint.numbers) for setup in setups])
    assert task_input(kinds) >= 3 and np.abs(told).max() <= 1 + 1e-9
    hinges = np.array([setup.statement.chain.regions[0].place.xyz for setup in setups])
    design = np.column_stack([told, np.ones(100)])  # what is told determines where the hinge is
    fitted = design @ np.linalg.lstsq(design, hinges, rcond=None)[0]
    np.testing.assert_allclose(fitted, hinges, atol=1e-6)
