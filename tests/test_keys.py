"""Keys of resumable work: whatever can change a result changes them, and nothing else does."""

import itertools
import re
import sys
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from pipeline import keys
from pipeline.config import ROOT
from pipeline.errors import ArtifactError
from pipeline.keys import code_digest, digest


class Colour(Enum):
    RED = 1
    BLUE = 2


class Paint(Enum):
    RED = 1


@dataclass(frozen=True)
class Ring:
    radius: float
    colour: Colour = Colour.RED


@dataclass(frozen=True)
class Disc:
    radius: float
    colour: Colour = Colour.RED


def test_digest_depends_on_content_only(tmp_path):
    """Equal files and values have equal digests whatever their names and key order; any change makes another one."""
    for name, text in (("a", "x"), ("b", "x"), ("c", "y")):
        (tmp_path / name).write_text(text)
    same = digest({"p": 1, "q": [2.5]}, tmp_path / "a")
    assert same == digest({"q": (2.5,), "p": 1}, tmp_path / "b")
    others = [
        digest({"p": 1, "q": [2.5]}, tmp_path / "c"),
        digest({"p": 2, "q": [2.5]}, tmp_path / "a"),
        digest(tmp_path / "a", {"p": 1, "q": [2.5]}),
        digest({"p": 1, "q": [2.5]}),
    ]
    assert len({same, *others}) == 5
    assert re.fullmatch("[0-9a-f]{16}", same)
    with pytest.raises(ArtifactError, match="make repro"):
        digest(tmp_path / "absent")


LARGE = np.zeros(100_000)  # numpy prints its first and last three numbers
LATER = np.array([0.0] * 50_000 + [1e-300] + [0.0] * 49_999)


@pytest.mark.parametrize(
    "values",
    [
        (LARGE, LATER, LARGE.astype(np.float32), LARGE.reshape(2, -1), LARGE.tolist(), str(LARGE)),
        ({"deep": [LARGE]}, {"deep": [LATER]}),
        (np.array([1.0]), np.array([1.0 + 1e-15]), np.array([1]), [1.0], 1.0),
        (np.array([0.0]), np.array([-0.0])),
        (np.array([{"a": LARGE}], dtype=object), np.array([{"a": LATER}], dtype=object)),
        (1, True, "1", 1.5, "1.5", None, "None", [1], {"1": 1}, {1: 1}, {1}, b"1", Path("1")),
        (0.1, 0.1 + 1e-16, -0.1, float("nan"), float("inf"), float("-inf"), 0.0, -0.0),
        (Colour.RED, Colour.BLUE, Paint.RED, "RED", 1, "Colour.RED"),
        (Ring(1.0), Ring(2.0), Disc(1.0), Ring(1.0, Colour.BLUE), {"radius": 1.0, "colour": Colour.RED}),
        ([1, [2, 3]], [[1, 2], 3], [1, 2, 3]),
        ({"a": {"b": 1}}, {"a": {}, "b": 1}, {"mapping": [["a", 1]]}, {"a": 1}),
        (Path("a/b"), Path("a"), "a/b"),
    ],
)
def test_different_values_have_different_digests(values):
    """No two values that differ anywhere, by type, shape or last bit, have the same digest."""
    found = [digest([value]) for value in values]  # a bare Path would stand for a file
    for (i, one), (j, other) in itertools.combinations(enumerate(found), 2):
        assert one != other, (values[i], values[j])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (LATER, LATER.copy()),
        (LATER.reshape(2, -1).T, np.ascontiguousarray(LATER.reshape(2, -1).T)),
        ([1, 2], (1, 2)),
        ({"a": 1, 2: LARGE}, {2: LARGE.copy(), "a": 1}),
        ({3, 1, 2}, {1, 2, 3}),
        (np.float64(0.1), 0.1),
        (np.int32(7), 7),
        (Ring(1.0), Ring(1.0)),
    ],
)
def test_equal_values_have_equal_digests(one, other):
    """Order of keys, layout in memory, tuples for lists and numpy's scalars for Python's make no difference."""
    assert digest([one]) == digest([other])


@pytest.mark.parametrize("value", [object(), lambda: 1, iter([1]), 1j, np])
def test_what_cannot_be_told_apart_is_refused(value):
    """What is no plain data is refused with its type: its text holds an address, or too little."""
    with pytest.raises(TypeError, match=f"a {type(value).__name__} cannot be part of a key"):
        digest({"deep": [value]})


SCRIPT = '''
"""What the stage does."""
import numpy as np

from pipeline.inner import work
from pipeline.room.part import Part


def main(part: Part) -> float:
    """Say it."""
    return 2.5 * np.pi * work(part)  # a circle
'''
FILES = {
    "stages/run.py": SCRIPT,
    "pipeline/__init__.py": "",
    "pipeline/inner.py": 'def work(part):\n    """Work."""\n    from pipeline.late import LATE\n    return LATE\n',
    "pipeline/late.py": "LATE = 1\n",
    "pipeline/room/__init__.py": "from pipeline.room.shared import X\n",
    "pipeline/room/shared.py": "X = 1\n",
    "pipeline/room/part.py": 'class Part:\n    """A part."""\n\n    size = 3\n',
    "pipeline/room/robot.urdf": "<robot/>",
    "pipeline/unused.py": "Y = 1\n",
    "stages/other.py": "Z = 1\n",
}


