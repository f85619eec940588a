"""Paths that are proven are free wherever one looks along their chords; those that are not fail where they collide."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import upright
from pipeline.environments.families import make_family
from pipeline.errors import ProblemError
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.manifolds.chords import CLEARANCE, ChordProof
from pipeline.manifolds.displacement import Displacement
from pipeline.planners import Query
from pipeline.robots import Obstacle, Robot, Shape, Validity, attach
from pipeline.tasks import build
from tests.robots.named import configurations, named, settings
from tests.robots.test_arms_validity import spread


def proof(robot: Robot, validity: Validity) -> ChordProof:
    motion = Displacement(robot)
    return ChordProof(validity, motion, np.ones(len(motion.relations)))


@pytest.mark.parametrize("count", [12, 80])
@pytest.mark.parametrize("name", ["panda", "baxter_right"])
def test_proven_ways_are_free_everywhere(name, count):
    """On straight ways among obstacles a verdict "free" holds at every point; "not free" has all but a contact."""
    robot, rng = named(name), np.random.default_rng(0)
    obstacles = spread(rng, count, robot)
    proven = proof(robot, Validity(robot, obstacles))
    exact, wider = Validity(robot, obstacles), Validity(robot, obstacles, 1.1 * CLEARANCE, 1.1 * CLEARANCE)
    free = blocked = 0
    for q in configurations(robot, rng, 40):
        other = np.clip(q + 0.25 * rng.normal(size=len(q)), robot.lower, robot.upper)
        points = np.linspace(q, other, 25)
        gap = proven.first_gap(points)
        if gap is None:
            free += 1
            assert all(exact.free(point) for point in np.linspace(q, other, 481))
        else:
            blocked += 1
            assert all(exact.free(point) for point in np.linspace(q, points[gap], 20 * gap + 1)[:-1])
            close = np.linspace(points[max(gap - 1, 0)], points[gap + 1], 400)
            assert not all(wider.free(point) for point in close)
    assert free > 3 and blocked > 3


@pytest.mark.parametrize("width", [0.02, 0.002, 0.0002])
def test_no_thin_body_is_missed(width):
    """A needle across the way of a thin stick, between two states that are free, is found in that chord."""
    stick = Obstacle(Shape.BOX, (0.0, 0.0, 0.2), (0, 0, 0, 1), (width, width, 0.36), "stick")
    robot, rng, found = attach(named("panda"), stick, named("panda").tool), np.random.default_rng(3), 0
    for q in configurations(robot, rng, 40):
        step = rng.normal(size=len(q))
        states = np.clip(q + np.linspace(0, 0.4, 5)[:, None] * step / np.linalg.norm(step), robot.lower, robot.upper)
        middle, share = int(rng.integers(4)), rng.uniform(0.2, 0.8)
        at = states[middle] + share * (states[middle + 1] - states[middle])
        tip = np.array([0.0, 0.0, 0.3])
        before, there, after = (robot.pose(x, robot.tool) for x in (states[middle], at, states[middle + 1]))
        across = np.cross(after.act(tip) - before.act(tip), there.rotation[:, 2])
        x, z = across / np.linalg.norm(across), there.rotation[:, 2]
        needle = obstacle(there.act(tip), np.stack([x, np.cross(z, x), z], axis=1), (0.3, width, width))
        validity = Validity(robot, (needle,))
        if all(validity.free(state) for state in states) and not validity.free(at):
            found += 1
            gap = proof(robot, validity).first_gap(states)
            assert gap is not None and gap <= middle
    assert found > 5


def obstacle(position: np.ndarray, rotation: np.ndarray, size: tuple[float, float, float]) -> Obstacle:
    """A box at a pose."""
    x, y, z, w = (float(part) for part in pin.Quaternion(rotation).coeffs())
    return Obstacle(Shape.BOX, tuple(position.tolist()), (x, y, z, w), size, "needle")


def test_conditions_are_asked_along_the_chords():
    """Where a condition fails along a chord the path fails there, before contacts that come later."""

    class Below:
        def holds(self, q: np.ndarray) -> bool:
            return bool(q[0] < 0.5)

        def first_gap(self, states: np.ndarray) -> int | None:
            above = np.flatnonzero(states[1:, 0] >= 0.5)
            return int(above[0]) if len(above) else None

    robot = named("panda")
    proven = proof(robot, Validity(robot, (), conditions=[Below()]))
    points = np.linspace(robot.rest, robot.rest + np.eye(robot.dimension)[0], 41)
    assert proven.first_gap(points) == int(np.argmax(points[:, 0] >= 0.5)) - 1
    assert proven.first_gap(points[:15]) is None


def test_refine_says_where():
    """`refine` names the given segment of the first contact, and passes what is free."""
    task = build(make_family("transport", settings("panda"), {}).task(5, 0).leg)
    parameters = AdherenceParameters(resolution=0.05, newton_steps=1)
    space = ProjectionAdherence(task.constraint, task.validity(0.005), parameters)
    rng = np.random.default_rng(0)
    on = space.sample(rng, 200)
    empty = ProjectionAdherence(task.constraint, Validity(task.robot, (), 0.005, 0.0), parameters)
    exact, within, near = task.validity(), task.validity(0.005), task.validity(0.001, 0.001)
    passed = failed = 0
    for q_from, q_to in zip(on[::2], on[1::2], strict=False):
        walk = empty.traverse(q_from, q_to)
        if len(walk.states) < 3 or not within.free(q_from):
            continue
        states = np.concatenate([q_from[None], walk.states])
        refined = space.refine(states)
        if refined.invalid is None:
            passed += 1
            assert all(exact.free(q) for a, b in pairwise(refined.states) for q in np.linspace(a, b, 12))
            assert len(refined.states) >= len(states)
        else:
            failed += 1
            i = refined.invalid
            close = [q for pair in pairwise(states[max(i - 1, 0) : i + 3]) for q in np.linspace(*pair, 40)]
            assert not all(near.free(q) for q in close)
    assert passed > 2 and failed > 2


def test_what_cannot_be_proven_is_said_before_the_search():
    """A start nearer to a box than the stated clearance is free, but no proven path begins there; NaN is never free."""
    robot = named("panda")
    x = 0.9
    while True:  # a wall that comes nearer
        wall = Obstacle(Shape.BOX, (x + 0.5, 0.0, 0.5), (0, 0, 0, 1), (1.0, 2.0, 1.5), "wall")
        validity = Validity(robot, (wall,))
        gap = validity.clearance(robot.rest)
        if gap < 0.6 * CLEARANCE:
            break
        x -= max(gap - 0.5 * CLEARANCE, 1e-6)
    assert validity.free(robot.rest)
    constraint = upright(robot, robot.tool, direction=robot.pose(robot.rest, robot.tool).rotation[:, 2])
    plain, proven = (
        ProjectionAdherence(constraint, validity, AdherenceParameters(proof=choice)) for choice in (False, True)
    )
    Query(plain, robot.rest, robot.rest).check()
    with pytest.raises(ProblemError, match=r"nearer than 0\.1 mm to contact"):
        Query(proven, robot.rest, robot.rest).check()
    broken = np.array([robot.rest, np.full(robot.dimension, np.nan)])
    assert proof(robot, Validity(robot, ())).first_gap(broken) == 0
