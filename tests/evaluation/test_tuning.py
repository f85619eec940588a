"""One rule chooses settings, and what was measured is held against it."""

import pandas as pd
import pytest

from pipeline.errors import ArtifactError
from pipeline.evaluation.tuning import choose, tuned

NAN = float("nan")


def tried(**variants: tuple[list[float], list[float]]) -> pd.DataFrame:
    """Trials by label: planning times and path lengths, NaN where not solved."""
    return pd.DataFrame([
        {"method": label, "planning_time": time, "path_length": length, "solved": length == length}
        for label, (times, lengths) in variants.items()
        for time, length in zip(times, lengths, strict=True)
    ])  # fmt: skip


TRIALS = tried(
    fastest=([1.00, 1.00, 9.00], [3.0, 3.0, 3.0]),
    shorter=([1.09, 1.09, 9.00], [2.0, 2.0, 2.0]),
    slow=([1.11, 1.11, 1.11], [1.0, 1.0, 1.0]),
    fails=([0.50, 0.50, 0.50], [1.0, 1.0, NAN]),
)


def test_the_rule_is_success_then_time_then_length():
    """What fails more is out, then what is a tenth slower than the fastest, and the shortest of the rest is chosen."""
    assert choose(TRIALS, ["fastest", "shorter", "slow", "fails"]) == "shorter"
    assert choose(TRIALS, ["fastest", "slow"]) == "fastest"
    assert choose(TRIALS, ["fails"]) == "fails"


def test_order_and_names_and_units_do_not_matter():
    """Variants in another order, under other names and with times in milliseconds give the same choice."""
    assert choose(TRIALS, ["slow", "fails", "shorter", "fastest"]) == "shorter"
    other = TRIALS.assign(method="my " + TRIALS["method"], planning_time=1e3 * TRIALS["planning_time"])
    assert choose(other, [f"my {name}" for name in ("fastest", "shorter", "slow", "fails")]) == "my shorter"


def test_nothing_solved_and_nothing_tried():
    """Where nobody solves anything the fastest is chosen; where nothing was tried there is no choice."""
    assert choose(tried(a=([2.0], [NAN]), b=([1.0], [NAN])), ["a", "b"]) == "b"
    with pytest.raises(ArtifactError, match="none of the variants"):
        choose(TRIALS, ["x"])


@pytest.mark.parametrize("samples, agrees", [(400, True), (1000, False)])
def test_another_setting_than_the_chosen_one_is_said(samples, agrees):
    """The sentence tells whether the benchmark's method has what the rule chooses, by name and value."""
    settings = {
        name: {"base": "F", "planner": {"samples": size}, "sampler": {"around": 0.5}}
        for name, size in (("fastest", 300), ("shorter", 400), ("slow", 500))
    }
    settings["fails"] = {"base": "other", "planner": {"samples": 1}, "sampler": {}}
    measured = {"F, tuned": {"planner": {"samples": samples}, "sampler": {"around": 0.5}}}
    found = tuned(TRIALS, settings, "F", measured, "F, tuned")
    assert found.chosen == "shorter" and found.tried == 3
    assert found.differs == (() if agrees else ("samples = 1000, chosen 400",))
    assert ("which is what was measured" in found.sentence) is agrees
    assert tuned(TRIALS, settings, "F", {}, "F, tuned") is None
    assert tuned(TRIALS, settings, "unknown", measured, "F, tuned") is None
