"""Families of tasks by ours, by OMPL's Python route and by roboplan: same tasks, tolerance, time limit and verifier.

Planned task by task, so that drift of the machine hits all alike. A path is judged by the geometry it was planned with
and by ours: where those differ, contact in ours alone is no fault of the planner.
"""

import logging
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require, require_name
from pipeline.evaluation.families import Setting
from pipeline.evaluation.ompl_route import Ompl
from pipeline.evaluation.roboplan_peer import Roboplan, RoboplanParameters, load_roboplan
from pipeline.evaluation.routes import Manifold, Names, Role, Route
from pipeline.evaluation.runner import Runner
from pipeline.evaluation.statistics import summary
from pipeline.planners import Termination
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner

log = logging.getLogger(__name__)
ORDINARY, OMPL_OURS, ROBOPLAN = "OMPL, ordinary", "OMPL, our constraint and checker", "roboplan"
ROBOPLAN_PLANS = ("transport", "tray")  # it has neither chains nor feet on the ground nor pictures
TABLE = (
    "family", "route", "n", "claimed [%]", "verified by its own geometry [%]", "verified by ours [%]",
    "time median [ms]", "time mean [ms]", "time p95 [ms]", "worst violation", "length median", "checks median",
    "projections median", "chords proven", "chords sampled",
)  # fmt: skip
_LEAST = {ORDINARY: (20.0, 1.0), ROBOPLAN: (2.0, 2.0)}  # by how much ours is to be faster, at the median and at p95
_SHARD = 10  # tasks: what a killed run may lose


@dataclass(frozen=True)
class Variant:
    """Ours with other parameters, by name, of planner, adherence and sampler; with the first adherence method."""

    planner: dict[str, Any] = field(default_factory=dict)
    adherence: dict[str, Any] = field(default_factory=dict)
    sampler: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ArmContest:
    """What is compared, under which bounds.

    Attributes:
        families: by name.
        tasks: per family.
        seed: of the tasks and plans; validation uses others.
        roboplan: options by label, for families it can plan; None leaves it out.
        tried: variants of ours by label, planned on tasks of another seed.
        tried_families: the families they plan.
        tried_seed: that seed, on which settings are chosen.
    """

    families: dict[str, Setting]
    tasks: int
    seed: int
    roboplan: dict[str, RoboplanParameters] | None
    tried: dict[str, Variant]
    tried_families: list[str]
    tried_seed: int

    def __post_init__(self) -> None:
        if self.tried_seed == self.seed:
            raise ConfigError(f"tried_seed is {self.tried_seed}, the seed that is measured: settings need another one")
        require("tasks", self.tasks, at_least=1)
        if not self.families:
            raise ConfigError("there is no family to plan")
        for name in self.families:
            require_name("a name in families", name)
        for name in self.tried_families:
            if name not in self.families:
                raise ConfigError(f"tried_families names {name!r}; there are {', '.join(self.families)}")

    def shards(self) -> list[tuple[str, tuple[str, range, bool]]]:
        """Return names and items of all shards: a family, numbers of its tasks, and whether variants plan them."""
        return [
            (f"{'tried-' * tried}{label}-{first}", (label, range(first, min(first + _SHARD, self.tasks)), tried))
            for tried, labels in ((False, self.families), (True, self.tried_families))
            for label in labels
            for first in range(0, self.tasks, _SHARD)
        ]


def installed(contest: ArmContest) -> ArmContest:
    """Return the contest without roboplan where that is not installed."""
    try:
        if contest.roboplan:
            load_roboplan()
    except ConfigError as error:
        log.warning("without roboplan: %s", error)
        return replace(contest, roboplan=None)
    return contest


def arm_shard(contest: ArmContest, item: tuple[str, range, bool]) -> pd.DataFrame:
    """Plan a part of the contest by all routes; return the runner's rows.

    A column more, `tried`, tells whether it is one of what was tried.
    """
    label, numbers, tried = item
    setting, seed = contest.families[label], contest.tried_seed if tried else contest.seed
    routes = _tried_routes(contest, setting) if tried else _routes(contest, setting)
    runner = Runner(Termination(time_limit=setting.time_limit), setting.verifier)
    return pd.DataFrame([
        {"tried": tried, **runner.row(route, case, seed)}
        for case in setting.cases(label, seed, numbers)
        for route, most in routes
        if case.problem < most
    ])  # fmt: skip


