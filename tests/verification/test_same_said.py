"""The same task said in two ways has the same verdict."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from arms import PANDA, random_path
from test_enclosed import CORNERS, FACES, FLAT, written

from pipeline.robots import Obstacle, Shape, stands_clear
from pipeline.spec.statement import Carried, Level, OnPlane, OnSphere, Pinned, Point, Statement
from pipeline.verification.judge import Judge

POINT = Point(0.0001, (-1.5,) * 3, (1.5,) * 3)


def verdict(statement: Statement, path: np.ndarray) -> tuple[str, bool]:
    found = Judge(statement).verify(path, path[0], path[-1])
    return (found.failure.value if found.failure else "passed"), found.chords_sampled > 0


def arc(rng: np.random.Generator) -> np.ndarray:
    """A way on the unit sphere with waypoints up to 0.08 apart."""
    first, last = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    angles = np.cumsum(np.append(0, rng.uniform(0.01, 0.08, 15)))[:, None]
    across = np.cross(np.cross(first, last), first)
    across /= np.linalg.norm(across)
    return np.asarray(first * np.cos(angles) + across * np.sin(angles))


def test_ways_to_say_a_scene_on_a_sphere(tmp_path):
    """Obstacles in another order, as meshes, mirrored; the path in finer states, backwards, or moved with the scene."""
    rng, seen = np.random.default_rng(0), set()
    file = written(tmp_path / "box.obj", [(CORNERS, FACES)])
    for _ in range(60):
        path = arc(rng)
        boxes = []
        for k in range(8):
            at, turn = path[rng.integers(len(path))] + rng.normal(size=3) * 0.08, rng.normal(size=4)
            size = tuple(rng.uniform(0.001, 0.1, 3).tolist())
            boxes.append(Obstacle(Shape.BOX, tuple(at.tolist()), tuple(turn / np.linalg.norm(turn)), size, f"box {k}"))
        meshes = [replace(box, shape=Shape.MESH, file=file) for box in boxes]
        mirrored = [replace(mesh, size=(-mesh.size[0], mesh.size[1], -mesh.size[2])) for mesh in meshes]
        task = Statement(POINT, (OnSphere("point", 1.0),), 1e-3, tuple(boxes))
        expected = verdict(task, path)
        finer = np.concatenate([*(np.linspace(a, b, 5)[:-1] for a, b in pairwise(path)), path[-1:]])
        for obstacles, way in (
            (boxes[::-1], path),
            (meshes, path),
            (mirrored, path),
            (boxes, path[::-1]),
            (boxes, finer),
            (boxes, np.repeat(path, 2, axis=0)),
        ):
            assert verdict(replace(task, obstacles=tuple(obstacles)), way) == expected
        seen.add(expected[0])
    assert seen == {"passed", "collision"}


def test_walls_across_the_way_of_a_point():
    """Walls from 4 mm to a micron, anywhere across the way of a point of 0.1 mm: none is passed."""
    angles = np.linspace(0, 0.5, 12)
    path = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    for width in (0.004, 0.0005, 1e-6):
        for k in range(60):
            angle = 0.1 + 0.00171 * k
            turned = (0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))
            at = (float(np.cos(angle)), float(np.sin(angle)), 0.0)
            wall = Obstacle(Shape.BOX, at, turned, (0.2, width, 0.2), "wall")
            assert verdict(Statement(POINT, (OnSphere("point", 1.0),), 1e-3, (wall,)), path)[0] == "collision"


@pytest.mark.parametrize("kind", ["carried", "equation"])
def test_ways_to_say_an_arms_task(kind):
    """A tool in one frame or in another that is fixed to it; an equation in metres along another normal."""
    rng, planning, seen = np.random.default_rng(3), PANDA.robot(), set()
    for _ in range(25):
        path = random_path(PANDA, rng, 8, 0.2)
        there = Obstacle(Shape.BOX, tuple(rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 0.9])), FLAT, (0.2,) * 3, "box")
        if not stands_clear(planning, [there]):
            continue
        wide = Statement(PANDA, (Pinned("panda_hand_tcp", (0.0, 0.0, 0.0)),), 10.0, (there,))
        if kind == "carried":
            tool = Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.1), FLAT, (0.03, 0.03, 0.2), "tool")
            shifted = replace(tool, position=(0.0, 0.0, 0.1 + 0.1034))  # the tool's frame is 0.1034 m from the hand's
            said = [
                replace(wide, carried=(Carried(body, frame),))
                for body, frame in ((tool, "panda_hand_tcp"), (shifted, "panda_hand"))
            ]
        else:
            tolerance = float(rng.uniform(0.05, 0.3))
            planes = [OnPlane("panda_hand_tcp", (0.0, 0.0, scale), 0.5 * scale) for scale in (1.0, -1.0)]
            said = [replace(wide, equations=(plane,), tolerance=tolerance, obstacles=()) for plane in planes]
        verdicts = {verdict(statement, path) for statement in said}
        assert len(verdicts) == 1
        seen |= {name for name, _ in verdicts}
    assert len(seen) == 2


def test_a_goal_is_the_same_after_whole_turns():
    """A joint that turns may end whole turns from the goal; one that slides may not, and a start is where it is."""
    still = Level("panda_hand_tcp", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    q = np.array([0.1, -0.6, -0.2, -2.3, 0.1, 1.7, 0.5])
    judge = Judge(Statement(PANDA, (still,), 10.0))
    turned = q + 2 * np.pi * np.eye(7)[0]
    assert judge.verify(q[None], q, turned).passed
    assert not judge.verify(q[None], turned, q).passed
    assert not judge.verify(q[None], q, q + 1e-3 * np.eye(7)[0]).passed
    slides = Judge(Statement(POINT, (OnSphere("point", 1.0),), 10.0))
    assert not slides.verify(np.zeros((1, 3)), np.zeros(3), 2 * np.pi * np.eye(3)[0]).passed
