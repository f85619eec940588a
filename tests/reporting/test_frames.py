"""The door of the room: columns, order, pairs, paths."""

import numpy as np
import pandas as pd
import pytest

from pipeline.config import compose, load
from pipeline.errors import ArtifactError
from pipeline.evaluation.trials import Experiment, method_settings
from pipeline.reporting.frames import (
    PATH_COLUMNS,
    TRIAL_COLUMNS,
    both_solved,
    check,
    check_trials,
    groups,
    in_order,
    method_pairs,
    ordered,
    pair,
    path_array,
)
from tests.reporting.synthetic import SETTINGS, make_trials


def test_missing_and_unknown_columns_are_named():
    """A misspelt column is named twice: as missing and as unknown."""
    with pytest.raises(ArtifactError, match=r"missing columns \['path_length'\], unknown columns \['pathlength'\]"):
        check_trials(make_trials(2).rename(columns={"path_length": "pathlength"}))
    with pytest.raises(ArtifactError, match=r"curves: missing columns \['loss'\]"):
        check(pd.DataFrame({"epoch": [1]}), ["epoch", "loss"], "curves")


@pytest.mark.parametrize(
    "column, value, what", [("planning_time", 0.0, "not above 0"), ("path_length", np.nan, "no path")]
)
def test_trials_that_cannot_be_compared_are_refused(column, value, what):
    """A solved trial without a time or a length is refused with its place."""
    trials = make_trials(3)
    row = trials.index[trials["solved"]][0]
    trials.loc[row, column] = value
    with pytest.raises(ArtifactError, match=f"{what}.* in 1 of {len(trials)} rows.*problem {trials.problem[row]}"):
        check_trials(trials)


def test_order_is_the_papers_and_strangers_follow():
    """Known names come in the order of the paper, others behind them as they come, methods all as they come."""
    assert ordered(["zeta", "RRTConnect", "FMT*", "alpha", "FMT*"], "method") == ["zeta", "RRTConnect", "FMT*", "alpha"]
    assert ordered(["zeta", "bands", "alpha", "blocks"], "scenario") == ["blocks", "bands", "zeta", "alpha"]


def test_methods_stand_before_what_they_are_compared_with():
    """The published experiment's methods come as in its page: ours, as the paper has it, then both their baselines."""
    methods = load(compose("benchmark").experiment, Experiment).methods
    settings = method_settings(methods)
    labels = [method.label for method in methods.values()]
    trials = pd.DataFrame({"method": labels * 2, "problem": np.repeat([0, 1], len(labels))})
    found = in_order(trials, settings)
    expected = [
        "CoMPNetX-FMT*",
        "CoMPNetX-FMT*, Algorithm 6",
        "FMT*, tuned",
        "FMT*",
        "CoMPNetX-RRTConnect",
        "RRTConnect",
    ]
    assert ordered(found["method"], "method") == expected and found["problem"].tolist() == [0, 1] * len(labels)
    assert method_pairs(labels, settings) == [
        *[(ours, baseline) for ours in expected[:2] for baseline in expected[2:4]], tuple(expected[4:])
    ]  # fmt: skip


def test_groups_are_a_full_grid():
    """A combination that was not run is there, with no rows."""
    trials = make_trials(2, ("blocks",))
    trials = trials[~((trials["method"] == "FMT*") & (trials["adherence"] == "atlas"))]
    sizes = {(method, adherence): len(rows) for method, adherence, rows in groups(trials, "blocks")}
    assert len(sizes) == 15 and sizes["FMT*", "atlas"] == 0 and sizes["FMT*", "projection"] == 2


def test_learned_methods_meet_their_classical_counterpart():
    """Only methods whose counterpart was run are paired."""
    pairs = method_pairs(["FMT*", "CoMPNetX-FMT*", "CoMPNetX-RRT", "RRTConnect"], SETTINGS)
    assert pairs == [("CoMPNetX-FMT*", "FMT*")]


def test_pairs_are_problem_by_problem():
    """Rows are joined by scene and problem whatever their order, repetitions by the order of their seeds."""
    columns = ["scenario", "adherence", "method", "scene", "problem", "leg", "seed", "solved", "planning_time"]
    rows = [
        ("blocks", "atlas", "A", "s", 0, 0, 1, True, 1.0),
        ("blocks", "atlas", "A", "s", 1, 0, 1, False, 2.0),
        ("blocks", "atlas", "A", "s", 1, 0, 2, True, 3.0),
        ("blocks", "atlas", "B", "s", 1, 0, 8, True, 30.0),
        ("blocks", "atlas", "B", "s", 1, 0, 7, True, 20.0),
        ("blocks", "atlas", "B", "s", 0, 0, 7, True, 10.0),
        ("blocks", "projection", "B", "s", 0, 0, 7, True, 99.0),
        ("blocks", "atlas", "B", "t", 0, 0, 7, True, 99.0),
    ]
    joined = pair(pd.DataFrame(rows, columns=columns), "blocks", "atlas", "A", "B")
    assert joined[["planning_time_1", "planning_time_2"]].to_numpy().tolist() == [[1, 10], [2, 20], [3, 30]]
    assert [side.tolist() for side in both_solved(joined, "planning_time")] == [[1, 3], [10, 30], ["s", "s"]]


def test_paths_are_row_major_and_checked():
    """The flat list is read row by row; a wrong count is refused."""
    row = pd.Series(
        dict(zip(PATH_COLUMNS, ["blocks", "s", 0, 0, "FMT*", "atlas", [1, 2, 3, 4, 5, 6], 2, 3], strict=True))
    )
    assert path_array(row).tolist() == [[1, 2, 3], [4, 5, 6]]
    with pytest.raises(ArtifactError, match="6 numbers, expected 3 waypoints"):
        path_array(row.replace({2: 3}))


def test_empty_trials_pass():
    """A table with the columns and no rows is an empty benchmark, not an error."""
    check_trials(pd.DataFrame(columns=list(TRIAL_COLUMNS)))
