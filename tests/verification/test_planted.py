"""Thin bodies planted across proven paths are found: none is missed, down to the stated clearance."""

import coal
import numpy as np
import pytest
from arms import BAXTER, PANDA, contacts, known, random_path
from scipy.spatial.transform import Rotation

from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.verification.kinematics import WORLD
from pipeline.verification.verdict import CLEARANCE

WIRE, PLATE = (0.001, 0.001, 0.3), (0.001, 0.06, 0.06)  # their first side is the thin one [m]


def planted(robot: UrdfRobot, path: np.ndarray, rng: np.random.Generator) -> tuple[Obstacle, int]:
    """Return a thin body that overlaps a body of the robot somewhere along a path, by CLEARANCE or more, and its chord.

    The point it is put at is the surface point, by coal, that is nearest to a far point in a random direction.
    """
    kinematics, items, _ = known(robot)
    chord = int(rng.integers(len(path) - 1))
    q = path[chord] + rng.uniform() * (path[chord + 1] - path[chord])
    R, p = kinematics.joint_poses(q[None])
    item = items[rng.choice([i for i, item in enumerate(items) if item.joint != WORLD])]
    turned = R[0, item.joint] @ item.place.R
    moved = R[0, item.joint] @ item.place.p + p[0, item.joint]
    way = rng.normal(size=3)
    far = moved + turned @ item.form.middle + 2 * way / np.linalg.norm(way)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    here, there = coal.Transform3s(turned, moved), coal.Transform3s(np.eye(3), far)
    coal.distance(item.form.shape, here, coal.Sphere(0.001), there, request, result)
    on = np.array(result.getNearestPoint1())
    normal = (far - on) / np.linalg.norm(far - on)
    size = WIRE if rng.random() < 0.5 else PLATE
    across = np.cross(normal, rng.normal(size=3))
    across /= np.linalg.norm(across)
    frame = np.stack([normal, across, np.cross(normal, across)], axis=1)
    overlap = CLEARANCE if rng.random() < 0.5 else rng.uniform(CLEARANCE, 0.0005)
    along = frame @ np.array([size[0] / 2 - overlap, *(rng.uniform(-0.4, 0.4, 2) * size[1:])])
    pose = tuple((on + along).tolist()), tuple(Rotation.from_matrix(frame).as_quat().tolist())
    return Obstacle(Shape.BOX, *pose, size, name="thin"), chord


def missed(robot: UrdfRobot, seed: int, paths: int, each: int, step: float) -> int:
    """Return how many of thin bodies planted across proven paths are not found, or only after their chord."""
    rng, found = np.random.default_rng(seed), 0
    for _ in range(paths):
        path = random_path(robot, rng, 12, step)
        for _ in range(each):
            thin, chord = planted(robot, path, rng)
            contact = contacts(robot, [thin]).check(path).contact
            found += contact is None or contact.chord > chord or "thin" not in (contact.first, contact.second)
    return found


@pytest.mark.parametrize("step", [0.05, 0.5])
def test_thin_bodies_are_found(step):
    """Wires and plates of 1 mm that a body of an arm meets by 0.1 to 0.5 mm anywhere on its path are found there."""
    assert missed(PANDA, 1, 5, 10, step) == 0


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "paths", "each"), [(PANDA, 40, 25), (BAXTER, 10, 20)], ids=["panda", "baxter"])
def test_a_thousand_thin_bodies_are_found(robot, paths, each):
    """None of a thousand is missed, on chords from 0.02 to 0.5 rad."""
    counts = [missed(robot, 10 + k, paths // 4 + 1, each, step) for k, step in enumerate((0.02, 0.05, 0.2, 0.5))]
    assert sum(counts) == 0