@pytest.fixture
def tree(tmp_path):
    """A package and a stage of their own, and what `code_digest` says of them after a change of one file."""
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def changed(name: str = "", old: str = "", new: str = "") -> str:
        if name:
            text = (tmp_path / name).read_text()
            assert old in text
            (tmp_path / name).write_text(text.replace(old, new, 1))
        found = code_digest(tmp_path / "stages" / "run.py", root=tmp_path)
        if name:
            (tmp_path / name).write_text(text)
        return found

    return changed


@pytest.mark.parametrize(
    "change",
    [
        ("stages/run.py", "# a circle", "# half a ball, says Archimedes"),
        ("stages/run.py", '"""What the stage does."""', '"""What the stage does,\n\nat length."""'),
        ("stages/run.py", '    """Say it."""\n', ""),
        ("stages/run.py", "2.5 * np.pi * work(part)", "(\n        2.5 * np.pi * work(part)\n    )"),
        ("pipeline/inner.py", '"""Work."""', '"""Toil."""'),
        ("pipeline/room/part.py", '    """A part."""\n\n', ""),
        ("pipeline/late.py", "LATE = 1\n", '"""Late."""\n\n\n# It is late.\nLATE = 1\n'),
        ("pipeline/unused.py", "Y = 1", "Y = 2"),
        ("stages/other.py", "Z = 1", "Z = 2"),
    ],
)
def test_comments_docstrings_and_other_code_keep_the_key(tree, change):
    """Comments, docstrings, layout, and files that the stage imports nowhere make no difference."""
    assert tree(*change) == tree()


@pytest.mark.parametrize(
    "change",
    [
        ("stages/run.py", "2.5", "2.6"),
        ("stages/run.py", "np.pi", "np.e"),
        ("pipeline/inner.py", "return LATE", "return -LATE"),
        ("pipeline/late.py", "1", "2"),  # which is imported inside a function
        ("pipeline/room/__init__.py", "import X", "import X as Y"),  # which runs when a module of the room is imported
        ("pipeline/room/shared.py", "1", "2"),
        ("pipeline/room/part.py", "3", "'3'"),
        ("pipeline/room/part.py", '"""A part."""', 'text = """A part."""'),
        ("pipeline/room/robot.urdf", "<robot/>", "<robot />"),
        ("pipeline/__init__.py", "", "import os\n"),
    ],
)
def test_code_that_runs_changes_the_key(tree, change):
    """One value changed in the stage's file, in a module it imports anywhere, or in a data file makes another key."""
    assert tree(*change) != tree()


@pytest.mark.parametrize(("package", "matters"), [("numpy", True), ("torch", False)])
def test_versions_of_imported_packages_change_the_key(tree, monkeypatch, package, matters):
    """Another version of a package that is imported makes another key, of one that is not it does not."""
    before = tree()
    found = keys.distribution

    class Newer:
        def __init__(self, name: str) -> None:
            self.version, self.requires = found(name).version, found(name).requires
            if name == package:
                self.version += ".1"

    monkeypatch.setattr(keys, "distribution", Newer)
    assert (tree() != before) == matters


def test_versions_of_what_packages_require_change_the_key(tree, monkeypatch):
    """What an imported package requires counts as well: its results may be that one's."""
    before = tree()
    found = keys.distribution

    class Requiring:
        def __init__(self, name: str) -> None:
            self.version, self.requires = ("1", None) if name == "hidden" else (found(name).version, ["hidden>=1"])

    monkeypatch.setattr(keys, "distribution", Requiring)
    assert tree() != before


@pytest.mark.parametrize("script", sorted(path.name for path in (ROOT / "stages").glob("*.py")))
def test_every_package_that_stages_import_is_known(script):
    """Every package that a stage's code imports is found with its version, but for the one that is optional."""
    sources = keys._closure([ROOT / "stages" / script], ROOT)
    names = {name.partition(".")[0] for source in sources.values() for name in source.imports}
    names -= {*sys.stdlib_module_names, "pipeline"}
    packages = {name: keys._DISTRIBUTIONS.get(name, name).replace("_", "-").lower() for name in names}
    unknown = {name for name, package in packages.items() if keys.package_versions([name])[package] == "none"}
    assert unknown <= {"roboplan"} and "omegaconf" in names


def test_a_stage_with_all_it_imports_counts():
    """Of a stage of ours its own file counts, and modules of every room it uses."""
    sources = keys._closure([ROOT / "stages" / "demonstrations.py"], ROOT)
    assert {"stages/demonstrations.py", "pipeline/planners/rrtconnect.py", "pipeline/robots/collision.py"} <= set(
        sources
    )
    assert "pipeline/learning/compnetx/networks.py" not in sources
    assert code_digest(ROOT / "stages" / "demonstrations.py") != code_digest(ROOT / "stages" / "scenes.py")
