"""Families of tasks by ours, by OMPL's Python route and by roboplan: same tasks, tolerance, time limit and verifier.

Planned task by task, so that drift of the machine hits all alike.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.environments.task import Task
from pipeline.errors import ConfigError, require
from pipeline.evaluation.families import Ours, Setting
from pipeline.evaluation.ordinary import OrdinaryConstraint, OrdinaryValidity
from pipeline.evaluation.roboplan_peer import RoboplanParameters, RoboplanPeer, load_roboplan
from pipeline.evaluation.statistics import summary
from pipeline.manifolds import dense, make_adherence
from pipeline.planners import Problem, Termination
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner
from pipeline.schema import Choice

log = logging.getLogger(__name__)
ORDINARY, OMPL_OURS, ROBOPLAN = "OMPL, ordinary", "OMPL, our constraint and checker", "roboplan"
TABLE = (
    "family", "route", "n", "claimed [%]", "verified [%]", "time median [ms]", "time mean [ms]", "time p95 [ms]",
    "worst violation", "length median", "checks median", "projections median",
)  # fmt: skip
_DENSE = 0.02  # spacing at which waypoints of peers are joined on the manifold before they are verified [rad]


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
        for name in self.tried_families:
            if name not in self.families:
                raise ConfigError(f"tried_families names {name!r}; there are {', '.join(self.families)}")


def tried_trials(contest: ArmContest) -> pd.DataFrame:
    """Plan tasks of `tried_seed` by ours and its variants; return a row per trial, as `arm_trials` does."""
    rows: list[dict[str, Any]] = []
    for label in contest.tried_families:
        setting = contest.families[label]
        adherence = next(iter(setting.adherences.values()))
        routes = {"as chosen": _ours(setting, adherence)}
        for name, variant in contest.tried.items():
            changed = replace(
                setting,
                planner=_with(setting.planner, variant.planner),
                sampler=_with(setting.sampler, variant.sampler),
            )
            routes[name] = _ours(changed, _with(adherence, variant.adherence))
        rows += _trials(
            label, setting, contest.tried_seed, contest.tasks, {name: (p, None) for name, p in routes.items()}
        )
    return pd.DataFrame(rows)


def _with(choice: Choice, changes: dict[str, Any]) -> Choice:
    return replace(choice, parameters={**choice.parameters, **changes})


_Plan = Callable[[Task, int], tuple[float, np.ndarray | None, dict[str, int]]]


def arm_trials(contest: ArmContest) -> pd.DataFrame:
    """Plan everything; return a row per trial. roboplan is left out where it is not installed."""
    peers = contest.roboplan or {}
    try:
        if peers:
            load_roboplan()
    except ConfigError as error:
        log.warning("without roboplan: %s", error)
        peers = {}
    rows: list[dict[str, Any]] = []
    for label, setting in contest.families.items():
        routes: dict[str, tuple[_Plan, int | None]] = {
            f"ours, {name.replace('_', ' ')}": (_ours(setting, choice), None)
            for name, choice in setting.adherences.items()
        }
        routes |= {ORDINARY: (_ompl(setting, True), setting.peers), OMPL_OURS: (_ompl(setting, False), setting.peers)}
        if setting.kind == "transport":  # it has neither chains nor contacts nor pictures
            for name, parameters in peers.items():
                routes[f"{ROBOPLAN}, {name}"] = (_roboplan(setting, parameters), None)
        rows += _trials(label, setting, contest.seed, contest.tasks, routes)
    return pd.DataFrame(rows)


def _trials(
    label: str, setting: Setting, seed: int, tasks: int, routes: Mapping[str, tuple[_Plan, int | None]]
) -> list[dict[str, Any]]:
    """Plan task by task; a route with a number takes only so many tasks."""
    family, rows = setting.family(), []
    for number in range(tasks):
        task = family.task(seed, number)
        for route, (plan, most) in routes.items():
            if most is None or number < most:
                rows.append({"family": label, "route": route, "task": number, **_trial(setting, plan, task, seed)})
        if number % 10 == 9:
            log.info("%s: task %d of %d", label, number + 1, tasks)
    return rows


def arm_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns TABLE; times are of all trials, failures included, lengths of verified paths."""
    rows = []
    for (family, route), group in trials.groupby(["family", "route"], sort=False):
        times = summary(1e3 * group["time"].to_numpy())
        passed = group[group["verified"]]
        rows.append((
            family, route, len(group), 100 * group["claimed"].mean(), 100 * group["verified"].mean(), times.median,
            times.mean, times.p95, group["violation"].max(), passed["length"].median(), group["checks"].median(),
            group["projections"].median(),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLE))


def _trial(setting: Setting, plan: _Plan, task: Task, seed: int) -> dict[str, Any]:
    seconds, path, counts = plan(task, seed)
    found = {"time": seconds, "claimed": path is not None, "verified": False, "reason": "", "length": np.nan}
    found |= {"violation": np.nan, "checks": counts.get("collision_checks", np.nan)}
    found |= {"projections": counts.get("projections", np.nan)}
    if path is not None:
        verdict = setting.verdict(task, path)
        reason = verdict.failure.value if verdict.failure else ""
        found |= {"verified": verdict.passed, "reason": reason}
        found |= {"length": verdict.length, "violation": verdict.max_violation}
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
        return result.planning_time, result.path if result.solved else None, result.row()

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
        return seconds, dense(make_adherence(adherence, task.constraint, task.validity()), path, _DENSE), {}

    return plan


def ratio_lines(trials: pd.DataFrame) -> list[str]:
    """Return a sentence per family and peer: how much faster the first of ours is on the same tasks."""
    lines = []
    for family, group in trials.groupby("family", sort=False):
        ours = next(route for route in group["route"] if route.startswith("ours"))
        mine = group[group["route"] == ours].set_index("task")["time"]
        for route in [r for r in group["route"].unique() if not r.startswith("ours")]:
            theirs = group[group["route"] == route].set_index("task")["time"]
            both = mine.loc[theirs.index]
            median, tail = theirs.median() / both.median(), theirs.quantile(0.95) / both.quantile(0.95)
            same = group[group["task"].isin(theirs.index)]
            passed = [100 * same[same["route"] == r]["verified"].mean() for r in (route, ours)]
            lines.append(
                f"{family}: {median:.3g}x faster than {route} at the median, {tail:.3g}x at p95, n = {len(theirs)}; "
                f"the verifier passes {passed[0]:.3g} % of its trials and {passed[1]:.3g} % of ours"
            )
    return lines
