"""Our planners against OMPL's from Python: same problems, constraint, validity checker and time limit, one process.

Planned problem by problem, so that drift of the machine hits all alike. OMPL's spacing of states counts twice: it is
the step of a walk and the resolution of its collision checks. So there are several, each with the problems it can
afford, and every ratio is of medians over the same problems. Where ours checks at another spacing than OMPL, it plans
once more with OMPL's: only then do both have the same checker.

OMPL's charts give FMT all of its samples near the start and the goal, where ours has as many on the whole manifold. For
lengths to say something about the planner, ours plans once more with a first batch that OMPL has drawn.
"""

import itertools
import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require
from pipeline.evaluation.clusters import paired_interval, success_interval
from pipeline.evaluation.ompl_route import Ompl
from pipeline.evaluation.routes import Case, Manifold, Names, Ours, Role, Route
from pipeline.evaluation.runner import Runner
from pipeline.evaluation.statistics import Center, Comparison, Summary, summary
from pipeline.learning.choices import make_sampler
from pipeline.manifolds import Adherence, AtlasParameters
from pipeline.planners import PLANNERS, FmtStar, Planner, Query, Termination
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.tasks import Task
from pipeline.verification.verdict import VerifierParameters

log = logging.getLogger(__name__)
OURS, SAME, ORDINARY, OVERRIDDEN = "ours", "ours, OMPL's spacing", "OMPL", "OMPL, project overridden"
CHARTED, NEIGHBOURS = "ours, OMPL's samples", "OMPL, our neighbours"
SPACING = "OMPL's spacing [m]"
_AS_IT_IS = ("medians, ours as it is", "p95s, ours as it is")
PLANNING = (
    "planner", SPACING, "adherence", "route", "n", "claimed [%]", "verified [%]", "time median [ms]", "time mean [ms]",
    "time p95 [ms]", "ratio of medians", "95 % from", "95 % to", "ratio of p95s", *_AS_IT_IS, "length median [m]",
)  # fmt: skip
PARITY = (
    "planner", SPACING, "adherence", "route", "against", "n",
    "verified: ours", "verified: OMPL", "only ours", "only OMPL", "both", "success: ours [95 %]",
    "success: OMPL [95 %]", "mean length, both: ours [m]", "mean length, both: OMPL [m]", "ours - OMPL [m]",
    "95 % from", "95 % to", "ours / OMPL, problem by problem, median [95 %]",
)  # fmt: skip
_OWN = (OURS, SAME, CHARTED)
_PEERS = {"rrtconnect": ("RRTConnect", "RRTConnect"), "fmt": ("FMT*", "FMT")}  # our kind: label, OMPL's name
_WARM_UP = 0.5  # [s] of a plan that is not counted; whatever is touched for the first time is touched by then


@dataclass(frozen=True)
class Spacing:
    """OMPL's delta [m] and how many of the problems are planned with it."""

    delta: float
    problems: int

    def __post_init__(self) -> None:
        require(f"spacing {self.delta}: problems", self.problems, at_least=1)


@dataclass(frozen=True)
class Contest:
    """What is compared, under which bounds.

    Attributes:
        planners, adherences, sampler: ours; OMPL takes what it also has from them.
        spacings: OMPL's; the first problems of each are the same.
        time_limit: of every plan [s].
        seed: of all plans; each problem has its own, the same for all.
        verifier: bounds of the check.
    """

    planners: dict[str, Choice]
    adherences: dict[str, Choice]
    sampler: Choice
    spacings: tuple[Spacing, ...]
    time_limit: float
    seed: int
    verifier: VerifierParameters

    def __post_init__(self) -> None:
        if not (self.planners and self.adherences and self.spacings):
            raise ConfigError("a contest needs at least one planner, one adherence and one spacing")
        for key, choice in self.planners.items():
            if choice.kind not in _PEERS:
                raise ConfigError(f"planners.{key} is {choice.kind!r}; those with a peer in OMPL: {', '.join(_PEERS)}")
        require("seed", self.seed, at_least=0)

    @property
    def labels(self) -> list[str]:
        """Names of the planners in the tables."""
        return [_PEERS[choice.kind][0] for choice in self.planners.values()]

    @property
    def problems(self) -> int:
        """How many problems the contest needs."""
        return max(spacing.problems for spacing in self.spacings)


