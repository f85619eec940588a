"""What the families say of their tasks is what they have planned: the verifier and planning speak of the same task."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from pipeline.config import ROOT, compose, load
from pipeline.evaluation.families import Setting
from pipeline.robots import Obstacle, Shape
from pipeline.spec.scene import Split
from pipeline.tasks import Task, build, set_up
from pipeline.verification.judge import Judge
from pipeline.verification.reader import read
from pipeline.verification.rows import Rows
from pipeline.verification.verdict import Failure, VerifierParameters
from tests.environments.published import published
from tests.robots.worlds import on_sphere

FAMILIES = sorted(path.stem for path in Path(ROOT, "conf", "family").glob("*.yaml"))


@cache
def setting(name: str) -> Setting:
    """The family of a file in conf/family."""
    content = OmegaConf.to_container(compose(f"family/{name}"))
    return load(content.get("family", content), Setting)


@cache
def task(name: str) -> Task:
    """Its first task of a seed."""
    return build(setting(name).family().task(77, 0).leg)


@pytest.mark.parametrize("name", FAMILIES)
def test_equations_and_limits(name):
    """||F|| and limits by what a family says are those that are planned with, wherever the robot is."""
    asked = task(name)
    statement = asked.statement
    kinematics = read(statement)
    Q = np.random.default_rng(0).uniform(*asked.robot.box, (30, asked.robot.dimension))
    theirs = np.linalg.norm(asked.constraint.value_batch(Q), axis=1)
    assert np.abs(np.linalg.norm(Rows(statement, kinematics).values(Q), axis=1) - theirs).max() < 1e-9
    assert np.allclose([kinematics.lower, kinematics.upper], [asked.robot.lower, asked.robot.upper], atol=0, rtol=0)
    assert kinematics.names == asked.robot.joint_names and statement.tolerance == asked.constraint.tolerance


@pytest.mark.parametrize("name", FAMILIES)
def test_contact_at_single_states(name):
    """A state passes where the checker of planning is free, and is refused where it is not, for whichever reason."""
    asked = task(name)
    judge = Judge(asked.statement, VerifierParameters(tolerance=1e6))
    checker, rng, seen = asked.validity(), np.random.default_rng(1), {True: 0, False: 0}
    near = asked.start + rng.normal(size=(150, asked.robot.dimension)) * rng.uniform(0.01, 0.5, (150, 1))
    for q in np.vstack([asked.start, asked.goal, np.clip(near, asked.robot.lower, asked.robot.upper)]):
        if name == "maze":  # the picture is seen from the torus' middle, in which it has no pixels
            q = asked.constraint.project(q).q
        free = bool(checker.free(q))
        if name != "maze" and free != checker.widened(2e-4).free(q):
            continue  # nearer to contact than what the verifier tells apart
        verdict = judge.verify(q[None], q, q)
        assert verdict.passed == free, verdict.message
        assert free or verdict.failure in (Failure.COLLISION, Failure.CONDITION)
        seen[free] += 1
    assert seen[True] > 1 and seen[False] > 1


@pytest.mark.parametrize("name", FAMILIES)
def test_body_in_the_way(name):
    """A ball of 1 mm that is put where the tool is at the goal is found, though planning's own scene lacks it."""
    asked = task(name)
    if name == "maze":
        pytest.skip("a maze has no bodies")
    kinematics = read(asked.statement)
    body = next(b for b in kinematics.bodies[::-1] if b.joint >= 0)
    R, p = kinematics.joint_poses(asked.goal[None])
    at = kinematics.placed(R, p, body.joint, body.placement)[1][0]
    ball = Obstacle(Shape.SPHERE, tuple(at.tolist()), (0.0, 0.0, 0.0, 1.0), (0.001,) * 3, "ball")
    statement = asked.statement
    assert Judge(statement).verify(asked.goal[None], asked.goal, asked.goal).passed
    changed = type(statement)(**{**vars(statement), "obstacles": (*statement.obstacles, ball)})
    verdict = Judge(changed).verify(asked.goal[None], asked.goal, asked.goal)
    assert verdict.failure is Failure.COLLISION and "'ball'" in verdict.message


def test_sphere_environment():
    """Among blocks on the sphere, single points pass where planning's checker without margin has them free."""
    environment = published("sphere", blocks=100, grid=3000)
    for scene in environment.scenes({Split.TRAIN: 1}):
        judge = Judge(scene.statement)
        setup = set_up(scene.statement)
        exact = setup.validity()
        wider = setup.validity(2e-4)
        points = on_sphere(np.random.default_rng(2), 400)
        told = [q for q in points if exact.free(q) == wider.free(q)]
        verdicts = [judge.verify(q[None], q, q) for q in told]
        assert [verdict.passed for verdict in verdicts] == [exact.free(q) for q in told]
        assert len({verdict.passed for verdict in verdicts}) == 2
        assert max(verdict.max_violation for verdict in verdicts) < 1e-12
