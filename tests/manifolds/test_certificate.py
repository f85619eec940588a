"""Certified paths are free wherever one looks between their states; those that are not fail where they collide."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.constraints import upright
from pipeline.environments.families import make_family
from pipeline.errors import ProblemError
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.manifolds.certificate import Certificate
from pipeline.planners import Problem
from pipeline.robots import Obstacle, Shape, Validity
from tests.robots.named import configurations, named
from tests.robots.test_arms_validity import spread


@pytest.mark.parametrize("name", ["panda", "baxter_right"])
def test_certified_ways_are_free_everywhere(name):
    """On straight ways among obstacles a verdict "free" holds at every point; "not free" has a collision.

    The second only up to some millimetres, by which ways are held to be blocked that just pass.
    """
    robot, rng = named(name), np.random.default_rng(0)
    obstacles = spread(rng, 12, robot)
    certificate = Certificate(Validity(robot, obstacles))
    exact, wider = Validity(robot, obstacles), Validity(robot, obstacles, 0.003, 0.003)
    free = blocked = 0
    for q in configurations(robot, rng, 60):
        other = np.clip(q + 0.25 * rng.normal(size=len(q)), robot.lower, robot.upper)
        points = np.linspace(q, other, 25)
        gap = certificate.first_gap(points)
        verdicts = [exact.free(point) for point in np.linspace(q, other, 481)]
        if gap is None:
            free += 1
            assert all(verdicts)
        else:
            blocked += 1
            assert all(verdicts[: 20 * gap])
            close = np.linspace(points[gap], points[gap + 1], 60)
            assert not all(wider.free(point) for point in close)
    assert free > 5 and blocked > 5


def test_conditions_are_asked_at_the_points():
    """A condition that fails at one point fails the way to it."""

    class Below:
        def holds(self, q: np.ndarray) -> bool:
            return bool(q[0] < 0.5)

    robot = named("panda")
    certificate = Certificate(Validity(robot, (), conditions=[Below()]))
    points = np.linspace(robot.rest, robot.rest + np.eye(robot.dimension)[0], 41)
    assert certificate.first_gap(points) == int(np.argmax(points[:, 0] >= 0.5)) - 1
    assert certificate.first_gap(points[:15]) is None


def test_refine_says_where():
    """`refine` with a certificate names the segment of the first collision, and passes what is free."""
    task = make_family("transport", named("panda"), {}).task(5, 0)
    parameters = AdherenceParameters(resolution=0.05, refinement=0.025, certified=True, newton_steps=1)
    space = ProjectionAdherence(task.constraint, task.validity(0.005), parameters)
    rng = np.random.default_rng(0)
    on = space.sample(rng, 200)
    empty = ProjectionAdherence(task.constraint, Validity(task.robot, (), 0.005, 0.0), parameters)
    exact, within, near = task.validity(), task.validity(0.005), task.validity(0.004, 0.004)
    passed = failed = 0
    for q_from, q_to in zip(on[::2], on[1::2], strict=False):
        walk = empty.traverse(q_from, q_to)
        if len(walk.states) < 3 or not within.free(q_from):
            continue
        states = np.concatenate([q_from[None], walk.states])
        refined = space.refine(states)
        dense = [[*np.linspace(a, b, 12)] for a, b in pairwise(states)]
        verdicts = [all(exact.free(q) for q in piece) for piece in dense]
        if refined.invalid is None:
            passed += 1
            assert all(verdicts)
        else:
            failed += 1
            i = refined.invalid
            assert all(verdicts[:i])
            close = [q for pair in pairwise(states[max(i - 1, 0) : i + 3]) for q in np.linspace(*pair, 40)]
            assert not all(near.free(q) for q in close)
    assert passed > 2 and failed > 2


def test_what_cannot_be_certified_is_said_before_the_search():
    """A start within a millimetre of a box is free, but no certified path begins there; NaN is never free."""
    robot = named("panda")
    x = 0.9
    while True:  # a wall that comes nearer
        wall = Obstacle(Shape.BOX, (x + 0.5, 0.0, 0.5), (0, 0, 0, 1), (1.0, 2.0, 1.5), "wall")
        validity = Validity(robot, (wall,))
        if validity.clearance(robot.rest) < 1e-3:
            break
        x -= max(validity.clearance(robot.rest) - 5e-4, 1e-4)
    assert validity.free(robot.rest)
    constraint = upright(robot, robot.tool, direction=robot.pose(robot.rest, robot.tool).rotation[:, 2])
    plain, certified = (
        ProjectionAdherence(constraint, validity, AdherenceParameters(certified=choice)) for choice in (False, True)
    )
    Problem(plain, robot.rest, robot.rest).check()
    with pytest.raises(ProblemError, match="too near to contact"):
        Problem(certified, robot.rest, robot.rest).check()
    broken = np.array([robot.rest, np.full(robot.dimension, np.nan)])
    assert Certificate(Validity(robot, ())).first_gap(broken) == 0
