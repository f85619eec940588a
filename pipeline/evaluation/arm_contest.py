"""Upright transport by ours, by OMPL's Python route and by roboplan: same problems, tolerance, time limit and verifier.

Planned problem by problem, so that drift of the machine hits all alike.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.environments.transport import STATIONS, ArmProblem, transport, transport_constraint
from pipeline.errors import ConfigError, require
from pipeline.evaluation.ordinary import OrdinaryUpright, OrdinaryValidity
from pipeline.evaluation.roboplan_peer import RoboplanParameters, RoboplanPeer
from pipeline.evaluation.statistics import summary
from pipeline.evaluation.verifier import VerifierParameters, verify
from pipeline.manifolds import Adherence, make_adherence
from pipeline.planners import PLANNERS, Problem, Termination
from pipeline.planners.ompl_adapter import OmplParameters, OmplPlanner
from pipeline.robots import ROBOTS, Robot, Validity
from pipeline.samplers.choices import make_sampler
from pipeline.schema import Choice

log = logging.getLogger(__name__)
ORDINARY, OMPL_OURS, ROBOPLAN = "OMPL, ordinary", "OMPL, our constraint and checker", "roboplan"
TABLE = (
    "robot", "route", "n", "claimed [%]", "verified [%]", "time median [ms]", "time mean [ms]", "time p95 [ms]",
    "worst violation", "length median [rad]", "checks median", "projections median",
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
        robots: as in conf/robot.
        problems: per robot.
        seed: of the problems and plans; validation uses others.
        time_limit: of every plan [s].
        margin: ours, to obstacles [m]; peers plan without.
        adherences: ours.
        planner, sampler: ours.
        ompl_delta: step of OMPL's walks, at which it checks collisions [rad].
        ordinary: how many problems OMPL's ordinary route plans: each takes seconds.
        roboplan: options by label; None leaves it out.
        verifier: bounds of the check.
        tried: variants of ours by label, planned on problems of another seed.
        tried_seed: that seed, on which settings are chosen.
    """

    robots: dict[str, Choice]
    problems: int
    seed: int
    time_limit: float
    margin: float
    adherences: dict[str, Choice]
    planner: Choice
    sampler: Choice
    ompl_delta: float
    ordinary: int
    roboplan: dict[str, RoboplanParameters] | None
    verifier: VerifierParameters
    tried: dict[str, Variant]
    tried_seed: int

    def __post_init__(self) -> None:
        if self.tried_seed == self.seed:
            raise ConfigError(f"tried_seed is {self.tried_seed}, the seed that is measured: settings need another one")
        require("problems", self.problems, at_least=1)
        require("ordinary", self.ordinary, at_least=0, at_most=self.problems)
        require("time_limit", self.time_limit, above=0, unit=" s")
        unknown = [choice.name for choice in self.robots.values() if choice.name not in STATIONS]
        if unknown or not self.robots:
            raise ConfigError(f"robots without a station for upright transport: {unknown}; there are {list(STATIONS)}")


def tried_trials(contest: ArmContest) -> pd.DataFrame:
    """Plan problems of `tried_seed` by ours and its variants; return a row per trial, as `arm_trials` does."""
    (name, adherence), *_ = contest.adherences.items()
    plans = {"as chosen": next(iter(_ours(contest).values()))}
    for label, variant in contest.tried.items():
        changed = replace(
            contest,
            planner=_with(contest.planner, variant.planner),
            sampler=_with(contest.sampler, variant.sampler),
            adherences={name: _with(adherence, variant.adherence)},
        )
        (plans[label],) = _ours(changed).values()
    rows: list[dict[str, Any]] = []
    for choice in contest.robots.values():
        robot: Robot = choice.make(ROBOTS, "robot").robot()
        constraint = transport_constraint(robot)
        for number in range(contest.problems):
            problem = transport(robot, constraint, contest.tried_seed, number)
            exact = Validity(robot, problem.obstacles)
            for label, plan in plans.items():
                found = _trial(contest, plan, problem, exact)
                rows.append({"robot": robot.name, "route": label, "problem": number, **found})
        log.info("%s: what was tried", robot.name)
    return pd.DataFrame(rows)


def _with(choice: Choice, changes: dict[str, Any]) -> Choice:
    return replace(choice, parameters={**choice.parameters, **changes})


_Plan = Callable[[ArmProblem, int], tuple[float, np.ndarray | None, dict[str, int]]]


def arm_trials(contest: ArmContest) -> pd.DataFrame:
    """Plan everything; return a row per trial."""
    rows: list[dict[str, Any]] = []
    for choice in contest.robots.values():
        settings = choice.make(ROBOTS, "robot")
        robot: Robot = settings.robot()
        constraint = transport_constraint(robot)
        routes = {**_ours(contest), **_ompl(contest, robot)}
        for label, parameters in (contest.roboplan or {}).items():
            peer = RoboplanPeer(settings, robot, parameters)
            routes[f"{ROBOPLAN}, {label}"] = _roboplan(contest, peer)
        for number in range(contest.problems):
            problem = transport(robot, constraint, contest.seed, number)
            exact = Validity(robot, problem.obstacles)
            for label, plan in routes.items():
                if label == ORDINARY and number >= contest.ordinary:
                    continue
                rows.append(
                    {"robot": robot.name, "route": label, "problem": number, **_trial(contest, plan, problem, exact)}
                )
            log.info("%s: problem %d of %d", robot.name, number + 1, contest.problems)
    return pd.DataFrame(rows)


