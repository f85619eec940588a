"""Trials: every method on every problem, verified, one row each."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require, require_name
from pipeline.evaluation.routes import Manifold, Names, Ours, Role, cases
from pipeline.evaluation.runner import Runner
from pipeline.learning.choices import Learned, check_sampler, make_sampler
from pipeline.planners import PLANNERS, Clock, FmtStar, Planner, Termination
from pipeline.samplers import Asked, Then
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.spec.scene import Scene
from pipeline.verification.verdict import VerifierParameters

Part = TypeVar("Part")


@dataclass(frozen=True)
class Method:
    """A planner with a sampler, under the name of the tables.

    Attributes:
        label: the name.
        planner, sampler: the parts.
        compared_with: keys of the methods that it is held against problem by problem, the most telling one first.
        tuned_from: key of the method from whose variants the parameters were chosen, where they are not its own.
    """

    label: str
    planner: Choice
    sampler: Choice
    compared_with: tuple[str, ...] = ()
    tuned_from: str | None = None

    def route(self, adherence: str, manifold: Manifold, learned: Learned | None = None, role: Role = Role.OURS) -> Ours:
        """Return what plans by this method on a manifold, whose adherence method has a key.

        Raises:
            ConfigError: an unknown kind, parameters that do not fit it, or a learned sampler without a network.
        """
        planner: Planner = self.planner.make(PLANNERS, "planner")
        names = Names(self.label, self.planner.kind, self.sampler.kind, adherence, role)
        return Ours(names, manifold, planner, make_sampler(self.sampler, learned))


@dataclass(frozen=True)
class Experiment:
    """What is compared, under which bounds.

    Attributes:
        methods: by key.
        adherences: by key.
        time_limit: of every plan [s].
        seed: of all trials; all methods get the same stream for a problem.
        verifier: bounds of the check.
        only: keys of the methods and of the adherences that are run; where it names none of a kind, all of that kind.
    """

    methods: dict[str, Method]
    adherences: dict[str, Choice]
    time_limit: float
    seed: int
    verifier: VerifierParameters
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key, method in self.methods.items():
            method.planner.make(PLANNERS, f"methods.{key}.planner")
            check_sampler(method.sampler)
            for other in (*method.compared_with, *filter(None, [method.tuned_from])):
                if other not in self.methods:
                    raise ConfigError(f"methods.{key} names the method {other!r}; there are {', '.join(self.methods)}")
        for key in self.only:
            if key not in {**self.methods, **self.adherences}:
                raise ConfigError(f"only names {key!r}; it may name {', '.join((*self.methods, *self.adherences))}")
        if not self.methods or not self.adherences:
            raise ConfigError("an experiment needs at least one method and one adherence")
        require("time_limit", self.time_limit, above=0, unit=" s")
        require("seed", self.seed, at_least=0)

    def check_names(self) -> None:
        """Refuse keys of adherences and labels of methods that no recording can be named after.

        Raises:
            ConfigError: names the first of them.
        """
        for key in self.adherences:
            require_name("a name in experiment.adherences", key)
        for key, method in self.methods.items():
            require_name(f"experiment.methods.{key}.label", method.label, also=" ,*")

    def run(self, parts: Mapping[str, Part]) -> dict[str, Part]:
        """Return those of the methods or of the adherences that are run."""
        return {key: part for key, part in parts.items() if key in self.only} or dict(parts)


def run_trials(
    experiment: Experiment,
    environment: Margins,
    scenes: dict[str, Scene],
    learned: Learned | None,
    problems: pd.DataFrame,
) -> pd.DataFrame:
    """Run all methods with all adherences on problems; return the runner's rows with paths, sorted by problem.

    A method plans all of them, after one plan that is not counted, before the next one comes: what it alone needs is
    in the caches then, as where one plans with one method. There are few problems in a shard, so that drift of the
    machine hits all alike.
    """
    runner = Runner(Termination(time_limit=experiment.time_limit), experiment.verifier, paths=True)
    margins = environment.margin, environment.self_margin
    manifolds = {key: Manifold(choice, *margins) for key, choice in experiment.run(experiment.adherences).items()}
    routes = [
        method.route(key, manifold, learned)
        for method in experiment.run(experiment.methods).values()
        for key, manifold in manifolds.items()
    ]
    first, *others = cases(environment.name, scenes, problems)
    asked = (first, first, *others)  # the first plan touches everything once; it is measured again
    found = [[runner.row(route, case, case.seed(experiment.seed)) for case in asked][1:] for route in routes]
    return pd.DataFrame([row for rows in zip(*found, strict=True) for row in rows])


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


def method_settings(methods: Mapping[str, Method]) -> dict[str, dict[str, Any]]:
    """Return what pages know of methods, by their labels.

    These are the parameters of 'planner' and 'sampler', and labels: those of what a method is 'compared_with', and
    that of the method it is 'tuned_from', or None.
    """
    return {
        method.label: {
            "planner": dict(method.planner.parameters),
            "sampler": dict(method.sampler.parameters),
            "compared_with": [methods[key].label for key in method.compared_with],
            "tuned_from": methods[method.tuned_from].label if method.tuned_from else None,
        }
        for method in methods.values()
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
    adherence = next(iter(experiment.run(experiment.adherences).values()))
    manifold = Manifold(adherence, environment.margin, environment.self_margin)
    clouds: dict[str, np.ndarray] = {}
    for case in cases(environment.name, scenes, problems.drop_duplicates("scenario")):
        asked = manifold.problem(case)
        space, scenario = asked.adherence, case.scenario
        clouds[f"{scenario}/start"], clouds[f"{scenario}/goal"] = asked.start, asked.goal
        for method in experiment.run(experiment.methods).values():
            planner = method.planner.make(PLANNERS, "planner")
            if not isinstance(planner, FmtStar):
                continue
            sampler = make_sampler(method.sampler, learned)
            if isinstance(sampler, Then):
                sampler.calls = sys.maxsize
            space.reset()
            sampler.begin(Asked(space, asked.start, asked.goal, asked.scene), np.random.default_rng(experiment.seed))
            clouds[f"{scenario}/{method.label}"] = replace(planner, samples=count + 2).first_batch(
                asked, sampler, Clock(Termination(time_limit=experiment.time_limit))
            )[2:]
    return clouds
