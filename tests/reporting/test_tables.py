"""Tables against counts, quantiles and intervals taken by hand."""

import statistics
from math import comb, sqrt

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from pipeline.errors import ArtifactError
from pipeline.reporting import paired_table, rejection_table, results_table
from pipeline.reporting.frames import TRIAL_COLUMNS
from tests.reporting.synthetic import PAPER, SETTINGS, make_trials


def row_of(table: pd.DataFrame, method: str, adherence: str) -> pd.Series:
    (row,) = [r for _, r in table.iterrows() if (r["method"], r["adherence"]) == (method, adherence)]
    return row


def test_success_is_the_count_with_wilsons_interval():
    """n, the share and, in one scene, its interval equal a plain count and the closed form of Wilson (1927)."""
    trials = make_trials(40).assign(scene="40")
    chosen = [t for t in trials.to_dict("records") if t["scenario"] == "blocks" and t["method"] == "FMT*"]
    chosen = [t for t in chosen if t["adherence"] == "atlas"]
    k, n, z = sum(t["solved"] for t in chosen), len(chosen), norm.ppf(0.975)
    centre, half = k + z**2 / 2, z * sqrt(k * (n - k) / n + z**2 / 4)
    low, high = (100 * (centre + sign * half) / (n + z**2) for sign in (-1, 1))
    row = row_of(results_table(trials, PAPER)["blocks"], "FMT*", "atlas")
    assert row["n"] == n and row["n solved"] == k
    assert row["success [95 %]"] == f"{100 * k / n:.1f} % [{low:.1f}, {high:.1f}]"


def test_times_of_solved_and_of_all_trials_are_told_apart():
    """'Solved only' and 'all' are medians, means and deviations of the rows they name."""
    trials = make_trials(40)
    chosen = [t for t in trials.to_dict("records") if t["scenario"] == "bands" and t["method"] == "FMT*"]
    chosen = [t for t in chosen if t["adherence"] == "projection"]
    every, solved = [t["planning_time"] for t in chosen], [t["planning_time"] for t in chosen if t["solved"]]
    assert len(solved) < len(every)
    row = row_of(results_table(trials, PAPER)["bands"], "FMT*", "projection")
    assert float(row["time, solved only: median [s]"]) == pytest.approx(statistics.median(solved), abs=0.005)
    assert float(row["time, all trials: median [s]"]) == pytest.approx(statistics.median(every), abs=0.005)
    for name, values in (("solved only", solved), ("all trials", every)):
        mean, deviation = row[f"time, {name}: mean ± sd [s]"].split(" ± ")
        assert float(mean) == pytest.approx(statistics.fmean(values), abs=0.005)
        assert float(deviation) == pytest.approx(statistics.stdev(values), abs=0.005)
    ordered = sorted(solved)
    place = 0.95 * (len(ordered) - 1)
    p95 = ordered[int(place)] + (place % 1) * (ordered[int(place) + 1] - ordered[int(place)])
    assert float(row["time, solved only: p95 [s]"]) == pytest.approx(p95, abs=0.005)


def test_shares():
    """The network's share is a median over trials; fallback samples are counted over all trials, and who needed any."""
    trials = make_trials(3, ("blocks",), ("CoMPNetX-FMT*",), ("atlas",))
    trials["planning_time"], trials["network_time"] = [1.0, 2.0, 4.0], [0.1, 0.4, 2.0]
    trials["samples"], trials["fallback_samples"] = [10, 0, 100], [1, 0, 30]
    row = results_table(trials, PAPER)["blocks"].iloc[0]
    assert row["network share of time (median)"] == "20.0 %"
    assert row["fallback share of samples (all trials together)"] == "28.2 %"  # 31 of 110
    assert row["trials with fallback samples"] == "66.7 %"


def test_the_papers_numbers_stand_beside_ours():
    """Every number of section VII-A on the sphere is shown; RRTConnect has a time range in scenario 1 and no length."""
    tables = results_table(make_trials(3), PAPER)
    row = row_of(tables["blocks"], "FMT*", "tangent_bundle")
    assert (row["paper: time [s]"], row["paper: success"]) == ("1.34 ± 0.061", "around 89 %")
    row = row_of(tables["bands"], "CoMPNetX-FMT*", "atlas")
    assert [row[f"paper: {what}"] for what in ("time [s]", "success", "length")] == [
        "0.55 ± 0.11",
        "around 96 %",
        "3.13 ± 1.8",
    ]
    row = row_of(tables["blocks"], "RRTConnect", "atlas")
    assert (row["paper: time [s]"], row["paper: success"]) == ("0.01 to 0.02", "")
    assert all(PAPER.find(s, "RRTConnect", "atlas").length is None for s in ("blocks", "bands"))


