"""The tables of a planner report, as data frames of text ready for Markdown."""

import re

import numpy as np
import pandas as pd

from pipeline.evaluation import Comparison, mcnemar, paired_interval, success_interval, summary
from pipeline.evaluation.tuning import Settings
from pipeline.reporting import text
from pipeline.reporting.frames import both_solved, check_trials, groups, method_pairs, ordered, pair
from pipeline.reporting.paper import Paper, PaperResult

OUTCOME = ("method", "adherence", "n", "success [95 %]", "paper: success")
TIME = (
    "method", "adherence", "n solved", "time, solved only: median [s]", "time, solved only: mean ± sd [s]",
    "time, solved only: p95 [s]", "paper: time [s]", "time, all trials: median [s]", "time, all trials: mean ± sd [s]",
)  # fmt: skip
EFFORT = (
    "method", "adherence", "n", "projections (median)", "collision checks (median)", "samples (median)",
    "fallback share of samples (all trials together)", "trials with fallback samples", "network share of time (median)",
)  # fmt: skip

RESULTS_NOTE = (
    "'Solved only' leaves out the trials that found no valid path; 'all trials' counts those at the time that had "
    "passed when they stopped. The counts are medians over all trials. Intervals of success are Wilson's for "
    "as many independent problems as those of scenes are worth, by how much the scenes' rates differ, with Student's "
    "quantile; where all problems or none were solved, or there is one scene, nothing tells how scenes differ and the "
    "problems count as independent."
)
INTERVALS = (
    "95 % intervals resample scenes and then problems within them, in pairs; the deviation of the resamples (of the "
    "logarithm, for ratios) is taken times Student's quantile with one degree of freedom less than scenes and "
    "sqrt(S / (S - 1)), which in simulation at 10 scenes holds the truth in at least 93 % of 1500 data sets, whether "
    "scenes differ or not (in up to 100 % where they do not: the intervals are then wider than they need to be). † "
    "one scene: problems are resampled, and nothing is said about other scenes."
)
PAIRED_NOTE = (
    "Both solved: the problems that both methods solved; the ratio and the difference are over these only. "
    "'FMT*, tuned' has the setting that was chosen for it as ours was for ours; 'FMT*' is the paper's setting. "
    "A ratio above 1 means that the learned method is faster, a negative difference that its paths are shorter. "
    f"{INTERVALS} The "
    "paper's ratio is of mean times, each over the problems that method solved."
)


def length_columns(unit: str) -> tuple[str, ...]:
    """Return the columns of path lengths in a unit."""
    figures = (f"length, solved only: {name} [{unit}]" for name in ("median", "mean ± sd", "p95"))
    return ("method", "adherence", "n solved", *figures, "paper: length")


def results_table(trials: pd.DataFrame, paper: Paper) -> dict[str, pd.DataFrame]:
    """Return, per scenario, one row per method and adherence with the columns OUTCOME, TIME, EFFORT and lengths.

    Times and lengths of a method that solved nothing are dashes, its success is 0 %; a combination that was not run
    has n = 0. Beside each value stands the paper's, where it gives one.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check_trials(trials)
    tables = {}
    for scenario in ordered(trials["scenario"], "scenario"):
        rows = []
        for method, adherence, group in groups(trials, scenario):
            said = paper.find(scenario, method, adherence) or PaperResult(scenario, method, (adherence,))
            cells: dict[str, object] = {"method": method, "adherence": adherence}
            rows.append(cells | _outcome(group, said, paper.unit) | _effort(group))
        columns = list(dict.fromkeys((*OUTCOME, *TIME, *length_columns(paper.unit), *EFFORT)))
        tables[scenario] = pd.DataFrame(rows, columns=columns)
    return tables


def paired_table(trials: pd.DataFrame, paper: Paper, settings: Settings) -> pd.DataFrame:
    """Compare methods with those that settings name, problem by problem, per scenario and adherence.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check_trials(trials)
    rows, shorter_by = [], f"difference of median lengths, both solved (learned - classical) [{paper.unit}]"
    for scenario in ordered(trials["scenario"], "scenario"):
        part = trials[trials["scenario"] == scenario]
        for learned, classical in method_pairs(part["method"], settings):
            for adherence in ordered(part["adherence"], "adherence"):
                pairs = pair(trials, scenario, adherence, learned, classical)
                fast, slow, scenes = both_solved(pairs, "planning_time")
                test = mcnemar(pairs["solved_1"].to_numpy(bool), pairs["solved_2"].to_numpy(bool))
                printed = paper.speed_up(scenario, adherence, learned, classical)
                ratio = paired_interval(slow, fast, scenes, Comparison.RATIO)
                shorter = paired_interval(*both_solved(pairs, "path_length"))
                rows.append({
                    "scenario": scenario, "learned": learned, "classical": classical, "adherence": adherence,
                    "pairs": len(pairs), "both solved": len(fast),
                    "ratio of median times, both solved (classical / learned)": text.interval(ratio, "×"),
                    "paper: ratio of mean times": "" if printed is None else f"{text.fixed(printed, 2)}×",
                    shorter_by: text.interval(shorter),
                    "only learned solved": test.only_first, "only classical solved": test.only_second,
                    "McNemar p (exact)": text.p_value(test.p_value) if len(pairs) else text.NONE,
                })  # fmt: skip
    return pd.DataFrame(rows)


