"""How numbers are written."""

from math import nan

import pytest

from pipeline.evaluation import Interval, Method
from pipeline.reporting import text


@pytest.mark.parametrize(
    "value, written",
    [
        (0.0123456, "0.0123"),
        (1.224, "1.22"),
        (12.34, "12.3"),
        (1234.5, "1234"),
        (0.5, "0.500"),
        (0, "0.00"),
        (nan, "–"),
    ],
)
def test_numbers_have_three_significant_digits(value, written):
    """No exponent, no lost zeros, a dash for nothing."""
    assert text.number(value) == written


def test_mean_and_deviation_share_their_decimals():
    """The deviation is written to the place of the mean, as the paper does; one value has no deviation."""
    assert text.spread(1.2249, 0.0341) == "1.22 ± 0.03"
    assert text.spread(0.012, 0.005) == "0.0120 ± 0.0050"
    assert text.spread(1.5, nan) == "1.50 ± –"
    assert text.spread(nan, nan) == "–"


def test_intervals_say_when_they_are_percentiles():
    """A dagger marks the fallback; without an interval only the value stands."""
    assert text.interval(Interval(1.371, 1.2, 1.5, 0.95, Method.SCENES), "×") == "1.37× [1.20, 1.50]"
    assert text.interval(Interval(-0.25, -0.3, 0.0, 0.95, Method.ONE_SCENE), " m") == "-0.250 m [-0.300, 0.000]†"
    assert text.interval(Interval(2.0, nan, nan, 0.95, Method.NONE)) == "2.00"
    assert text.interval(Interval(nan, nan, nan, 0.95, Method.NONE)) == "–"


def test_small_p_values_are_bounds():
    """Digits of a tiny p-value mean nothing."""
    assert [text.p_value(p) for p in (1e-9, 0.0314, 1.0)] == ["below 0.001", "0.031", "1.000"]
