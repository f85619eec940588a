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


@dataclass(frozen=True)
class Positions:
    """Types in which a value that is converted by its neighbour's type is told from one that is not."""

    pair: tuple[str, float] = ("", 0.0)
    nested: tuple[tuple[int, str], tuple[float, ...]] = ((0, ""), ())
    rows: tuple[tuple[str, float, Inner], ...] = ()
    either: int | str | tuple[float, float] = 0
    number: float | int | None = None
    made: Inner | Colour | None = None
    counted: dict[int, tuple[str, Inner]] = field(default_factory=dict)
    coloured: dict[Colour, list[float | str]] = field(default_factory=dict)
    named: dict[str, float] = field(default_factory=dict)
    none: tuple[()] = ()


@pytest.mark.parametrize(
    ("key", "plain", "expected"),
    [
        ("pair", ["a", 1], ("a", 1.0)),
        ("nested", [[1, "b"], [2, 3]], ((1, "b"), (2.0, 3.0))),
        ("rows", [["a", 1, {"radius": 2}], ["b", 3, {"radius": 4}]], (("a", 1.0, Inner(2.0)), ("b", 3.0, Inner(4.0)))),
        ("either", 7, 7),
        ("either", "7", "7"),
        ("either", [1, 2], (1.0, 2.0)),
        ("number", 7, 7),
        ("number", 7.5, 7.5),
        ("number", None, None),
        ("made", {"radius": 1}, Inner(1.0)),
        ("made", "blue", Colour.BLUE),
        ("made", None, None),
        ("counted", {3: ["a", {"radius": 1}]}, {3: ("a", Inner(1.0))}),
        ("coloured", {"red": [1, "x"]}, {Colour.RED: [1.0, "x"]}),
        ("named", {7: 1, "b": 2}, {"7": 1.0, "b": 2.0}),
        ("none", [], ()),
    ],
)
def test_every_position_has_its_own_type(key, plain, expected):
    """Items of tuples, keys and values of mappings, and members of unions are converted each by its own type."""
    found = getattr(convert({key: plain}, Positions), key)
    assert found == expected and repr(found) == repr(expected)  # 1 == 1.0, but not in print


@pytest.mark.parametrize(
    ("key", "plain", "said"),
    [
        ("pair", [1, "a"], ("pair[0] is 1 (int)", "type str")),
        ("pair", ["a", "b"], ("pair[1] is 'b' (str)", "type float")),
        ("pair", ["a", 1, 2], ("pair has 3 items", "expected 2")),
        ("nested", [[1, 2], [3]], ("nested[0][1] is 2 (int)", "type str")),
        ("rows", [["a", 1, {"radius": "x"}]], ("rows[0][2].radius is 'x'",)),
        ("either", 1.5, ("either is 1.5, which none of its types takes", "type int", "type str", "must be a list")),
        ("either", [1, "x"], ("either[1] is 'x'",)),
        ("made", {"radiu": 1}, ("unknown key 'radiu' in made", "choices: red, blue")),
        ("counted", {"x": ["a", {"radius": 1}]}, ("a key of counted is 'x' (str)", "type int")),
        ("counted", {3: [{"radius": 1}, "a"]}, ("counted.3[0] is {'radius': 1} (dict)", "type str")),
        ("coloured", {"green": []}, ("a key of coloured is 'green'", "choices: red, blue")),
        ("named", {True: 1.0}, ("a key of named is True (bool)", "type str")),
        ("none", [1], ("none has 1 items", "expected 0")),
    ],
)
def test_every_position_is_checked(key, plain, said):
    """What does not fit is refused with its position and the type that belongs there."""
    with refusal(*said):
        convert({key: plain}, Positions)


LONG = 10**399  # 400 digits


@pytest.mark.parametrize("number", [LONG, -LONG, 2**63])
@pytest.mark.parametrize(
    ("key", "wrap"),
    [
        ("seed", lambda n: n),
        ("margin", lambda n: n),
        ("corner", lambda n: [0.0, n]),
        ("sizes", lambda n: [n]),
        ("parts", lambda n: {"one": {"radius": n}}),
        ("anything", lambda n: n),
        ("anything", lambda n: {"free": [1, {"form": n}]}),
    ],
)
def test_numbers_beyond_64_bits_are_refused(number, key, wrap):
    """A whole number that neither floats nor compiled code can hold is refused by its place, wherever it stands."""
    with refusal(key, f"is a number of {len(str(abs(number)))} digits", "at most 64 bits"):
        convert({**GOOD, key: wrap(number)}, Outer)


def test_the_largest_numbers_pass():
    """Both ends of what 64 bits hold pass."""
    for seed in (-(2**63), 2**63 - 1):
        assert convert({**GOOD, "seed": seed, "anything": [seed]}, Outer).seed == seed


def test_free_data_that_hold_themselves_are_refused():
    """A list that YAML's aliases put into itself is refused where any form goes; the same list twice is fine."""
    inside, twice = [1], [2]
    inside.append({"again": inside})
    with refusal("anything[1].again holds itself"):
        convert({**GOOD, "anything": inside}, Outer)
    assert convert({**GOOD, "anything": [twice, twice]}, Outer).anything == [[2], [2]]


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
