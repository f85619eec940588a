"""What was expected of an environment and whether it was met; 'no' is said plainly."""

import itertools
import math
from collections.abc import Iterator, Sequence

import pandas as pd

from pipeline.evaluation import Center, Comparison, Interval, paired_interval, success_interval, summary
from pipeline.reporting import text
from pipeline.reporting.frames import both_solved, check_trials, groups, ordered, pair
from pipeline.reporting.paper import Paper

SUCCESS = "success at least the paper's"
FASTER, SHORTER = "{} faster than {}, by medians", "{}'s paths shorter than {}'s"  # named by conf/paper
SPEED = "{} faster than {} by at least the paper's ratio, by medians"
MEAN_SPEED = "{} faster than {} by at least the paper's ratio, by means as in the paper"
_SPEEDS = ((SPEED, Center.MEDIAN), (MEAN_SPEED, Center.MEAN))
YES, NO, NO_DATA, NO_NUMBER = "yes", "no", "not measured", "paper gives no number"
COLUMNS = ("scenario", "expectation", "method", "adherence", "met", "ours", "paper", "remark")

_HOW = (
    "Success: the fraction of trials with a verified path. Speed: the ratio of median times, which says what a "
    "usual problem gains, and, where a paper takes it, of mean times, in which a few hard problems weigh most; both "
    "on the problems that both methods solved. A baseline called tuned was tuned by the same rule on the same "
    "validation scenes as ours. "
    "Length: the difference of median lengths on the problems that both solved."
)
SUMMARY_NOTE = f"An expectation is met when every method and adherence that can be compared meets it. {_HOW}"
VERDICT_NOTE = (
    f"Decided by the measured value alone; the remark says where the 95 % interval would allow the other answer. {_HOW}"
)


def verdict_table(trials: pd.DataFrame, paper: Paper) -> pd.DataFrame:
    """Return one row per expectation, scenario, method and adherence: met or not, and the numbers that say so.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check_trials(trials)
    rows: list[tuple[str, ...]] = []
    for scenario in ordered(trials["scenario"], "scenario"):
        rows += _success(trials, scenario, paper) if paper.results else []
        adherences = ordered(trials.loc[trials["scenario"] == scenario, "adherence"], "adherence")
        for methods in paper.faster:
            rows += [_faster(trials, scenario, adherence, methods) for adherence in adherences]
        for methods, (said, center) in itertools.product(paper.by_ratio, _SPEEDS):
            rows += [_faster(trials, scenario, adherence, methods, said, center, paper) for adherence in adherences]
        for learned, classical in paper.shorter:
            rows += [_shorter(trials, scenario, adherence, learned, classical, paper.unit) for adherence in adherences]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def verdict_summary(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scenario and expectation: 'yes' where every comparable row of `verdict_table` is met."""
    rows = []
    for (scenario, expectation), part in verdicts.groupby(["scenario", "expectation"], sort=False):
        comparable = part[part["met"].isin([YES, NO])]
        met = int((comparable["met"] == YES).sum())
        answer = NO_DATA if comparable.empty else YES if met == len(comparable) else NO
        missed = [f"{r.method}, {r.adherence}: {r.ours}" for r in comparable[comparable["met"] == NO].itertuples()]
        rows.append((scenario, expectation, answer, f"{met} of {len(comparable)}", "; ".join(missed)))
    return pd.DataFrame(rows, columns=["scenario", "expectation", "met", "rows met", "not met by"])


def _success(trials: pd.DataFrame, scenario: str, paper: Paper) -> Iterator[tuple[str, ...]]:
    for method, adherence, group in groups(trials, scenario):
        said = paper.find(scenario, method, adherence)
        ours = success_interval(group["solved"].to_numpy(bool), group["scene"].to_numpy(str))
        head = (scenario, SUCCESS, method, adherence)
        if said is None or said.success is None:
            yield (*head, NO_NUMBER, text.rate(ours), text.NONE, "")
            continue
        # 'over 99 %' asks for more than 99 %, 'around 95 %' for 95 %.
        met = ours.estimate > said.success if said.success_exceeds else ours.estimate >= said.success
        yield (*head, _answer(ours, met), text.rate(ours), said.success_text, _doubt(ours, said.success))


def _faster(
    trials: pd.DataFrame,
    scenario: str,
    adherence: str,
    methods: tuple[str, str],
    expectation: str = FASTER,
    center: Center = Center.MEDIAN,
    paper: Paper | None = None,
) -> tuple[str, ...]:
    """Return whether the first method is faster, or as many times as fast as a paper says."""
    fast, slow, scenes = both_solved(pair(trials, scenario, adherence, *methods), "planning_time")
    ours = paired_interval(slow, fast, scenes, Comparison.RATIO, center)
    head, measured = (scenario, expectation.format(*methods), " / ".join(methods), adherence), text.interval(ours, "×")
    printed = 1.0 if paper is None else paper.speed_up(scenario, adherence, *methods)
    if printed is None:
        return (*head, NO_NUMBER, measured, text.NONE, "")
    met = ours.estimate > printed if paper is None else ours.estimate >= printed
    said = "faster" if paper is None else f"{text.fixed(printed, 2)}×"
    return (*head, _answer(ours, met), measured, said, _join([_doubt(ours, printed), f"n = {len(fast)}"]))


def _shorter(
    trials: pd.DataFrame, scenario: str, adherence: str, learned: str, classical: str, unit: str
) -> tuple[str, ...]:
    lengths = both_solved(pair(trials, scenario, adherence, learned, classical), "path_length")
    ours = paired_interval(*lengths)
    head = (scenario, SHORTER.format(learned, classical), f"{learned} - {classical}", adherence)
    medians = f" {unit} and ".join(text.number(summary(side).median) for side in lengths[:2])
    remark = _join([_doubt(ours, 0.0), f"medians {medians} {unit}", f"n = {len(lengths[0])}"])
    return (*head, _answer(ours, ours.estimate < 0), text.interval(ours, f" {unit}"), "shorter", remark)


def _answer(ours: Interval, met: bool) -> str:
    return NO_DATA if math.isnan(ours.estimate) else YES if met else NO


def _doubt(ours: Interval, bound: float) -> str:
    if math.isnan(ours.low):
        return ""
    return "interval includes the bound" if ours.low <= bound <= ours.high else ""


def _join(remarks: Sequence[str]) -> str:
    return "; ".join(remark for remark in remarks if remark)
