"""Trials: every method on every problem, verified, one row each."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require
from pipeline.learning.choices import Learned, check_sampler, make_sampler
from pipeline.manifolds import Adherence, make_adherence
from pipeline.planners import PLANNERS, Clock, FmtStar, Planner, Problem, Termination
from pipeline.samplers import Asked, Sampler, Then
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.spec.scene import Scene, flatten
from pipeline.tasks import set_up
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import VerifierParameters


@dataclass(frozen=True)
class Method:
    """A planner with a sampler, under the name of the tables."""

    label: str
    planner: Choice
    sampler: Choice


@dataclass(frozen=True)
class Experiment:
    """What is compared, under which bounds.

    Attributes:
        methods: by key.
        adherences: by key.
        time_limit: of every plan [s].
        seed: of all trials; all methods get the same stream for a problem.
        verifier: bounds of the check.
    """

    methods: dict[str, Method]
    adherences: dict[str, Choice]
    time_limit: float
    seed: int
    verifier: VerifierParameters

    def __post_init__(self) -> None:
        for key, method in self.methods.items():
            method.planner.make(PLANNERS, f"methods.{key}.planner")
            check_sampler(method.sampler)
        if not self.methods or not self.adherences:
            raise ConfigError("an experiment needs at least one method and one adherence")
        require("time_limit", self.time_limit, above=0, unit=" s")
        require("seed", self.seed, at_least=0)


def run_trials(
    experiment: Experiment,
    environment: Margins,
    scenes: dict[str, Scene],
    learned: Learned | None,
    problems: pd.DataFrame,
) -> pd.DataFrame:
    """Run all methods with all adherences on the problems of one scene.

    A method plans all of them, after one plan that is not counted, before the next one comes: what it alone needs is
    in the caches then, as where one plans with one method. There are few problems in a shard, so that drift of the
    machine hits all alike.

    Columns: environment, scenario, scene, problem, method, planner, sampler, adherence, seed, status, claimed, solved
    (verified), rejection (the verifier's sentence), planning_time [s], network_time [s], path_length [m], iterations,
    the counters, max_violation, min_clearance [m], path, waypoints, dimension. Rows are sorted by problem.
    """
    scene = scenes[problems["scene"].iloc[0]]
    judge = Judge(scene.statement, experiment.verifier)
    spaces = {key: _space(environment, scene, choice) for key, choice in experiment.adherences.items()}
    built: dict[str, tuple[Planner, Sampler]] = {
        key: (method.planner.make(PLANNERS, f"methods.{key}.planner"), make_sampler(method.sampler, learned))
        for key, method in experiment.methods.items()
    }
    found = []
    for key, (planner, sampler) in built.items():
        for adherence, space in spaces.items():
            planned = partial(
                _trials,
                experiment,
                environment,
                scene,
                experiment.methods[key],
                planner,
                sampler,
                adherence,
                space,
                judge,
            )
            for _ in planned(problems.iloc[:1]):
                pass  # the first plan touches everything once; it is measured again below
            found.append(list(planned(problems)))
    return pd.DataFrame([row for rows in zip(*found, strict=True) for row in rows])


def _trials(
    experiment: Experiment,
    environment: Margins,
    scene: Scene,
    method: Method,
    planner: Planner,
    sampler: Sampler,
    adherence: str,
    space: Adherence,
    judge: Judge,
    problems: pd.DataFrame,
) -> Iterator[dict[str, Any]]:
    termination = Termination(time_limit=experiment.time_limit)
    tuples: Any = problems.itertuples()  # pandas types its fields as any scalar
    for problem in tuples:
        start, goal = np.array(problem.start), np.array(problem.goal)
        stream = np.random.SeedSequence([experiment.seed, int(problem.problem), *scene.name.encode()])
        seed = int(stream.generate_state(1)[0])
        result = planner.plan(Problem(space, start, goal, scene.name), sampler, termination, seed)
        row: dict[str, Any] = {
            "environment": environment.name,
            "scenario": scene.scenario,
            "scene": scene.name,
            "problem": int(problem.problem),
            "method": method.label,
            "planner": method.planner.kind,
            "sampler": method.sampler.kind,
            "adherence": adherence,
            **result.row(),
            "solved": False,
            "rejection": "",
            "path_length": np.nan,
            "max_violation": np.nan,
            "min_clearance": np.nan,
        }
        if result.solved:
            verdict = judge.verify(result.path, start, goal)
            row["solved"], row["rejection"] = verdict.passed, verdict.message
            row["max_violation"] = verdict.max_violation
            row["path_length"] = verdict.length if verdict.passed else np.nan
            row["min_clearance"] = np.nan if verdict.min_clearance is None else verdict.min_clearance
        yield {**row, **flatten(result.path)}


def _space(environment: Margins, scene: Scene, choice: Choice) -> Adherence:
    setup = set_up(scene.statement)
    return make_adherence(choice, setup.constraint, setup.validity(environment.margin, environment.self_margin))


def benchmark_metrics(trials: pd.DataFrame) -> dict[str, Any]:
    """Return success, median time [ms] and median length [m] by scenario, method and adherence."""
    found: dict[str, Any] = {}
    for (scenario, method, adherence), rows in trials.groupby(["scenario", "method", "adherence"], sort=False):
        solved = rows[rows.solved]
        found.setdefault(str(scenario), {}).setdefault(str(method), {})[str(adherence)] = {
            "n": len(rows),
            "success": float(rows.solved.mean()),
            "median_time_ms": float(1e3 * rows.planning_time.median()),
            "median_length": float(solved.path_length.median()) if len(solved) else None,
        }
    return found


def method_settings(experiment: Experiment) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the parameters of every method's 'planner' and 'sampler', by its label."""
    return {
        method.label: {"planner": dict(method.planner.parameters), "sampler": dict(method.sampler.parameters)}
        for method in experiment.methods.values()
    }


def sample_clouds(
    experiment: Experiment,
    environment: Margins,
    scenes: dict[str, Scene],
    learned: Learned,
    problems: pd.DataFrame,
    count: int,
) -> dict[str, np.ndarray]:
    """Return `count` samples of every batch sampler for the first problem of each scenario, as FMT* asks for them.

    A learned sampler never falls back to the classical one here: the picture is of what the network proposes.

    Keys are "<scenario>/<label>" (N, n), "<scenario>/start" and "<scenario>/goal" (n,).
    """
    adherence = next(iter(experiment.adherences.values()))
    clouds: dict[str, np.ndarray] = {}
    for scenario, rows in problems.groupby("scenario", sort=False):
        problem = rows.iloc[0]
        scene, start, goal = scenes[problem.scene], np.array(problem.start), np.array(problem.goal)
        space = _space(environment, scene, adherence)
        clouds[f"{scenario}/start"], clouds[f"{scenario}/goal"] = start, goal
        for method in experiment.methods.values():
            planner = method.planner.make(PLANNERS, "planner")
            if not isinstance(planner, FmtStar):
                continue
            sampler = make_sampler(method.sampler, learned)
            if isinstance(sampler, Then):
                sampler.calls = sys.maxsize
            space.reset()
            sampler.begin(Asked(space, start, goal, scene.name), np.random.default_rng(experiment.seed))
            batch = replace(planner, samples=count + 2)
            asked = Problem(space, start, goal, scene.name)
            clouds[f"{scenario}/{method.label}"] = batch.first_batch(
                asked, sampler, Clock(Termination(time_limit=experiment.time_limit))
            )[2:]
    return clouds