class ChartSampler(UniformSampler):
    """Draws the first batch from OMPL's charts, whose samples lie around start and goal, later ones as ours does.

    Args:
        peer: whose samples they are.
    """

    def __init__(self, peer: OmplPlanner) -> None:
        super().__init__()
        self.peer = peer

    def draw_cover(self, count: int) -> np.ndarray:
        """Return those of OMPL's samples that can be projected (m, n); its charts begin at both ends."""
        problem = Query(self.adherence, self.asked.start, self.asked.goal)
        return self.adherence.project(self.peer.samples(problem, count, int(self.rng.integers(2**31))))


def contest_trials(contest: Contest, environment: Margins, asked: Sequence[Case]) -> pd.DataFrame:
    """Plan cases with all planners, adherences, routes and spacings; return the runner's rows, in this order.

    The problem is its place among the cases and the planner a label; a column more, delta, is OMPL's spacing, NaN for
    ours as it is.
    """
    begin, entrants = time.monotonic(), list(_entrants(contest, environment, asked[0].task))
    runner = Runner(Termination(time_limit=contest.time_limit), contest.verifier)
    rows: list[dict[str, Any]] = []
    for place, case in enumerate(asked[: contest.problems]):
        seed = case.seed(contest.seed)
        for label, route, delta, problems in entrants:
            if place >= problems:
                continue
            if place == 0:
                route.plan(case, Termination(time_limit=_WARM_UP), seed)
            rows.append({**runner.row(route, case, seed), "planner": label, "problem": place, "delta": delta})
        log.info("planning: problem %d of %d after %.0f s", place + 1, contest.problems, time.monotonic() - begin)
    return pd.DataFrame(rows)


def planning_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns PLANNING, by planner, OMPL's spacing, adherence and route.

    Ours stands in every group, over the problems of that group. Times are of all trials, a failure counts with the
    time it took; ratios are OMPL's over ours with the same spacing, that of medians with its paired bootstrap interval,
    and over ours as it is; lengths are of verified paths.
    """
    rows = []
    for planner, delta, adherence, group in _groups(trials):
        rival = SAME if (group["method"] == SAME).any() else OURS
        p95s = {route: _milliseconds(group[group["method"] == route]).p95 for route in (rival, OURS)}
        for route, part in group.groupby("method", sort=False):
            times = _milliseconds(part)
            ratios: tuple[float, ...] = (np.nan,) * 6
            if route not in _OWN:
                found = paired_interval(*_paired(group, str(route), rival), Comparison.RATIO)
                as_it_is = times.median / _milliseconds(group[group["method"] == OURS]).median
                ratios = (
                    found.estimate,
                    found.low,
                    found.high,
                    times.p95 / p95s[rival],
                    as_it_is,
                    times.p95 / p95s[OURS],
                )
            rows.append((
                planner, delta, adherence, route, len(part), 100 * part["claimed"].mean(), 100 * part["solved"].mean(),
                times.median, times.mean, times.p95, *ratios,
                summary(part["path_length"].dropna().to_numpy(float)).median,
            ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(PLANNING))


def parity_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns PARITY: success and length, ours against OMPL at its finest spacing, paired by problem.

    Routes are ours: as it is and, where it was planned, with OMPL's samples. Lengths are means over the problems that
    both solved, with the bootstrap interval of their difference, which is the mean of the differences problem by
    problem; a difference of medians would compare two different problems. Beside it stands the median of the ratio
    problem by problem, which a few problems with long ways cannot move.
    """
    rows = []
    for planner, delta, adherence, group in _groups(trials[~(trials["delta"] > trials["delta"].min())]):
        theirs = group[~group["method"].isin((*_OWN, NEIGHBOURS))].groupby("method", sort=False)
        for route, (against, part) in itertools.product((OURS, CHARTED), theirs):
            ours = group[group["method"] == route].set_index("problem")
            if ours.empty:
                continue
            other = part.set_index("problem").loc[ours.index]
            x, y = ours["solved"].to_numpy(bool), other["solved"].to_numpy(bool)
            counts = (len(x), x.sum(), y.sum(), (x & ~y).sum(), (~x & y).sum(), (x & y).sum())
            own, peer = (side["path_length"].to_numpy(float)[x & y] for side in (ours, other))
            means = (summary(own).mean, summary(peer).mean)
            where = ours["scene"].to_numpy(str)
            found = paired_interval(own, peer, where[x & y], center=Center.MEAN)
            each = paired_interval(own / peer, np.ones(len(peer)), where[x & y], Comparison.RATIO)
            ratio = f"{each.estimate:.3f} [{each.low:.3f}, {each.high:.3f}]"
            rates = [_rate(side, where) for side in (x, y)]
            names = (planner, delta, adherence, route, str(against))
            rows.append((*names, *map(int, counts), *rates, *means, found.estimate, found.low, found.high, ratio))
    return pd.DataFrame(rows, columns=list(PARITY))


