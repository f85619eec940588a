"""How numbers are written in tables and captions."""

import math

from pipeline.evaluation import Interval, Method

NONE = "–"


def number(value: float, digits: int = 3) -> str:
    """Write a number with so many significant digits and no exponent; a dash for NaN."""
    return fixed(value, decimals(value, digits))


def decimals(value: float, digits: int = 3) -> int:
    """Return the decimals that give `value` so many significant digits."""
    if not math.isfinite(value) or value == 0:
        return digits - 1
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def fixed(value: float, places: int) -> str:
    """Write a number with so many decimals; a dash for NaN, no minus before a zero."""
    if math.isnan(value):
        return NONE
    written = f"{value:.{places}f}"
    return written.removeprefix("-") if float(written) == 0 else written


def spread(mean: float, deviation: float, digits: int = 3) -> str:
    """Write mean ± standard deviation, both with the decimals of the mean; a dash for NaN."""
    if math.isnan(mean):
        return NONE
    places = decimals(mean, digits)
    return f"{fixed(mean, places)} ± {fixed(deviation, places)}"


def percent(fraction: float, places: int = 1) -> str:
    """Write a fraction as a percentage; a dash for NaN."""
    return NONE if math.isnan(fraction) else f"{fixed(100 * fraction, places)} %"


def rate(estimate: Interval) -> str:
    """Write a success rate with its interval in per cent."""
    if math.isnan(estimate.estimate):
        return NONE
    return f"{percent(estimate.estimate)} [{fixed(100 * estimate.low, 1)}, {fixed(100 * estimate.high, 1)}]"


def interval(estimate: Interval, unit: str = "") -> str:
    """Write a value with its interval; a dagger marks one of a single scene, a missing one is not written."""
    if math.isnan(estimate.estimate):
        return NONE
    places = decimals(estimate.estimate)
    written = fixed(estimate.estimate, places) + unit
    if math.isnan(estimate.low):
        return written
    mark = "†" if estimate.method is Method.ONE_SCENE else ""
    return f"{written} [{fixed(estimate.low, places)}, {fixed(estimate.high, places)}]{mark}"


def p_value(value: float) -> str:
    """Write a p-value; small ones as a bound, because their digits mean nothing."""
    return NONE if math.isnan(value) else "below 0.001" if value < 0.001 else f"{value:.3f}"


def method_name(method: str, adherence: str) -> str:
    """Write a method with its adherence as in running text."""
    return f"{method} with {adherence.replace('_', ' ')}"
