"""Whether the expectations are met, on trials made to meet or to miss them."""

import pandas as pd
import pytest

from pipeline.errors import ArtifactError
from pipeline.reporting import verdict_summary, verdict_table
from pipeline.reporting.frames import TRIAL_COLUMNS
from pipeline.reporting.verdict import FASTER, MEAN_SPEED, NO, NO_DATA, NO_NUMBER, SHORTER, SPEED, SUCCESS, YES
from tests.reporting.synthetic import PAPER, make_trials

X, FMT, RRT = "CoMPNetX-FMT*", "FMT*", "RRTConnect"
BY_MEDIANS, IN_LENGTH = FASTER.format(X, "FMT*, tuned"), SHORTER.format(X, RRT)
BY_RATIO, BY_MEAN_RATIO = SPEED.format(X, FMT), MEAN_SPEED.format(X, FMT)


def flat(n: int = 100, **settings: tuple[float, float, float]) -> pd.DataFrame:
    """Trials of scenario 'blocks' with atlas: per method the share solved, the time [s] and the length [m]."""
    trials = make_trials(n, ("blocks",), (X, FMT, RRT), ("atlas",))
    for method, key in ((X, "x"), (FMT, "fmt"), (RRT, "rrt")):
        rows = trials.index[trials["method"] == method]
        share, time, length = settings[key]
        trials.loc[rows, ["planning_time", "path_length"]] = time, length
        trials.loc[rows, "solved"] = [i < round(share * n) for i in range(n)]
    return trials


def answer(trials: pd.DataFrame, expectation: str, method: str) -> pd.Series:
    table = verdict_table(trials, PAPER)
    (row,) = [r for _, r in table.iterrows() if r["expectation"] == expectation and r["method"].startswith(method)]
    return row


@pytest.mark.parametrize("share, met", [(0.95, YES), (0.94, NO)])
def test_around_is_met_by_the_number_itself(share, met):
    """The paper says 'around 95 %' of FMT* with atlas."""
    assert answer(flat(x=(1, 0.5, 1), fmt=(share, 1, 1), rrt=(1, 0.01, 1)), SUCCESS, FMT)["met"] == met


@pytest.mark.parametrize("share, met", [(1.0, YES), (0.99, NO)])
def test_over_is_not_met_by_the_number_itself(share, met):
    """The paper says 'over 99 %' of CoMPNetX-FMT*: 99 of 100 are not over it."""
    row = answer(flat(x=(share, 0.5, 1), fmt=(1, 1, 1), rrt=(1, 0.01, 1)), SUCCESS, X)
    assert row["met"] == met and row["remark"] == "interval includes the bound"


@pytest.mark.parametrize("time, met", [(1.38, YES), (1.36, NO)])
@pytest.mark.parametrize("expectation", [BY_RATIO, BY_MEAN_RATIO])
def test_speed_is_held_against_the_papers_ratio(expectation, time, met):
    """The bound is 1.22 / 0.89 = 1.3708; the remark names n."""
    row = answer(flat(x=(1, 1.0, 1), fmt=(0.9, time, 1), rrt=(1, 0.01, 1)), expectation, X)
    assert row["met"] == met and row["paper"] == "1.37×" and row["ours"].startswith(f"{time:.2f}×")
    assert row["remark"].endswith("n = 90")


def test_means_and_medians_have_a_verdict_each():
    """A learned method that is fast on most problems and very slow on a few is faster by medians, slower by means."""
    trials = flat(x=(1, 0.5, 1), fmt=(1, 1, 1), rrt=(1, 0.01, 1))
    slow = trials.index[trials["method"] == X][:10]
    trials.loc[slow, "planning_time"] = 10.0
    assert answer(trials, BY_RATIO, X)["met"] == YES and answer(trials, BY_RATIO, X)["ours"].startswith("2.00×")
    assert answer(trials, BY_MEAN_RATIO, X)["met"] == NO and answer(trials, BY_MEAN_RATIO, X)["ours"].startswith("0.69")


@pytest.mark.parametrize("length, met", [(0.99, YES), (1.0, NO), (1.01, NO)])
def test_equal_lengths_are_not_shorter(length, met):
    """Shorter means below zero; the medians stand in the remark."""
    row = answer(flat(x=(1, 1, length), fmt=(1, 1, 1), rrt=(1, 0.01, 1.0)), IN_LENGTH, X)
    assert row["met"] == met and f"medians {length:.3f}"[:12] in row["remark"]


def test_what_the_paper_does_not_say_is_not_judged():
    """It gives no success of RRTConnect on the sphere."""
    row = answer(flat(x=(1, 1, 1), fmt=(1, 1, 1), rrt=(0.5, 1, 1)), SUCCESS, RRT)
    assert row["met"] == NO_NUMBER and row["ours"].startswith("50.0 %")


def test_a_method_that_solved_nothing_cannot_be_compared_and_misses_its_success():
    """0 % is a plain no; without common problems neither speed nor length is measured."""
    trials = flat(x=(0, 1, 1), fmt=(1, 1, 1), rrt=(1, 1, 1))
    assert answer(trials, SUCCESS, X)["met"] == NO
    assert answer(trials, BY_RATIO, X)["met"] == answer(trials, IN_LENGTH, X)["met"] == NO_DATA


def test_summary_says_no_when_one_row_misses():
    """'yes' needs every comparable row; the rows that miss are named."""
    trials = flat(x=(1, 0.5, 1), fmt=(0.5, 1, 1), rrt=(1, 0.01, 2))
    summary = verdict_summary(verdict_table(trials, PAPER)).set_index("expectation")
    assert summary["met"].to_dict() == {
        SUCCESS: NO, BY_MEDIANS: NO_DATA, BY_RATIO: YES, BY_MEAN_RATIO: YES, IN_LENGTH: YES
    }  # fmt: skip
    assert summary.loc[SUCCESS, "rows met"] == "1 of 2"
    assert summary.loc[SUCCESS, "not met by"].startswith("FMT*, atlas: 50.0 %")


def test_empty_and_foreign_trials():
    """No trials give no rows; unknown columns are named."""
    empty = verdict_table(pd.DataFrame(columns=list(TRIAL_COLUMNS)), PAPER)
    assert empty.empty and verdict_summary(empty).empty
    with pytest.raises(ArtifactError, match="surprise"):
        verdict_table(make_trials(2).assign(surprise=1), PAPER)
