"""One network learns tasks of several robots and constraints: with 3, 7 and 9 variables, one of them with a hinge."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from small_training import SMALL, make_data

from pipeline.environments.door import DoorOpening
from pipeline.environments.transport import UprightTransport
from pipeline.learning.compnetx import Compnetx, CompnetxNetwork, CompnetxParameters, CompnetxSampler, Layers, Model
from pipeline.learning.compnetx.batches import Batches
from pipeline.learning.compnetx.learner import CompnetxLearner
from pipeline.learning.compnetx.recipe import CompnetxRecipe, train_compnetx
from pipeline.learning.engine import TrainParameters
from pipeline.manifolds import make_adherence
from pipeline.samplers import Asked
from pipeline.schema import Choice
from pipeline.spec.scene import Scene, Split, flatten
from pipeline.spec.statement import OnSphere, Point, Statement
from pipeline.tasks import set_up
from tests.robots.named import settings

RECIPE = CompnetxRecipe(
    layers=Layers(scene_hidden=8, scene_code=8, task_hidden=8, task_code=8, hidden=(16, 8), dropout_layers=2),
    centre=True,
    spacing=0.5,
    reverse=True,
)
POINT = Point(0.001, (-1.1,) * 3, (1.1,) * 3)


def statements() -> list[Statement]:
    """Of a point on a sphere, of a hand that stays level, and of doors."""
    door, transport = DoorOpening(settings("panda")), UprightTransport(settings("panda"))
    arms = [family.scene(i, np.random.default_rng(i))[0] for family in (door, transport) for i in range(2)]
    return [*arms, *(Statement(POINT, (OnSphere("point", 1.0),)) for _ in range(2))]


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    """Two of each: one to learn from and one to validate."""
    found = [
        Scene("any", f"scene-{i}", Split.VALIDATION if i % 2 else Split.TRAIN, (statement,))
        for i, statement in enumerate(statements())
    ]
    return {scene.name: scene for scene in found}


@pytest.fixture(scope="module")
def model(scenes, tmp_path_factory) -> Model:
    rng, rows = np.random.default_rng(0), []
    for scene in scenes.values():
        setup = set_up(scene.statement)
        for problem in range(3):
            path = rng.uniform(*setup.robot.box, (2, setup.robot.dimension))
            head = {"scene": scene.name, "problem": problem, "split": scene.split.value, "solved": True}
            rows.append({**head, **flatten(path)})
    voxels = {name: rng.random((11, 11, 11)) < 0.3 for name in scenes}
    parameters = TrainParameters(epochs=2, batch_size=16, seed=1)
    made, trained = train_compnetx(
        RECIPE, parameters, scenes, voxels, pd.DataFrame(rows), tmp_path_factory.mktemp("runs")
    )
    assert trained.metrics["train_scenes"] == 3 and np.isfinite(trained.metrics["val_loss"])
    return made


def test_sizes_follow_from_the_tasks(model):
    """The network is as wide as the task with most variables, and is told of which kind a task is."""
    assert [kind.codec.dimension for kind in model.kinds] == [9, 7, 3]
    assert model.parameters.width == 9
    assert model.parameters.task_input >= 3 + 1  # a hinge stands elsewhere in every scene


def test_samples_are_of_their_task(scenes, model):
    """In each scene the sampler gives configurations of its own robot on its own manifold."""
    network = CompnetxNetwork(model)
    voxels = dict.fromkeys(scenes, np.zeros((11, 11, 11), bool))
    for name in ("scene-0", "scene-2", "scene-4"):
        setup = set_up(scenes[name].statement)
        space = make_adherence(Choice("projection"), setup.constraint, setup.validity())
        rng = np.random.default_rng(0)
        ends = rng.uniform(*setup.robot.box, (2, setup.robot.dimension))
        sampler = CompnetxSampler(network, voxels, CompnetxParameters(batch=40))
        sampler.begin(Asked(space, ends[0], ends[1], name), rng)
        found = sampler.sample(np.repeat(ends[:1], 40, axis=0), np.repeat(ends[1:], 40, axis=0))
        assert found.shape[1] == setup.robot.dimension
        assert len(found) or name == "scene-0"  # few configurations lead to a handle
        assert all(setup.constraint.satisfied(q) for q in found)


def test_what_a_task_has_not_is_not_learned():
    """Numbers beyond those of a task are no part of the loss, whatever they are."""
    data = make_data()
    used = np.arange(3) < np.array([[2], [3], [2], [2], [3]])
    torch.manual_seed(0)
    network = Compnetx(SMALL)
    losses = []
    for beyond in (0.0, 7.0):
        following = np.where(used[data.train.scene], data.train.following, np.float32(beyond)).astype(np.float32)
        pairs = replace(data.train, following=following)
        learner = CompnetxLearner(network, replace(data, used=used, train=pairs), 0.01)
        batch = next(iter(Batches(pairs, SMALL, 64, 0, lambda: 0)))
        losses.append(learner.terms(batch)["loss"].item())
    assert losses[0] == losses[1] > 0
