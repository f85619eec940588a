"""One small arm among one obstacle of each shape."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.recording import Recording, time_parameterise
from pipeline.robots import Obstacle, Robot, Shape

TURN = (0.1, -0.2, 0.3, 0.9)  # (x, y, z, w), not of unit length


def make_recording(**changes) -> Recording:
    model = pin.buildSampleModelManipulator()
    bound = np.full(model.nq, np.pi)
    robot = Robot("sample arm", model, pin.GeometryModel(), -bound, bound)
    rng = np.random.default_rng(5)
    states = np.cumsum(rng.normal(scale=0.1, size=(12, model.nq)), axis=0)
    states[6] = states[5]
    recording = Recording(
        robot=robot,
        obstacles=(
            Obstacle(Shape.BOX, (1.0, 0.2, 0.3), TURN, (0.4, 0.2, 0.6)),
            Obstacle(Shape.SPHERE, (-1.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0), (0.3, 0.3, 0.3)),
            Obstacle(Shape.CYLINDER, (0.0, 1.0, 0.5), TURN, (0.2, 0.2, 0.8)),
        ),
        states=states,
        times=time_parameterise(states, 0.5),
        tool="effector_body",
        start=states[0],
        goal=states[-1],
        counters={"status": "solved", "iterations": 41, "path_length": 1 / 3, "clearance": 0.25, "claimed": True},
        metadata={"planner": "rrtconnect", "sampler": "uniform", "seed": "7"},
        versions={"python": "3.11.7", "numpy": "2.0"},
        attachments={"config": {"b": [1, 2.5], "a": None}, "problem": {"start": states[0].tolist()}},
        files={"robot.urdf": "<robot name='Jürgen'/>".encode("latin-1"), "problem.yaml": b"seed: 7\n", "empty": b""},
        manifold_sphere_radius=1.5,
    )
    return replace(recording, **changes)


@pytest.fixture
def recording() -> Recording:
    return make_recording()


@pytest.fixture
def make():
    return make_recording