@pytest.mark.parametrize("scenario, adherence, ratio", [("blocks", "atlas", 1.37), ("bands", "atlas", 3.51)])
def test_the_papers_ratios(scenario, adherence, ratio):
    """1.22 / 0.89 and 1.93 / 0.55."""
    assert PAPER.speed_up(scenario, adherence, "CoMPNetX-FMT*", "FMT*") == pytest.approx(ratio, abs=0.005)


def test_a_method_that_solved_nothing_is_shown_as_zero():
    """0 % with an interval, dashes for times and lengths of solved trials, a time over all trials."""
    trials = make_trials(20, ("blocks",))
    hopeless = trials["method"] == "FMT*"
    trials.loc[hopeless, ["solved", "claimed"]] = False
    trials.loc[hopeless, "path_length"] = np.nan
    row = row_of(results_table(trials, PAPER)["blocks"], "FMT*", "atlas")
    assert row["success [95 %]"].startswith("0.0 % [0.0, ")
    assert row["time, solved only: median [s]"] == row["length, solved only: median [m]"] == "–"
    assert row["time, all trials: median [s]"] != "–"
    paired = paired_table(trials, PAPER, SETTINGS)
    assert (paired.loc[paired["classical"] == "FMT*", "both solved"] == 0).all()
    assert (paired.loc[paired["classical"] == "FMT*", "only learned solved"] > 0).all()


def test_combinations_that_were_not_run_are_shown_as_such():
    """n = 0 and dashes; no rows at all give no tables."""
    trials = make_trials(4, ("blocks",))
    part = trials[~((trials["method"] == "FMT*") & (trials["adherence"] == "atlas"))]
    row = row_of(results_table(part, PAPER)["blocks"], "FMT*", "atlas")
    assert row["n"] == 0 and row["success [95 %]"] == "–" and row["projections (median)"] == "–"
    paired = paired_table(part, PAPER, SETTINGS).set_index(["classical", "adherence"])
    assert paired.loc[("FMT*", "atlas"), "McNemar p (exact)"] == "–"
    empty = pd.DataFrame(columns=list(TRIAL_COLUMNS))
    assert (
        results_table(empty, PAPER) == {}
        and paired_table(empty, PAPER, SETTINGS).empty
        and rejection_table(empty).empty
    )


def test_pairs_count_and_test_what_both_and_one_solved():
    """Discordant problems counted by hand; McNemar's p is twice a binomial tail; the ratio is of medians of both."""
    trials = make_trials(20, ("blocks",), ("CoMPNetX-FMT*", "FMT*"), ("atlas",))
    learned, classical = (trials.index[trials["method"] == m] for m in ("CoMPNetX-FMT*", "FMT*"))
    trials.loc[learned, "solved"] = [True] * 18 + [False] * 2
    trials.loc[classical, "solved"] = [True] * 10 + [False] * 9 + [True]
    trials["path_length"] = 1.0
    (row,) = paired_table(trials, PAPER, SETTINGS).to_dict("records")
    assert (row["pairs"], row["both solved"]) == (20, 10)
    assert (row["only learned solved"], row["only classical solved"]) == (8, 1)
    p = 2 * sum(comb(9, i) for i in range(2)) / 2**9
    assert row["McNemar p (exact)"] == f"{p:.3f}"
    fast, slow = (trials.loc[rows[:10], "planning_time"].tolist() for rows in (learned, classical))
    ratio = statistics.median(slow) / statistics.median(fast)
    assert row["ratio of median times, both solved (classical / learned)"].startswith(f"{ratio:.2f}× [")
    assert row["paper: ratio of mean times"] == "1.37×"
    # All lengths are equal: there is nothing to resample.
    assert row["difference of median lengths, both solved (learned - classical) [m]"] == "0.00 [0.00, 0.00]"


def test_rejections_of_one_kind_count_as_one():
    """The verifier's sentences differ in their numbers only; they make one row, the planner's status another."""
    trials = make_trials(6, ("blocks",), ("FMT*",), ("atlas",))
    trials["solved"], trials["claimed"] = False, [True, True, False, False, False, False]
    trials["status"], trials["rejection"] = "time limit", ""
    trials.loc[0, "rejection"] = "between waypoints 3 and 4 there is contact at [0.1, -2.0, 3e-05]"
    trials.loc[1, "rejection"] = "between waypoints 11 and 12 there is contact at [0.7, 0.7]"
    rows = rejection_table(trials)[["not solved", "reason"]].to_numpy().tolist()
    assert [2, "claimed, rejected: between waypoints # and # there is contact at [#]"] in rows
    assert [4, "time limit"] in rows and len(rows) == 2


@pytest.mark.parametrize("table", [(results_table, PAPER), (paired_table, PAPER, SETTINGS), (rejection_table,)])
def test_unknown_columns_are_refused_by_name(table):
    """No table is made from a file with other columns."""
    make, *more = table
    with pytest.raises(ArtifactError, match="surprise"):
        make(make_trials(2).assign(surprise=1), *more)