def _routes(contest: ArmContest, setting: Setting) -> list[tuple[Route, float]]:
    """Return how a family is planned, and for how many tasks each; ours by the first adherence method comes first."""
    (first, choice), routes = next(iter(setting.adherences.items())), list[tuple[Route, float]]()
    for key in setting.adherences:
        label = f"ours, {key.replace('_', ' ')}"
        routes.append((setting.ours(key, label), np.inf))
        if key == first and setting.robot is not None:
            bare = setting.changed(adherence={"proof": False})
            routes.append((bare.ours(key, f"{label}, without proof", Role.UNPROVEN), np.inf))
    manifold = Manifold(choice)
    for label in (ORDINARY, OMPL_OURS):
        parameters = OmplParameters(delta=setting.ompl_delta, project_override=label == OMPL_OURS)
        names = Names(label, label, "", "projection", Role.PEER)
        planner = OmplPlanner("RRTConnect", "projection", parameters)
        routes.append((Ompl(names, manifold, planner, label == ORDINARY), setting.peers))
    description = setting.description()
    if contest.roboplan and description is not None and setting.kind in ROBOPLAN_PLANS:
        for name, options in contest.roboplan.items():
            names = Names(f"{ROBOPLAN}, {name}", ROBOPLAN, "", "projection", Role.PEER)
            routes.append((Roboplan(names, manifold, description, options), np.inf))
    return routes


def _tried_routes(contest: ArmContest, setting: Setting) -> list[tuple[Route, float]]:
    """Return ours and its variants, for all tasks."""
    first, variants = next(iter(setting.adherences)), {"as chosen": Variant(), **contest.tried}
    return [(setting.changed(**vars(variant)).ours(first, label), np.inf) for label, variant in variants.items()]


def arm_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns TABLE; times are of all trials, failures included, lengths of paths verified by their own."""
    rows = []
    for (family, route), group in trials.groupby(["environment", "method"], sort=False):
        times = summary(1e3 * group["planning_time"].to_numpy())
        passed = group[group["solved_own"]]
        shares = [100 * group[column].mean() for column in ("claimed", "solved_own", "solved")]
        rows.append((
            family, route, len(group), *shares, times.median, times.mean, times.p95, group["max_violation"].max(),
            passed["path_length"].median(), group["collision_checks"].median(), group["projections"].median(),
            int(passed["chords_proven"].sum()), int(passed["chords_sampled"].sum()),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLE))


def of_role(group: pd.DataFrame, role: Role) -> list[str]:
    """Return the labels of the routes with a role, in the order in which they were planned."""
    return list(group.loc[group["role"] == role.value, "method"].unique())


def ratio_lines(trials: pd.DataFrame) -> list[str]:
    """Return a sentence per family and peer: how much faster the first of ours is on the same tasks, and unproven."""
    lines = []
    for family, group in trials.groupby("environment", sort=False):
        ours, unproven = of_role(group, Role.OURS)[0], of_role(group, Role.UNPROVEN)
        for route in of_role(group, Role.PEER):
            theirs = group[group["method"] == route]
            median, tail, count = _ratios(group, route, ours)
            least, least_tail = _LEAST.get(theirs["planner"].iloc[0], (0.0, 0.0))
            of = f"{least:g}x{' of both' if least == least_tail else ''}"
            met = f" ({of}: {'' if median >= least and tail >= least_tail else 'not '}met)" if least else ""
            if not theirs["claimed"].any():
                met = " (at least: it solved none within the limit)"
            both = [_ratios(group, route, label) for label in unproven]
            also = "".join(f"; without proof {found[0]:.3g}x and {found[1]:.3g}x" for found in both)
            same = group[(group["method"] == ours) & group["problem"].isin(theirs["problem"])]
            own, passed = (100 * theirs[column].mean() for column in ("solved_own", "solved"))
            lines.append(
                f"{family}: {median:.3g}x faster than {route} at the median, {tail:.3g}x at p95{met}{also}, "
                f"n = {count}; the verifier passes {own:.3g} % of its trials by the geometry it planned with and "
                f"{passed:.3g} % by ours, and {100 * same['solved'].mean():.3g} % of ours"
            )
    return lines


def _ratios(group: pd.DataFrame, theirs: str, ours: str) -> tuple[float, float, int]:
    """Return by how much another route takes longer, at the median and at p95, and on how many tasks."""
    times = [group[group["method"] == route].set_index("problem")["planning_time"] for route in (theirs, ours)]
    both = times[1].loc[times[0].index]
    median, tail = (float(times[0].quantile(q) / both.quantile(q)) for q in (0.5, 0.95))
    return median, tail, len(both)
