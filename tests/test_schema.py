"""Plain data becomes dataclasses, or an error that names the key, the value and what would be right."""

import re
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import ConfigError
from pipeline.schema import Choice, convert


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Inner:
    radius: float
    count: int = 1


@dataclass(frozen=True)
class Outer:
    seed: int
    inner: Inner
    label: str = ""
    dry: bool = False
    colour: Colour = Colour.RED
    margin: float | None = None
    folder: Path = Path()
    corner: tuple[float, float] = (0.0, 0.0)
    sizes: tuple[int, ...] = ()
    names: list[str] = field(default_factory=list)
    parts: dict[str, Inner] = field(default_factory=dict)
    anything: Any = None


GOOD = {"seed": 3, "inner": {"radius": 2}}


def refusal(*said: str):
    """A context in which a ConfigError of one line must say every one of `said`, in this order."""
    return pytest.raises(ConfigError, match=r"\A[^\n]*" + r"[^\n]*".join(map(re.escape, said)) + r"[^\n]*\Z")


def test_every_kind_of_value_is_converted():
    """Nested dataclasses, enums, paths, tuples, lists, mappings and empty options become their own types."""
    plain = {
        "seed": 3,
        "inner": {"radius": 2, "count": 4},
        "label": "x",
        "dry": True,
        "colour": "blue",
        "margin": None,
        "folder": "a/b",
        "corner": [1, 2.5],
        "sizes": [7, 8],
        "names": ["p", "q"],
        "parts": {"one": {"radius": 0.5}},
        "anything": {"free": [1, "form"]},
    }
    found = convert(plain, Outer)
    expected = Outer(
        3,
        Inner(2.0, 4),
        "x",
        True,
        Colour.BLUE,
        None,
        Path("a/b"),
        (1.0, 2.5),
        (7, 8),
        ["p", "q"],
        {"one": Inner(0.5)},
        {"free": [1, "form"]},
    )
    assert found == expected
    assert isinstance(found.inner.radius, float) and isinstance(found.corner[0], float)


def test_defaults_fill_what_is_left_out():
    """Keys with a default may be left out; an option takes a number as well as nothing."""
    assert convert(GOOD, Outer) == Outer(3, Inner(2.0))
    assert convert({**GOOD, "margin": 1}, Outer).margin == 1.0


def test_infinity_and_nan_are_numbers_by_name():
    """YAML's plain words inf and nan reach a float field as numbers, for its own bounds to judge."""
    assert convert({"radius": "inf"}, Inner).radius == float("inf")
    radius = convert({"radius": "nan"}, Inner).radius
    assert radius != radius
    with refusal("radius is 'many' (str)", "type float"):
        convert({"radius": "many"}, Inner)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sede": 3}, ("unknown key 'sede' in the configuration", "did you mean 'seed'?", "Valid keys: seed, inner")),
        ({"zzz": 3}, ("unknown key 'zzz' in the configuration. Valid keys: seed, inner", "anything")),
        ({"inner": {"radius": 1, "coun": 2}}, ("unknown key 'coun' in inner", "'count'?", "Valid keys: radius, count")),
        ({"parts": {"one": {"raduis": 1}}}, ("unknown key 'raduis' in parts.one", "'radius'?")),
        ({"inner": {}}, ("inner lacks radius",)),
        ({"inner": 3}, ("inner is 3", "mapping", "radius, count")),
        ({"inner": None}, ("inner is None", "mapping")),
        ({"seed": 1.5}, ("seed is 1.5 (float)", "type int")),
        ({"seed": "1"}, ("seed is '1' (str)", "type int")),
        ({"seed": True}, ("seed is True (bool)", "type int")),
        ({"seed": None}, ("seed is None (NoneType)", "type int")),
        ({"inner": {"radius": False}}, ("inner.radius is False (bool)", "type float")),
        ({"inner": {"radius": "1.0"}}, ("inner.radius is '1.0' (str)", "type float")),
        ({"inner": {"radius": None}}, ("inner.radius is None", "type float")),
        ({"label": 3}, ("label is 3 (int)", "type str")),
        ({"dry": 1}, ("dry is 1 (int)", "type bool")),
        ({"folder": 1}, ("folder is 1 (int)", "type Path")),
        ({"margin": "wide"}, ("margin is 'wide'", "type float")),
        ({"colour": "green"}, ("colour is 'green'", "choices: red, blue")),
        ({"corner": [1.0]}, ("corner has 1 items", "expected 2")),
        ({"corner": 1.0}, ("corner is 1.0", "list")),
        ({"corner": "ab"}, ("corner is 'ab'", "list")),
        ({"sizes": [1, "two"]}, ("sizes[1] is 'two' (str)", "type int")),
        ({"names": "p"}, ("names is 'p'", "list")),
        ({"parts": [1]}, ("parts is [1]", "mapping")),
        ({"parts": {"one": {"radius": [1]}}}, ("parts.one.radius is [1] (list)", "type float")),
    ],
)
def test_wrong_key_or_value_is_refused(change, said):
    """A misspelt key names its neighbour and the valid keys; a value of the wrong type its place, itself and type."""
    with refusal(*said):
        convert({**GOOD, **change}, Outer)


def test_missing_keys_are_named_together():
    """All keys that are missing are named at once."""
    with refusal("the configuration lacks seed, inner"):
        convert({"label": "x"}, Outer)


def test_choice_makes_what_the_registry_names():
    """A choice becomes the class its kind names, with its parameters converted."""
    made = Choice("ring", {"radius": 2}).make({"ring": Inner, "disc": Outer}, "shape")
    assert made == Inner(2.0)


def test_unknown_choice_lists_the_choices():
    """A kind that the registry does not have is refused with all kinds it has."""
    with refusal("shape is 'rign'", "choices: disc, ring"):
        Choice("rign").make({"ring": Inner, "disc": Outer}, "shape")


def test_parameters_of_a_choice_are_checked():
    """A misspelt parameter of a choice is refused under the name of the choice."""
    with refusal("unknown key 'raduis' in shape", "'radius'?"):
        Choice("ring", {"raduis": 2}).make({"ring": Inner}, "shape")
    with refusal("shape.radius is 'two'", "type float"):
        Choice("ring", {"radius": "two"}).make({"ring": Inner}, "shape")
