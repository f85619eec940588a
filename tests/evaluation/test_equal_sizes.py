"""Methods are compared at equal N_init where both were tried with it."""

import pandas as pd

from pipeline.evaluation.choices import equal_sizes_table


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


def test_rows_are_the_sizes_that_both_were_tried_with():
    """A variant's own size counts, else its method's; the first with a size stands for it; others are left out."""
    trials = tried(**{
        "F": ([10, 20, 30], [1, 2, 3]),
        "F (samples = 300)": ([4, 8, 100], [2, 4, 6]),
        "F (samples = 300, heuristic = True)": ([1, 1, 1], [9, 9, 9]),
        "F (samples = 50)": ([1, 1, 1], [1, 1, 1]),
        "X": ([2, 4, 6], [2, 3, 7]),
        "X (n_ismp = 3)": ([1, 1, 1], [1, 1, 1]),
        "X (samples = 1000, n_ismp = 9)": ([40, 40, 1], [5, NONE, 6]),
        "Y (samples = 300)": ([1, 1, 1], [1, 1, 1]),
    })  # fmt: skip
    table = equal_sizes_table(trials, {"F": 1000, "X": 300}, "F", "X")
    assert table.to_numpy().tolist() == [
        [300, 3, "8.0", "4.0", "2.00", "4.000", "3.000"],
        [1000, 3, "20.0", "40.0", "0.50", "2.000", "5.500"],  # lengths of the first and third problem
    ]
    assert list(table.columns)[:3] == ["N_init", "n", "F: time median [ms]"]


def test_methods_without_a_size_give_no_row():
    """Where a method has no N_init, nothing can be equal."""
    assert equal_sizes_table(tried(F=([1], [1]), X=([1], [1])), {}, "F", "X").empty
