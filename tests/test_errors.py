"""The one helper that refuses numbers: bounds, their words, and what is not finite."""

import math

import pytest

from pipeline.errors import ConfigError, require


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