def goal_lines(table: pd.DataFrame, bounds: Mapping[str, float]) -> list[str]:
    """Return one line per row of OMPL in a planning table: whether ours is as many times faster as was promised.

    Met is it when ours is as fast with the same checker, which looks at the same spacing. What ours gains as it is,
    where it may look more closely, stands beside.

    Args:
        table: with the columns PLANNING.
        bounds: least ratio of medians by planner; the ratio of the p95s must be at least 1.
    """
    lines = []
    for row in table[~table["route"].isin((*_OWN, NEIGHBOURS))].to_dict("records"):
        bound, median, p95 = bounds[row["planner"]], row["ratio of medians"], row["ratio of p95s"]
        as_it_is = [row[name] for name in _AS_IT_IS]
        met = "met" if median >= bound and p95 >= 1 else "not met"
        lines.append(
            f"{row['planner']} at least {bound:g}x at the median, no worse at p95: {met} ({median:.3g}x, {p95:.3g}x) "
            f"with {row['adherence'].replace('_', ' ')} against {row['route']}, both at {row[SPACING]:g} m, "
            f"n = {row['n']}; ours as it is {as_it_is[0]:.3g}x, {as_it_is[1]:.3g}x"
        )
    return lines


def parity_lines(table: pd.DataFrame) -> list[str]:
    """Return one line per row of a parity table for ours as it is: whether it is no worse than OMPL.

    Met is it when ours solves at least as many problems, and the interval of the difference of lengths does not lie
    above 0.

    Args:
        table: with the columns PARITY.
    """
    lines = []
    for row in table[table["route"] == OURS].to_dict("records"):
        solved = row["verified: ours"], row["verified: OMPL"]
        worse = solved[0] < solved[1] or row["95 % from"] > 0  # no interval, no verdict against ours
        lines.append(
            f"{row['planner']} no worse than OMPL in success and path length: {'not met' if worse else 'met'} "
            f"({solved[0]} and {solved[1]} of {row['n']} verified; {row['ours - OMPL [m]']:+.3g} m "
            f"[{row['95 % from']:.3g}, {row['95 % to']:.3g}] in the mean, where OMPL's is "
            f"{row['mean length, both: OMPL [m]']:.3g} m, n = {row['both']}) with "
            f"{row['adherence'].replace('_', ' ')} against {row['against']}, OMPL at {row[SPACING]:g} m"
        )
    return lines


