"""A user's problem files as an environment: each is a task, and what cannot be one is named before work starts."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from pipeline.config import ROOT
from pipeline.environments import FolderEnvironment
from pipeline.errors import ConfigError, PipelineError, ProblemError
from pipeline.spec.codec import encode
from pipeline.spec.scene import Split, read_scenes, write_scenes
from pipeline.verification.judge import Judge

EXAMPLE = Path("examples", "my_arm")
URDF = EXAMPLE / "my_arm.urdf"
COUNTS = {Split.TRAIN: 1, Split.VALIDATION: 1, Split.TEST: 1}


def lay_out(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the example's files below a folder and work there; return the folder of the problems."""
    shutil.copytree(ROOT / EXAMPLE, place / EXAMPLE)
    monkeypatch.chdir(place)
    runpy.run_path(str(EXAMPLE / "make_problems.py"))["main"](Path("problems"))
    return Path("problems")


@pytest.fixture
def problems(tmp_path, monkeypatch) -> Path:
    return lay_out(tmp_path, monkeypatch)


def environment(folder: Path, **changes) -> FolderEnvironment:
    return FolderEnvironment(**{"name": "mine", "folder": folder, "margin": 0.005, "self_margin": 0.002,
                                "files": (URDF,), **changes})  # fmt: skip


def change(path: Path, **entries) -> None:
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **entries}))


def sources(folder: Path) -> dict[str, dict[str, str]]:
    return {scene.name: dict(scene.sources) for scene in environment(folder).scenes(COUNTS)}


def test_every_file_is_a_task_whatever_the_counts(problems):
    """Files of a split with equal obstacles are tasks of one scene; numbers of a profile change neither."""
    found = environment(problems).scenes(COUNTS)
    assert [scene.name for scene in found] == [
        *(f"train-scene_{i:03d}_000" for i in range(4)),
        *("validation-scene_000_000", "validation-scene_001_000", "test-scene_000_000", "test-scene_001_000"),
    ]
    assert [s.name for s in environment(problems).scenes(dict.fromkeys(Split, 100))] == [s.name for s in found]
    assert {scene.scenario for scene in found} == {"mine"}
    assert len({str(encode(scene.legs)) for scene in found}) == 8
    one, two = environment(problems).tasks(found[0], 1), environment(problems).tasks(found[0], 99)
    assert len(one) == len(two) == 2 and list(one["problem"]) == [0, 1]
    for column in ("start", "goal"):
        assert [q.tobytes() for q in one[column]] == [q.tobytes() for q in two[column]]


def test_starts_and_goals_are_where_the_files_say(problems):
    """By pinocchio's own reading of the URDF the hand is where each file says, pointing down; the verifier agrees."""
    model = pin.buildModelFromUrdf(str(URDF))
    data, hand = model.createData(), model.getFrameId("hand", pin.FrameType.BODY)
    for scene in environment(problems).scenes(COUNTS)[-2:]:
        (row,) = environment(problems).tasks(scene, 1).itertuples()
        content = yaml.safe_load((problems / "test" / f"{scene.name.removeprefix('test-')}.yaml").read_text())
        for which in ("start", "goal"):
            q, asked = np.array(getattr(row, which)), content[which]["region"]
            pin.framesForwardKinematics(model, data, q)
            np.testing.assert_allclose(data.oMf[hand].translation, [asked[axis] for axis in "xyz"], atol=1e-3)
            np.testing.assert_allclose(data.oMf[hand].rotation[:, 2], [0, 0, -1], atol=2e-3)
            assert Judge(scene.statement).verify(q[None], q, q).passed


def test_scenes_are_the_same_bytes_in_any_folder(tmp_path, monkeypatch):
    """Two working folders, wherever they are, give scene files that are equal to the byte, and read back as written."""
    written = []
    for place in (tmp_path / "a", tmp_path / "far" / "away"):
        folder = lay_out(place, monkeypatch)
        found = environment(folder.resolve(), files=(place / EXAMPLE,)).scenes(COUNTS)
        write_scenes(found, place)
        read = read_scenes(place)
        assert [(s.legs, s.sources) for s in read.values()] == [(s.legs, s.sources) for s in found]
        written.append((place / "scenes.jsonl").read_bytes())
    assert written[0] == written[1] and str(tmp_path).encode() not in written[0]


