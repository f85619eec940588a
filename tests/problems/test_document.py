"""Problem files are read as they are written: nothing twice, nothing converted, and changes change what they name."""

from collections.abc import Iterator
from copy import deepcopy
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from omegaconf import OmegaConf

from pipeline.config import compose
from pipeline.errors import ConfigError, PipelineError, ProblemError
from pipeline.manifolds import AdherenceParameters
from pipeline.planners import PLANNERS
from pipeline.problems import ProblemFile, read_problem
from pipeline.problems.document import read_yaml
from pipeline.problems.file import choice
from pipeline.robots import ROBOTS
from pipeline.samplers.uniform import UniformParameters

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.yaml"))
UPRIGHT = ROOT / "examples" / "upright_panda.yaml"


def written(folder: Path, content: Any) -> Path:
    """A problem file with this content."""
    path = folder / "problem.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def numbers(content: Any, at: tuple = ()) -> Iterator[tuple]:
    """Where the numbers of a content are: keys and indices from the outside."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in pairs:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield (*at, key)
        yield from numbers(value, (*at, key))


def put(content: Any, at: tuple, value: Any) -> Any:
    """The content with another value at a place."""
    content = deepcopy(content)
    inner = content
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return content


def whole(path: Path) -> dict[str, Any]:
    """The content of an example with everything in it that may be named or left out, and is a number."""
    content = yaml.safe_load(path.read_text())
    for group, name in (("planner", "rrtconnect_arm"), ("sampler", "directions"), ("adherence", "projection_arm")):
        content[group] = yaml.safe_load((ROOT / "conf" / group / f"{name}.yaml").read_text())
    settings = {"time_limit": 1.0, "margin": 0.01, "self_margin": 0.0, "shortcuts": 3, "goals": 2, "spacing": 0.02}
    return {**content, **settings, "speed": 0.5, "seed": 1}


def taken(file: ProblemFile, folder: Path) -> None:
    """Have everything that a file says converted, without planning."""
    file.parts()
    for body in (*file.obstacles, *file.grasps):
        body.obstacle(folder)
    for region in (
        *(file.chain.regions if file.chain else ()),
        *(e.region for e in (file.start, file.goal) if e.region),
    ):
        region.region()
    choice(file.robot, "robot").make(ROBOTS, "robot")
    choice(file.planner, "planner").make(PLANNERS, "planner")
    choice(file.sampler, "sampler").make({"uniform": UniformParameters}, "sampler")
    choice(file.adherence, "adherence").make({"projection": AdherenceParameters}, "adherence")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_only_numbers_are_numbers(path, tmp_path):
    """Wherever an example has a number, a boolean by any of its names, or text, is refused."""
    content = whole(path)
    places = list(numbers(content))
    taken(read_problem(written(tmp_path, content)), path.parent)
    assert len(places) > 20
    accepted = []
    for place, word in zip(places, cycle(["true", "no", "'0.5'", "on", "{}"])):
        text = yaml.safe_dump(put(content, place, "@")).replace("'@'", word)
        try:
            taken(read_problem(written(tmp_path, text)), path.parent)
            accepted.append((place, word))
        except PipelineError:
            pass
    assert not accepted


TWICE = {
    "at the top": ("robot: panda\nseed: 1\nrobot: sawyer\n", "key 'robot' twice, on lines 1 and 3"),
    "inside": ("goal:\n  region:\n    x: 1\n    y: 2\n    x: 3\n", "key 'x' twice, on lines 3 and 5"),
    "in a list": ("obstacles:\n  - {name: a,\n     size: 1, name: b}\n", "key 'name' twice, on lines 2 and 3"),
    "quoted": ("'seed': 1\nseed: 2\n", "key 'seed' twice, on lines 1 and 2"),
    "no word": ("goal:\n  joints:\n    on: 0.3\n", "key on on line 3, which YAML takes for no word: put it in quotes"),
    "a number": ("goal:\n  joints: {1: 0.3}\n", "key 1 on line 2"),
    "nothing": ("goal:\n  joints: {~: 0.3}\n", "key ~ on line 2"),
    "a list as key": ("goal:\n  ? [a, b]\n  : 0.3\n", "key a list or mapping on line 2"),
}


@pytest.mark.parametrize("case", TWICE)
def test_keys_are_words_and_once(case, tmp_path):
    """A key that stands twice, or that YAML makes something else of than a word, is refused with its lines."""
    text, message = TWICE[case]
    with pytest.raises(ProblemError, match=message):
        read_problem(written(tmp_path, text))


def test_numbers_are_what_they_look_like(tmp_path):
    """Numbers are decimal, with or without a point before the exponent; clock times and dates are none."""
    said = "{a: 010, b: 1e-3, c: -2.5E+2, d: .5, e: 7., f: -.inf, g: 1:30, h: 0x10, i: '1', j: &x 3, k: *x, l: 1_000}"
    found = read_yaml(written(tmp_path, said))
    assert found == {
        **{"a": 10, "b": 0.001, "c": -250.0, "d": 0.5, "e": 7.0, "f": -np.inf, "g": "1:30", "h": "0x10", "i": "1"},
        **{"j": 3, "k": 3, "l": "1_000"},
    }
    assert read_yaml(written(tmp_path, "a: &b {x: 1, y: 2}\nc: {<<: *b, x: 3}\n"))["c"] == {"x": 3, "y": 2}
    for path in (*EXAMPLES, *(ROOT / "conf").rglob("*.yaml")):
        assert read_yaml(path) == yaml.safe_load(path.read_text()), path


def inside_mappings(place: tuple) -> bool:
    return all(isinstance(key, str) for key in place)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_a_changed_entry_is_an_edited_file(path, tmp_path):
    """A change of one entry, however deep, is the file with that entry edited, and nothing else is lost."""
    content = whole(path)
    start = written(tmp_path, content)
    for place in filter(inside_mappings, numbers(content)):
        value = 0.01 if isinstance(eval_at(content, place), float) else 7
        change: Any = value
        for key in reversed(place):
            change = {key: change}
        changed = read_problem(start, **change)
        other = tmp_path / "edited.yaml"
        other.write_text(yaml.safe_dump(put(content, place, value)))
        assert changed == read_problem(other)


def eval_at(content: Any, place: tuple) -> Any:
    for key in place:
        content = content[key]
    return content


def typed(*overrides: str) -> dict[str, Any]:
    """The changes that a command line gives."""
    found: Any = OmegaConf.to_container(compose("plan", list(overrides)).changes)
    return found


def test_nothing_takes_an_entry_out():
    """An empty value on the command line, null, or None frees that entry alone; names that are none are refused."""
    path = ROOT / "examples" / "height_panda.yaml"
    plain = read_problem(path)
    for change in (
        typed("+changes.goal.region.x="),
        typed("+changes.goal.region.x=null"),
        {"goal": {"region": {"x": None}}},
    ):
        found = read_problem(path, **change)
        assert found.goal.region.x is None and found.goal.region.y == plain.goal.region.y == 0.3
        assert found.start == plain.start
    assert read_problem(path, **typed("+changes.obstacles=")).obstacles == ()
    assert (
        read_problem(path, **typed("+changes.goal.region=", "+changes.goal.pose.xyz=[0.4,0,0.3]")).goal.pose is not None
    )
    for change, message in (
        ("+changes.goal.region.xx=", "goal.region has no entry .* 'xx' .did you mean 'x'"),
        ("+changes.gaol=", "the problem has no entry .* 'gaol' .did you mean 'goal'"),
        ("+changes.start.values.panda_joint9=", "start.values has no entry"),
        ("+changes.goal.region.xx=1", "unknown key 'xx'"),
        ("+changes.goal.pose.xyz=[0.4,0,0.3]", "this one has pose, region; .* left out"),
        ("+changes.start=", "lacks start"),
        ("+changes.folder=/", "unknown key 'folder'"),
    ):
        with pytest.raises(ConfigError, match=message):
            read_problem(path, **typed(change))


def test_choices_are_changed_inside_or_replaced():
    """Parameters of a choice that the file names can be changed one by one; with a kind it is another choice."""
    file = read_problem(
        UPRIGHT,
        **typed("+changes.adherence.parameters.resolution=0.02", "+changes.robot.parameters.geometry=primitives"),
    )
    there = yaml.safe_load((ROOT / "conf" / "adherence" / "projection_arm.yaml").read_text())
    assert choice(file.adherence, "adherence").parameters == {**there["parameters"], "resolution": 0.02}
    assert choice(file.robot, "robot").parameters["geometry"] == "primitives"
    assert len(choice(file.robot, "robot").parameters["joints"]) == 7
    other = read_problem(UPRIGHT, adherence={"kind": "projection", "parameters": {"step": 0.04}})
    assert choice(other.adherence, "adherence").parameters == {"step": 0.04}


SAYS_NOTHING = {
    "frame of joints": ({"start": {"joints": {}, "frame": "panda_hand"}}, "frame is 'panda_hand' beside joints"),
    "frame of values": (
        {"goal": {"values": {"panda_joint1": 0.1}, "frame": "panda_hand"}},
        "frame is .* beside values",
    ),
    "projected pose": ({"goal": {"pose": {}, "project": True}}, "project says nothing beside pose"),
    "projected values": ({"goal": {"values": {"panda_joint1": 0.1}, "project": True}}, "project says .* beside values"),
}


@pytest.mark.parametrize("case", SAYS_NOTHING)
def test_what_says_nothing_is_refused(case, tmp_path):
    """Entries of a start or goal that would do nothing beside the others are refused, not ignored."""
    change, message = SAYS_NOTHING[case]
    with pytest.raises(ConfigError, match=message):
        read_problem(written(tmp_path, {**yaml.safe_load(UPRIGHT.read_text()), **change}))


def test_a_file_of_a_box_is_refused(tmp_path):
    """A shape that is of no file refuses one."""
    box = {"name": "b", "shape": "box", "size": 0.1, "file": "b.stl"}
    file = read_problem(written(tmp_path, {**yaml.safe_load(UPRIGHT.read_text()), "obstacles": [box], "grasps": []}))
    with pytest.raises(ProblemError, match=r"box 'b' has the file 'b\.stl'"):
        file.obstacles[0].obstacle(tmp_path)


def test_one_sided_bounds_may_be_null(tmp_path):
    """A bound that is null is none, on either side."""
    content = {
        **yaml.safe_load(UPRIGHT.read_text()),
        "goal": {"region": {"x": [None, 0.5], "yaw": [0.2, None], "y": 0.1}},
    }
    region = read_problem(written(tmp_path, content)).goal.region.region()
    assert region.lower[0] == -np.inf and region.upper[0] == 0.5 and region.upper[5] == np.inf
