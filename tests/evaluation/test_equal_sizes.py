"""Methods are compared at equal N_init where both were tried with it."""

import pandas as pd

from pipeline.evaluation.choices import Variant, equal_sizes_table, variant_settings, variants
from pipeline.evaluation.trials import Method
from pipeline.schema import Choice


def tried(**variants: tuple[list[float], list[float]]) -> pd.DataFrame:
    """Trials by label: planning times [ms] and path lengths [m] of three problems, NaN where not solved."""
    rows = []
    for label, (times, lengths) in variants.items():
        for problem, (time, length) in enumerate(zip(times, lengths, strict=True)):
            rows.append({
                "scenario": "blocks", "scene": "a", "problem": problem, "adherence": "projection", "method": label,
                "planning_time": time / 1e3, "path_length": length, "solved": length == length,
            })  # fmt: skip
    return pd.DataFrame(rows)


NONE = float("nan")


def setting(base: str, samples: int | None) -> dict:
    """What `variant_settings` says of a variant."""
    return {"base": base, "planner": {} if samples is None else {"samples": samples}, "sampler": {}}


def test_rows_are_the_sizes_that_both_were_tried_with():
    """The first variant with a size stands for it; sizes of one method alone and other methods are left out."""
    trials = tried(
        a=([10, 20, 30], [1, 2, 3]),
        b=([4, 8, 100], [2, 4, 6]),
        c=([1, 1, 1], [9, 9, 9]),
        d=([1, 1, 1], [1, 1, 1]),
        e=([2, 4, 6], [2, 3, 7]),
        f=([1, 1, 1], [1, 1, 1]),
        g=([40, 40, 1], [5, NONE, 6]),
        h=([1, 1, 1], [1, 1, 1]),
    )
    settings = {
        "a": setting("F", 1000), "b": setting("F", 300), "c": setting("F", 300), "d": setting("F", 50),
        "e": setting("X", 300), "f": setting("X", 300), "g": setting("X", 1000), "h": setting("Y", 300),
    }  # fmt: skip
    table = equal_sizes_table(trials, settings, "F", "X", "m")
    assert table.to_numpy().tolist() == [
        [300, 3, "8.0", "4.0", "2.00", "4.000", "3.000"],
        [1000, 3, "20.0", "40.0", "0.50", "2.000", "5.500"],  # lengths of the first and third problem
    ]
    assert list(table.columns)[:3] == ["N_init", "n", "F: time median [ms]"]


def test_methods_without_a_size_give_no_row():
    """Where a method has no N_init, nothing can be equal."""
    settings = {"F": setting("F", None), "X": setting("X", None)}
    assert equal_sizes_table(tried(F=([1], [1]), X=([1], [1])), settings, "F", "X", "m").empty


def test_settings_of_variants_are_those_they_plan_with():
    """Each variant's settings are its base's with its changes, under the label of its trials, with its base named."""
    fmt = Method("F", Choice("fmt", {"samples": 1000, "late": 1.0}), Choice("uniform", {"around": 0.5}))
    changed = [Variant("f"), Variant("f", {"samples": 400}), Variant("f", {}, {"around": 1.0})]
    found = variant_settings({"f": fmt}, changed)
    methods = variants({"f": fmt}, changed)
    assert list(found) == [method.label for method in methods.values()]
    assert {parts["base"] for parts in found.values()} == {"F"}
    assert [parts["planner"]["samples"] for parts in found.values()] == [1000, 400, 1000]
    assert [parts["sampler"]["around"] for parts in found.values()] == [0.5, 0.5, 1.0]
