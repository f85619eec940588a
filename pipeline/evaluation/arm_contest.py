"""Families of tasks by ours, by OMPL's Python route and by roboplan: same tasks, tolerance, time limit and verifier.

Planned task by task, so that drift of the machine hits all alike. A path is judged by the geometry it was planned with
and by ours: where those differ, contact in ours alone is no fault of the planner.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require
from pipeline.evaluation.families import Ours, Setting
from pipeline.evaluation.ordinary import OrdinaryConstraint, OrdinaryValidity
from pipeline.evaluation.roboplan_peer import GEOMETRY, RoboplanParameters, RoboplanPeer, load_roboplan
from pipeline.evaluation.statistics import summary
from pipeline.manifolds import dense, joined, make_adherence
from pipeline.planners import Problem, Termination
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner
from pipeline.robots import Geometry
from pipeline.schema import Choice
from pipeline.tasks import Task, build

log = logging.getLogger(__name__)
UNPROVEN = "without proof"
ORDINARY, OMPL_OURS, ROBOPLAN = "OMPL, ordinary", "OMPL, our constraint and checker", "roboplan"
ROBOPLAN_PLANS = ("transport", "tray")  # it has neither chains nor feet on the ground nor pictures
TABLE = (
    "family", "route", "n", "claimed [%]", "verified by its own geometry [%]", "verified by ours [%]",
    "time median [ms]", "time mean [ms]", "time p95 [ms]", "worst violation", "length median", "checks median",
    "projections median", "chords proven", "chords sampled",
)  # fmt: skip
_LEAST = {ORDINARY: 20.0, ROBOPLAN: 2.0}  # by how much ours is to be faster
_SHARD = 10  # tasks: what a killed run may lose
_DENSE = 0.02  # spacing at which waypoints of peers are joined on the manifold before they are verified [rad]


@dataclass(frozen=True)
class Variant:
    """Ours with other parameters, by name, of planner, adherence and sampler; with the first adherence method."""

    planner: dict[str, Any] = field(default_factory=dict)
    adherence: dict[str, Any] = field(default_factory=dict)
    sampler: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """Tasks of a family, of those that are measured or of those that settings were chosen on."""

    family: str
    tasks: range
    tried: bool


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
        for name in self.tried_families:
            if name not in self.families:
                raise ConfigError(f"tried_families names {name!r}; there are {', '.join(self.families)}")

    def shards(self) -> list[tuple[str, Part]]:
        """Return names and items of all shards."""
        asked = [(label, False) for label in self.families] + [(label, True) for label in self.tried_families]
        return [
            (f"{'tried-' * tried}{label}-{first}", Part(label, range(first, min(first + _SHARD, self.tasks)), tried))
            for label, tried in asked
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


def arm_shard(contest: ArmContest, item: Part) -> pd.DataFrame:
    """Plan a part of the contest by all routes; return a row per trial.

    Columns: tried (whether it is one of what was tried), family, route, task, time [s], claimed, verified and reason by
    our geometry, verified_own and reason_own by the one it was planned with, length, violation, proven and sampled
    (chords, by the geometry it was planned with), checks, projections.
    """
    setting = contest.families[item.family]
    routes = _tried_routes(contest, setting) if item.tried else _routes(contest, setting)
    family, seed = setting.family(), contest.tried_seed if item.tried else contest.seed
    rows: list[dict[str, Any]] = []
    for number in item.tasks:
        task = build(family.task(seed, number).leg)
        for name, route in routes.items():
            if route.most is None or number < route.most:
                names = {"tried": item.tried, "family": item.family, "route": name, "task": number}
                rows.append({**names, **_trial(setting, route, task, seed)})
    return pd.DataFrame(rows)


def _with(choice: Choice, changes: dict[str, Any]) -> Choice:
    return replace(choice, parameters={**choice.parameters, **changes})


_Plan = Callable[[Task, int], tuple[float, np.ndarray | None, dict[str, int]]]


@dataclass(frozen=True)
class _Route:
    """How a family is planned.

    Attributes:
        plan: returns the time [s], the path (T, n), None without one, and counts.
        most: for how many tasks; None for all.
        geometry: that is planned with; None for that of the task.
    """

    plan: _Plan
    most: int | None = None
    geometry: Geometry | None = None


def _routes(contest: ArmContest, setting: Setting) -> dict[str, _Route]:
    """Return how a family is planned, by name."""
    first = next(iter(setting.adherences.values()))
    routes: dict[str, _Route] = {}
    for name, choice in setting.adherences.items():
        label = f"ours, {name.replace('_', ' ')}"
        routes[label] = _Route(_ours(setting, choice))
        if choice is first and setting.robot is not None:
            routes[f"{label}, {UNPROVEN}"] = _Route(_ours(setting, _with(choice, {"proof": False})))
    routes[ORDINARY] = _Route(_ompl(setting, True), setting.peers)
    routes[OMPL_OURS] = _Route(_ompl(setting, False), setting.peers)
    if contest.roboplan and setting.kind in ROBOPLAN_PLANS:
        for name, parameters in contest.roboplan.items():
            routes[f"{ROBOPLAN}, {name}"] = _Route(_roboplan(setting, parameters), geometry=GEOMETRY)
    return routes


def _tried_routes(contest: ArmContest, setting: Setting) -> dict[str, _Route]:
    """Return ours and its variants, by name."""
    adherence = next(iter(setting.adherences.values()))
    routes = {"as chosen": _Route(_ours(setting, adherence))}
    for name, variant in contest.tried.items():
        changed = replace(
            setting,
            planner=_with(setting.planner, variant.planner),
            sampler=_with(setting.sampler, variant.sampler),
        )
        routes[name] = _Route(_ours(changed, _with(adherence, variant.adherence)))
    return routes


def arm_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns TABLE; times are of all trials, failures included, lengths of paths verified by their own."""
    rows = []
    for (family, route), group in trials.groupby(["family", "route"], sort=False):
        times = summary(1e3 * group["time"].to_numpy())
        passed = group[group["verified_own"]]
        shares = [100 * group[column].mean() for column in ("claimed", "verified_own", "verified")]
        rows.append((
            family, route, len(group), *shares, times.median, times.mean, times.p95, group["violation"].max(),
            passed["length"].median(), group["checks"].median(), group["projections"].median(),
            int(passed["proven"].sum()), int(passed["sampled"].sum()),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLE))