def test_sources_tell_what_changed(problems):
    """A comment changes no scene, a goal that of its file, and the robot's description all of them."""
    before = sources(problems)
    path = problems / "train" / "scene_000_001.yaml"
    path.write_text("# Indeed.\n" + path.read_text())
    assert sources(problems) == before
    change(path, goal={"region": {"x": 0.4, "y": 0.3, "z": 0.3}})
    after = sources(problems)
    assert {name for name in before if before[name] != after[name]} == {"train-scene_000_000"}
    URDF.write_text(URDF.read_text().replace('radius="0.07"', 'radius="0.071"'))
    assert all(found[str(URDF)] != after[name][str(URDF)] for name, found in sources(problems).items())


def test_the_environments_margin_counts(problems):
    """What a file says of margins changes nothing; a start that the environment's margin forbids is refused."""
    (path,) = problems.glob("test/scene_000_*.yaml")
    scene = next(s for s in environment(problems).scenes(COUNTS) if s.name.startswith("test"))
    row = environment(problems).tasks(scene, 1).iloc[0]
    change(path, margin=1.0, **{which: {"configuration": row[which].tolist()} for which in ("start", "goal")})
    assert environment(problems).tasks(scene, 1).iloc[0]["start"].tolist() == row["start"].tolist()
    with pytest.raises(ProblemError, match=rf"{path}: start is in collision: .* with a margin of 0\.3 m"):
        environment(problems, margin=0.3).tasks(scene, 1)


@pytest.mark.parametrize(
    ("entries", "kind", "said"),
    [
        ({"goals": "many"}, ProblemError, "goals is 'many'"),
        ({"constraints": [{"kind": "uprigt"}]}, ProblemError, "did you mean 'upright'"),
        ({"robot": "panda"}, ProblemError, "another robot than problems/train/scene_000_000.yaml"),
        ({"obstacles": [{"shape": "mesh", "size": 1, "file": "no.stl"}]}, PipelineError, "no.stl"),
    ],
)
def test_a_wrong_file_is_named_with_the_scenes(problems, entries, kind, said):
    """A file that is no problem, or one of another robot, ends the making of scenes, and the message names it."""
    path = problems / "validation" / "scene_001_000.yaml"
    change(path, **entries)
    with pytest.raises(kind, match=f"{path}.*{said}"):
        environment(problems).scenes(COUNTS)


def test_a_goal_out_of_reach_is_named(problems):
    """So is one whose goal inverse kinematics does not find, with the tasks."""
    path = problems / "test" / "scene_001_000.yaml"
    change(path, goal={"region": {"x": 4.0, "y": 0.0, "z": 0.3}})
    scene = environment(problems).scenes(COUNTS)[-1]
    with pytest.raises(ProblemError, match=f"{path}: goal: inverse kinematics found no configuration"):
        environment(problems).tasks(scene, 1)


def test_a_file_whose_name_is_none_for_scenes_is_refused(problems):
    """Shards and recordings are named after problem files: one with a blank or another sign in its name is refused."""
    path = problems / "train" / "scene_000_001.yaml"
    path.rename(path.with_name("scene 1.yaml"))
    with pytest.raises(ConfigError, match=r"the name of problem file problems/train/scene 1\.yaml is 'scene 1'"):
        environment(problems).scenes(COUNTS)


def test_what_dvc_would_not_see_is_refused(problems, monkeypatch):
    """A split without a file, and a file that problems read but the environment does not name, are refused by name."""
    with pytest.raises(ConfigError, match=f"reads {URDF}, which is not in problems: name it in .*files"):
        environment(problems, files=()).scenes(COUNTS)
    assert environment(problems, files=(EXAMPLE,)).scenes(COUNTS)
    shutil.rmtree(problems / "validation")
    with pytest.raises(ConfigError, match=r"problems/validation holds no problem file.*problems/train, .*/test needs"):
        environment(problems).scenes(COUNTS)
    with pytest.raises(ConfigError, match=r"environment\.margin is -1"):
        environment(problems, margin=-1.0)