def arm_table(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the columns TABLE; times are of all trials, failures included, lengths of verified paths."""
    rows = []
    for (robot, route), group in trials.groupby(["robot", "route"], sort=False):
        times = summary(1e3 * group["time"].to_numpy())
        passed = group[group["verified"]]
        rows.append((
            robot, route, len(group), 100 * group["claimed"].mean(), 100 * group["verified"].mean(), times.median,
            times.mean, times.p95, group["violation"].max(), passed["length"].median(), group["checks"].median(),
            group["projections"].median(),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLE))


def _trial(contest: ArmContest, plan: _Plan, problem: ArmProblem, exact: Validity) -> dict[str, Any]:
    seconds, path, counts = plan(problem, contest.seed)
    found = {"time": seconds, "claimed": path is not None, "verified": False, "reason": "", "length": np.nan}
    found |= {"violation": np.nan, "checks": counts.get("collision_checks", np.nan)}
    found |= {"projections": counts.get("projections", np.nan)}
    if path is not None:
        verdict = verify(path, problem.start, problem.goal, problem.constraint, exact, contest.verifier)
        reason = verdict.failure.value if verdict.failure else ""
        found |= {
            "verified": verdict.passed,
            "reason": reason,
            "length": verdict.length,
            "violation": verdict.max_violation,
        }
    return found


def _ours(contest: ArmContest) -> dict[str, _Plan]:
    planner = contest.planner.make(PLANNERS, "planner")
    spaces: dict[tuple[str, int], Adherence] = {}

    def route(name: str, choice: Choice) -> _Plan:
        def plan(problem: ArmProblem, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
            key = (name, id(problem.constraint))
            validity = Validity(problem.robot, problem.obstacles, contest.margin, 0.0)
            if key not in spaces:
                spaces[key] = make_adherence(choice, problem.constraint, validity)
            spaces[key].reset(validity)
            asked = Problem(spaces[key], problem.start, problem.goal)
            result = planner.plan(
                asked, make_sampler(contest.sampler), Termination(time_limit=contest.time_limit), seed
            )
            return result.planning_time, result.path if result.solved else None, result.row()

        return plan

    return {f"ours, {name.replace('_', ' ')}": route(name, choice) for name, choice in contest.adherences.items()}


def _ompl(contest: ArmContest, robot: Robot) -> dict[str, _Plan]:
    def route(ordinary: bool) -> _Plan:
        def plan(problem: ArmProblem, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
            given = problem.constraint
            validity = Validity(problem.robot, problem.obstacles, 0.0)
            space = make_adherence(next(iter(contest.adherences.values())), given, validity)
            stand_in = (
                OrdinaryUpright(robot, STATIONS[robot.name].level, given.tolerance, given.max_iterations),
                OrdinaryValidity(robot, problem.obstacles),
            )
            parameters = OmplParameters(delta=contest.ompl_delta, project_override=not ordinary)
            planner = OmplPlanner("RRTConnect", "projection", parameters, stand_in if ordinary else None)
            result = planner.plan(
                Problem(space, problem.start, problem.goal), Termination(time_limit=contest.time_limit), seed
            )
            return result.planning_time, result.path if result.solved else None, result.row()

        return plan

    return {ORDINARY: route(True), OMPL_OURS: route(False)}


def _roboplan(contest: ArmContest, peer: RoboplanPeer) -> _Plan:
    def plan(problem: ArmProblem, seed: int) -> tuple[float, np.ndarray | None, dict[str, int]]:
        seconds, path = peer.plan(problem, contest.time_limit, seed)
        if path is None:
            return seconds, None, {}
        gaps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        joined = [path[:1]]
        for q, following, gap in zip(path[:-1], path[1:], gaps, strict=True):
            share = np.arange(1, int(np.ceil(gap / _DENSE)) + 1)[:, None] / np.ceil(gap / _DENSE)
            between = q + share * (following - q)
            between[:-1] = problem.constraint.project_batch(between[:-1])[0]
            joined.append(between)
        return seconds, np.concatenate(joined), {}

    return plan


def ratio_lines(trials: pd.DataFrame, ours: str) -> list[str]:
    """Return a sentence per robot and peer: how much faster `ours` is, at the median and at p95, on equal problems."""
    lines = []
    for robot, group in trials.groupby("robot", sort=False):
        mine = group[group["route"] == ours].set_index("problem")["time"]
        for route in [r for r in group["route"].unique() if not r.startswith("ours")]:
            theirs = group[group["route"] == route].set_index("problem")["time"]
            both = mine.loc[theirs.index]
            median, tail = theirs.median() / both.median(), theirs.quantile(0.95) / both.quantile(0.95)
            passed = [100 * group[group["route"] == r]["verified"].mean() for r in (route, ours)]
            lines.append(
                f"{robot}: {median:.3g}x faster than {route} at the median, {tail:.3g}x at p95, n = {len(theirs)}; the "
                f"verifier passes {passed[0]:.3g} % of its trials and {passed[1]:.3g} % of ours"
            )
    return lines