def _trial(setting: Setting, route: _Route, task: Task, seed: int) -> dict[str, Any]:
    seconds, path, counts = route.plan(task, seed)
    found: dict[str, Any] = {"time": seconds, "claimed": path is not None, "length": np.nan, "violation": np.nan}
    found |= {"verified": False, "reason": "", "verified_own": False, "reason_own": "", "proven": 0, "sampled": 0}
    found |= {"checks": counts.get("collision_checks", np.nan), "projections": counts.get("projections", np.nan)}
    if path is not None:
        verdict = own = setting.verdict(task, path)
        if route.geometry is not None:
            own = setting.verdict(task, path, route.geometry)
        for suffix, judged in (("", verdict), ("_own", own)):
            reason = judged.failure.value if judged.failure else ""
            found |= {f"verified{suffix}": judged.passed, f"reason{suffix}": reason}
        found |= {"length": verdict.length, "violation": verdict.max_violation}
        found |= {"proven": own.chords_proven, "sampled": own.chords_sampled}
    return found


def _ours(setting: Setting, adherence: Choice) -> _Plan:
    ours = Ours(setting, adherence)

    def plan(task: Task, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
        result = ours.plan(task, Termination(time_limit=setting.time_limit), seed)
        return result.planning_time, result.path if result.solved else None, result.row()

    return plan


def _ompl(setting: Setting, ordinary: bool) -> _Plan:
    adherence = next(iter(setting.adherences.values()))

    def plan(task: Task, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
        space = make_adherence(adherence, task.constraint, task.validity())
        stand_in = (OrdinaryConstraint(task), OrdinaryValidity(task)) if ordinary else None
        parameters = OmplParameters(delta=setting.ompl_delta, project_override=not ordinary)
        planner = OmplPlanner("RRTConnect", "projection", parameters, stand_in)
        asked = Problem(space, task.start, task.goal)
        result = planner.plan(asked, Termination(time_limit=setting.time_limit), seed)
        counts = result.row()
        if ordinary:
            del counts["collision_checks"]  # those of a checker that was not asked
        return result.planning_time, joined(space, result.path) if result.solved else None, counts

    return plan


def _roboplan(setting: Setting, parameters: RoboplanParameters) -> _Plan:
    adherence = next(iter(setting.adherences.values()))
    peer: list[RoboplanPeer] = []  # made with the robot of the first task: its scene takes a second

    def plan(task: Task, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
        if not peer:
            description = setting.description()
            assert description is not None  # mazes have no robot, and roboplan plans none
            peer.append(RoboplanPeer(description, task.robot, parameters))
        seconds, path = peer[0].plan(task, setting.time_limit, seed)
        if path is None:
            return seconds, None, {}
        space = make_adherence(adherence, task.constraint, task.validity())
        return seconds, joined(space, dense(space, path, _DENSE)), {}

    return plan


def ratio_lines(trials: pd.DataFrame) -> list[str]:
    """Return a sentence per family and peer: how much faster the first of ours is on the same tasks, and unproven."""
    lines = []
    for family, group in trials.groupby("family", sort=False):
        ours = next(route for route in group["route"] if route.startswith("ours"))
        unproven = f"{ours}, {UNPROVEN}"
        for route in [r for r in group["route"].unique() if not r.startswith("ours")]:
            median, tail, count = _ratios(group, route, ours)
            least = next((times for name, times in _LEAST.items() if route.startswith(name)), None)
            met = "" if least is None else f" ({least:g}x: {'' if median >= least and tail >= 1 else 'not '}met)"
            if least is not None and route.startswith(ROBOPLAN):
                met = f" ({least:g}x of both: {'' if min(median, tail) >= least else 'not '}met)"
            if not group[group["route"] == route]["claimed"].any():
                met = " (at least: it solved none within the limit)"
            also = ""
            if (group["route"] == unproven).any():
                both = _ratios(group, route, unproven)
                also = f"; without proof {both[0]:.3g}x and {both[1]:.3g}x"
            same = group[group["task"].isin(group[group["route"] == route]["task"])]
            theirs = same[same["route"] == route]
            own, passed = (100 * theirs[column].mean() for column in ("verified_own", "verified"))
            lines.append(
                f"{family}: {median:.3g}x faster than {route} at the median, {tail:.3g}x at p95{met}{also}, "
                f"n = {count}; the verifier passes {own:.3g} % of its trials by the geometry it planned with and "
                f"{passed:.3g} % by ours, and {100 * same[same['route'] == ours]['verified'].mean():.3g} % of ours"
            )
    return lines


def _ratios(group: pd.DataFrame, theirs: str, ours: str) -> tuple[float, float, int]:
    """Return by how much another route takes longer, at the median and at p95, and on how many tasks."""
    times = [group[group["route"] == route].set_index("task")["time"] for route in (theirs, ours)]
    both = times[1].loc[times[0].index]
    median, tail = (float(times[0].quantile(q) / both.quantile(q)) for q in (0.5, 0.95))
    return median, tail, len(both)
