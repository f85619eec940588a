"""The helpers of messages about numbers: bounds, their words, what is not finite, and digits."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pipeline.errors import ConfigError, require, require_name, shown, told_apart


@pytest.mark.parametrize(
    ("value", "bounds", "words"),
    [
        (0, {"at_least": 1}, "n is 0; it must be at least 1"),
        (0.0, {"above": 0}, "n is 0.0; it must be above 0"),
        (1.5, {"at_least": 0, "at_most": 1}, "n is 1.5; it must be at least 0 and at most 1"),
        (1.0, {"at_least": 0, "below": 1}, "n is 1.0; it must be at least 0 and below 1"),
        (math.nan, {"above": 0}, "n is nan; it must be finite and above 0"),
        (math.inf, {"at_least": 0}, "n is inf; it must be finite and at least 0"),
        (-1, {"above": 0, "unit": " m"}, "n is -1 m; it must be above 0 m"),
    ],
)
def test_refused(value, bounds, words):
    """A number outside its bounds is refused with its name, its value and all bounds, with their unit."""
    with pytest.raises(ConfigError) as caught:
        require("n", value, **bounds)
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("value", "bounds"),
    [(1, {"at_least": 1}), (1e-300, {"above": 0}), (1, {"at_most": 1, "above": 0}), (0, {"at_least": 0, "below": 1})],
)
def test_accepted(value, bounds):
    """A number on a bound that includes it, or just beside one that does not, passes."""
    require("n", value, **bounds)


@pytest.mark.parametrize(
    "name", ["", ".", "..", ".hidden", "a/b", "/tmp/a", "../a", "a\\b", "a b", "a\n", "a\0b", "~a;", "*", "$x"]
)
def test_names_that_are_paths_are_refused(name):
    """A name that is no plain part of a path, or that a shell would take for more, is refused with what is allowed."""
    with pytest.raises(ConfigError, match=r"^x\.name is .*letters, digits and '_', '-', '\.', .*not begin with '\.'$"):
        require_name("x.name", name)


@pytest.mark.parametrize("name", ["sphere", "transport_panda", "scene-000.b", "größe", "3", "-a"])
def test_names_of_files_pass(name, tmp_path):
    """What passes is the name of a file in the folder that it was asked for."""
    require_name("x.name", name)
    (tmp_path / name).mkdir()
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_label_may_have_more():
    """Further characters pass where they are named, and a slash still does not."""
    require_name("label", "FMT*, tuned", also=" ,*")
    with pytest.raises(ConfigError, match=r"'_', '-', '\.', ' ', ',', '\*'"):
        require_name("label", "FMT*/tuned", also=" ,*")


def test_numbers_are_told_apart():
    """Numbers in a message have the digits it takes to see that they differ, and no more."""
    assert told_apart(1.0, 2.0) == ["1", "2"] and told_apart(2.8973, 2.8973) == ["2.8973"] * 2
    rng = np.random.default_rng(0)
    for value in rng.uniform(-10, 10, 100):
        for apart in (1e-3, 1e-9, 1e-14):
            other = value + apart
            one, two = told_apart(value, other)
            assert (one != two) == (value != other)
    lengths = [len(told_apart(2.0, 2.0 + apart)[1]) for apart in (1e-3, 1e-6, 1e-9, 1e-12)]
    assert all(a < b for a, b in pairwise(lengths))


def test_whole_numbers_have_no_largest():
    """A whole number beyond every float is judged by the bounds, and its digits do not fill the screen."""
    require("n", 10**400, at_least=1)
    with pytest.raises(ConfigError, match=r"n is 10{199}\.\.\. \(401 characters\); it must be at most 5$"):
        require("n", 10**400, at_most=5)


def test_long_values_are_cut():
    """A value of up to 200 characters is shown whole, a longer one cut, with its length."""
    assert shown("x" * 198) == repr("x" * 198)
    assert shown([1] * 100) == f"{str([1] * 100)[:200]}... (300 characters)"