def _paired(group: pd.DataFrame, route: str, rival: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the planning times of two routes, problem by problem (n,), (n,) [s], and the scenes (n,)."""
    first, second = (group[group["method"] == name].sort_values("problem") for name in (route, rival))
    name = "planning_time"
    return first[name].to_numpy(float), second[name].to_numpy(float), first["scene"].to_numpy(str)


def _rate(solved: np.ndarray, scenes: np.ndarray) -> str:
    found = success_interval(solved, scenes)
    return f"{100 * found.estimate:.3g} % [{100 * found.low:.3g}, {100 * found.high:.3g}]"


def _milliseconds(trials: pd.DataFrame) -> Summary:
    return summary(1e3 * trials["planning_time"].to_numpy(float))


def _groups(trials: pd.DataFrame) -> Iterator[tuple[str, float, str, pd.DataFrame]]:
    """Yield planner, delta, adherence and their trials: OMPL's with this delta, and ours on the same problems."""
    for planner, of_planner in trials.groupby("planner", sort=False):
        for delta in of_planner["delta"].dropna().unique():
            for adherence, group in of_planner.groupby("adherence", sort=False):
                theirs = group["delta"] == delta
                ours = (group["method"] == OURS) & group["problem"].isin(group[theirs]["problem"])
                yield str(planner), float(delta), str(adherence), group[ours | theirs]


def _entrants(contest: Contest, environment: Margins, task: Task) -> Iterator[tuple[str, Route, float, int]]:
    """Yield planners by label, each by one route, with OMPL's spacing and for how many problems."""
    margins = environment.margin, environment.self_margin
    finest, sampler = min(contest.spacings, key=lambda spacing: spacing.delta), make_sampler(contest.sampler)
    own = {key: Manifold(choice, *margins) for key, choice in contest.adherences.items()}
    same: dict[tuple[str, float], Manifold] = {}
    for spacing, (key, manifold) in itertools.product(contest.spacings, own.items()):
        parameters = manifold.at(task).parameters
        resolution = min(spacing.delta, parameters.step)
        if resolution != parameters.resolution:
            choice = contest.adherences[key]
            choice = replace(choice, parameters={**choice.parameters, "resolution": resolution})
            same[key, spacing.delta] = Manifold(choice, *margins)
    for key, choice in contest.planners.items():
        planner, (label, name) = choice.make(PLANNERS, f"planners.{key}"), _PEERS[choice.kind]
        for adherence, manifold in own.items():
            kind, space = contest.adherences[adherence].kind, manifold.at(task)
            names = Names(OURS, choice.kind, contest.sampler.kind, adherence)
            yield label, Ours(names, manifold, planner, sampler), np.nan, contest.problems
            for spacing in contest.spacings:
                delta, problems = spacing.delta, spacing.problems
                if (adherence, delta) in same:
                    route = Ours(replace(names, method=SAME), same[adherence, delta], planner, sampler)
                    yield label, route, delta, problems
                peers = {ORDINARY: _parameters(space, planner, delta, False)}
                if kind == "projection":  # charts have a Newton iteration of their own that cannot be replaced
                    peers[OVERRIDDEN] = _parameters(space, planner, delta, True)
                if isinstance(planner, FmtStar):
                    peers[NEIGHBOURS] = _parameters(space, planner, delta, False, neighbours=True)
                for title, options in peers.items():
                    other = Names(title, name, "", adherence, Role.PEER)
                    yield label, Ompl(other, manifold, OmplPlanner(name, kind, options)), delta, problems
                if isinstance(planner, FmtStar) and isinstance(space.parameters, AtlasParameters) and spacing is finest:
                    charts = ChartSampler(OmplPlanner(name, kind, peers[ORDINARY]))
                    yield label, Ours(replace(names, method=CHARTED), manifold, planner, charts), delta, problems


def _parameters(
    space: Adherence, planner: Planner, delta: float, override: bool, neighbours: bool = False
) -> OmplParameters:
    """What both have is ours, the charts' and the number of samples; the rest is OMPL's default, as users have it.

    With `neighbours` FMT has as many as ours: both take (2 eta)^D (e / D) log N, OMPL in the ambient dimension.
    """
    shared: dict[str, Any] = {"delta": delta, "project_override": override, "leap": space.parameters.leap}
    if isinstance(space.parameters, AtlasParameters):
        shared |= {name: getattr(space.parameters, name) for name in ("epsilon", "rho", "alpha", "exploration")}
    if isinstance(planner, FmtStar):
        shared["num_samples"] = planner.samples
        if neighbours:
            n, d = space.constraint.n, space.constraint.manifold_dimension
            shared["radius_multiplier"] = ((2 * planner.radius_multiplier) ** d * n / d) ** (1 / n) / 2
    return OmplParameters(**shared)