def rejection_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Count why trials are not solved: the planner's status, or what the verifier found in a path it claimed.

    Returns:
        One row per scenario, method, adherence and reason; empty when everything was solved.
    """
    check_trials(trials)
    rows = []
    for scenario in ordered(trials["scenario"], "scenario"):
        for method, adherence, group in groups(trials, scenario):
            failed = group[~group["solved"].astype(bool)]
            claimed = failed["claimed"].astype(bool)
            rejected = "claimed, rejected: " + failed["rejection"].fillna("").astype(str).map(_without_numbers)
            reasons = failed["status"].astype(str).where(~claimed, rejected)
            for reason, count in reasons.value_counts().sort_index().items():
                rows.append((scenario, method, adherence, len(group), count, reason))
    return pd.DataFrame(rows, columns=["scenario", "method", "adherence", "n", "not solved", "reason"])


def _without_numbers(sentence: str) -> str:
    """Leave the verifier's numbers out, so that rejections of one kind count as one."""
    return re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", re.sub(r"\[[^\]]*\]", "[#]", sentence))


def _outcome(group: pd.DataFrame, said: PaperResult, unit: str) -> dict[str, object]:
    solved = group[group["solved"].astype(bool)]
    cells: dict[str, object] = {
        "n": len(group), "n solved": len(solved),
        "success [95 %]": text.rate(success_interval(group["solved"].to_numpy(bool), group["scene"].to_numpy(str))),
        "paper: success": said.success_text, "paper: time [s]": said.time_text, "paper: length": said.length_text,
    }  # fmt: skip
    cells |= _location("time, all trials", "s", group["planning_time"], p95=False)
    cells |= _location("time, solved only", "s", solved["planning_time"])
    return cells | _location("length, solved only", unit, solved["path_length"])


def _location(name: str, unit: str, values: pd.Series, p95: bool = True) -> dict[str, str]:
    found = summary(values.to_numpy(float))
    cells = {
        f"{name}: median [{unit}]": text.number(found.median),
        f"{name}: mean ± sd [{unit}]": text.spread(found.mean, found.sd),
    }
    return cells | ({f"{name}: p95 [{unit}]": text.number(found.p95)} if p95 else {})


def _effort(group: pd.DataFrame) -> dict[str, object]:
    cells: dict[str, object] = {
        f"{name.replace('_', ' ')} (median)": text.fixed(_median(group[name]), 0)
        for name in ("projections", "collision_checks", "samples")
    }
    drawn, fallback = int(group["samples"].sum()), group["fallback_samples"]
    network = group["network_time"] / group["planning_time"].where(group["planning_time"] > 0)
    cells["fallback share of samples (all trials together)"] = text.percent(fallback.sum() / drawn if drawn else np.nan)
    cells["trials with fallback samples"] = text.percent((fallback > 0).mean() if len(group) else np.nan)
    cells["network share of time (median)"] = text.percent(_median(network))
    return cells


def _median(values: pd.Series) -> float:
    """The median without NaN; NaN for none."""
    return summary(values.dropna().to_numpy(float)).median
