"""Which pictures an environment's page has: globes on a sphere, else a robot among its obstacles."""

import numpy as np
import pandas as pd
import pytest

from pipeline.errors import ArtifactError
from pipeline.reporting import robot_stills
from pipeline.spec.scene import Split, flatten
from tests.environments.published import published
from tests.reporting.synthetic import make_trials


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A scene of a Panda, trials of it, its paths, and what was drawn."""
    environment = published("transport_panda")
    (scene,) = environment.scenes({Split.TEST: 1})
    trials = make_trials(3, ("transport",), ("CoMPNetX-RRTConnect", "RRTConnect"), ("projection",))
    trials = trials.assign(scene=scene.name, solved=True, path_length=[1.0, 2.0, 3.0] * 2)
    ends = environment.tasks(scene, 1).iloc[0]
    path = np.linspace(ends["start"], ends["goal"], 5)
    columns = ["scenario", "scene", "problem", "leg", "method", "adherence"]
    paths = pd.DataFrame([{**row, **flatten(path)} for row in trials[columns].to_dict("records")])
    folder = tmp_path_factory.mktemp("page") / "transport_panda"
    return scene, trials, paths, folder, robot_stills(trials, paths, {scene.name: scene}, folder, plain=True)


def test_the_path_of_median_length_is_drawn(drawn):
    """One picture of the scenario, of the problem of median length, and the caption says which."""
    scene, trials, _, folder, pictures = drawn
    picture = pictures["transport"]
    median = int(trials.loc[(trials["path_length"] == 2.0), "problem"].iloc[0])
    assert f"CoMPNetX-RRTConnect with projection, {scene.name}, problem {median}" in picture.caption
    assert "3 paths it found" in picture.caption and "matplotlib" in picture.caption
    assert (folder / "paths_transport.png").stat().st_size > 10_000


def test_a_missing_path_or_scene_is_an_error(drawn):
    """A solved trial without a path, and a path in a scene that is not there."""
    scene, trials, paths, folder, _ = drawn
    with pytest.raises(ArtifactError, match="none of CoMPNetX-RRTConnect with projection"):
        robot_stills(trials, paths[paths["method"] == "RRTConnect"], {scene.name: scene}, folder, plain=True)
    with pytest.raises(ArtifactError, match="no scene"):
        robot_stills(trials, paths, {}, folder, plain=True)
    assert robot_stills(trials.assign(solved=False), paths, {}, folder, plain=True) == {}
