"""Families as environments of the pipeline: the same scenes and tasks whatever the counts, and none of them wrong."""

import numpy as np
import pytest

from pipeline.environments import FamilyEnvironment
from pipeline.errors import ConfigError
from pipeline.spec.codec import encode
from pipeline.spec.scene import Split
from pipeline.tasks import set_up
from pipeline.verification.judge import Judge
from tests.environments.published import published

FEW = {Split.TRAIN: 2, Split.VALIDATION: 1, Split.TEST: 1}
MORE = {Split.TRAIN: 3, Split.VALIDATION: 2, Split.TEST: 1}


@pytest.fixture(scope="module")
def environment() -> FamilyEnvironment:
    return published("transport_panda")


def test_scenes_do_not_depend_on_how_many(environment):
    """A smaller profile has the first scenes of a larger one, no two are alike, and splits share none."""
    few, more = ({scene.name: scene for scene in environment.scenes(counts)} for counts in (FEW, MORE))
    assert len(few) == 4 and len(more) == 6 and set(few) < set(more)
    for name, scene in few.items():
        assert encode(scene.legs) == encode(more[name].legs) and scene.split is more[name].split
    assert len({str(encode(scene.legs)) for scene in more.values()}) == 6
    assert {scene.scenario for scene in more.values()} == {"transport"}


def test_tasks_are_right_and_do_not_depend_on_how_many(environment):
    """The first tasks are the same for every count; the verifier and our checker accept every start and goal."""
    for scene in environment.scenes(FEW):
        four, two = environment.tasks(scene, 4), environment.tasks(scene, 2)
        assert len(environment.tasks(scene, 0)) == 0 and list(four["problem"]) == [0, 1, 2, 3]
        for column in ("start", "goal"):
            np.testing.assert_array_equal(np.stack(four[column][:2]), np.stack(two[column]))
        ends = np.concatenate([np.stack(four["start"]), np.stack(four["goal"])])
        assert len(np.unique(ends, axis=0)) == 8
        assert set_up(scene.statement).validity(environment.margin, environment.self_margin).free_rows(ends).all()
        for q in ends:
            verdict = Judge(scene.statement).verify(q[None], q, q)
            assert verdict.passed, verdict.message


def test_another_seed_has_other_scenes(environment):
    """Seeds share no scene."""
    other = FamilyEnvironment("other", "transport", environment.robot, environment.seed + 1, 0.005, 0.002)
    both = [*environment.scenes(FEW), *other.scenes(FEW)]
    assert len({str(encode(scene.legs)) for scene in both}) == 8


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"family": "transports"}, "environment.family is 'transports'; choices: transport"),
        ({"seed": -1}, "environment.seed is -1"),
        ({"margin": float("nan")}, "environment.margin is nan"),
    ],
)
def test_wrong_parameters_are_named(environment, parameters, said):
    """What is wrong is said before a scene is made."""
    right = {"name": "x", "family": "maze", "robot": None, "seed": 0, "margin": 0.005, "self_margin": 0.0}
    with pytest.raises(ConfigError, match=said):
        FamilyEnvironment(**{**right, **parameters})
