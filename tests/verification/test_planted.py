"""Thin bodies planted across proven paths are found: none is missed, down to the stated clearance."""

import coal
import numpy as np
import pytest
from arms import BAXTER, PANDA, STICK, UR5, Tool, contacts, known, random_path
from scipy.spatial.transform import Rotation

from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.verification.kinematics import WORLD
from pipeline.verification.verdict import CLEARANCE

WIRE, PLATE = (0.001, 0.001, 0.3), (0.001, 0.06, 0.06)  # their first side is the thin one [m]


def planted(robot: UrdfRobot, path: np.ndarray, rng: np.random.Generator, carried: Tool) -> tuple[Obstacle, int]:
    """Return a thin body that overlaps a body of the robot somewhere along a path, by CLEARANCE or more, and its chord.

    The point it is put at is the surface point, by coal, that is nearest to a far point in a random direction.
    """
    kinematics, items, _ = known(robot, carried)
    chord = int(rng.integers(len(path) - 1))
    q = path[chord] + rng.uniform() * (path[chord + 1] - path[chord])
    R, p = kinematics.joint_poses(q[None])
    moving = [item for item in items if item.joint != WORLD]
    item = moving[-1] if carried else moving[rng.integers(len(moving))]
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


def missed(robot: UrdfRobot, seed: int, paths: int, each: int, step: float, carried: Tool = ()) -> int:
    """Return how many of thin bodies planted across proven paths are not found, or only after their chord."""
    rng, found = np.random.default_rng(seed), 0
    for _ in range(paths):
        path = random_path(robot, rng, 12, step, carried)
        for _ in range(each):
            thin, chord = planted(robot, path, rng, carried)
            contact = contacts(robot, [thin], carried=carried).check(path).contact
            found += contact is None or contact.chord > chord or "thin" not in (contact.first, contact.second)
    return found


@pytest.mark.parametrize("step", [0.05, 0.5])
def test_thin_bodies_are_found(step):
    """Wires and plates of 1 mm that a body of an arm meets by 0.1 to 0.5 mm anywhere on its path are found there."""
    assert missed(PANDA, 1, 5, 10, step) == 0


@pytest.mark.parametrize("step", [0.05, 0.5])
def test_thin_against_thin(step):
    """A stick of 1 mm in the hand does not pass wires and plates of 1 mm unseen."""
    assert missed(PANDA, 2, 5, 10, step, (STICK,)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "carried", "paths"),
    [(PANDA, (), 10), (PANDA, (STICK,), 5), (BAXTER, (), 3), (UR5, (), 5)],
    ids=["panda", "stick", "baxter", "meshes"],
)
def test_a_thousand_thin_bodies_are_found(robot, carried, paths):
    """None of 2300 is missed, on chords from 0.02 to 0.5 rad."""
    counts = [missed(robot, 10 + k, paths, 25, step, carried) for k, step in enumerate((0.02, 0.05, 0.2, 0.5))]
    assert sum(counts) == 0
