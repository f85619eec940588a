"""Demonstrations: paths of the oracle planner, which compnetx.txt, section VI-B, names as Atlas-RRTConnect."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import PipelineError, require
from pipeline.evaluation.routes import Manifold, Names, Ours, cases
from pipeline.evaluation.runner import Judges
from pipeline.planners import PLANNERS, Termination, path_length, shortcut
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.spec.scene import Scene, flatten

UNVERIFIED = "unverified"  # status of a path that the verifier refused


@dataclass(frozen=True)
class Oracle:
    """How demonstrations are made.

    Attributes:
        adherence, planner: the method.
        max_iterations: of a plan; repeatable work does not end by the clock.
        shortcuts: attempts per path.
        seed: of all plans; each problem has its own stream.
    """

    adherence: Choice
    planner: Choice
    max_iterations: int
    shortcuts: int
    seed: int

    def __post_init__(self) -> None:
        for name, bound in (("max_iterations", 1), ("shortcuts", 0), ("seed", 0)):
            require(f"oracle.{name}", getattr(self, name), at_least=bound)


def shards(problems: pd.DataFrame, size: int) -> Iterator[tuple[str, pd.DataFrame]]:
    """Cut problems into pieces of at most `size` of one scene, with a name each."""
    require("shard", size, at_least=1)
    for scene, rows in problems.groupby("scene", sort=False):
        for first in range(0, len(rows), size):
            yield f"{scene}-{first:05d}", rows.iloc[first : first + size]


def demonstrate(oracle: Oracle, environment: Margins, scenes: dict[str, Scene], problems: pd.DataFrame) -> pd.DataFrame:
    """Plan problems and verify the paths; one row each, failures included with an empty path.

    A path that the verifier refuses is no demonstration: its status is `unverified`, its message the verifier's.

    Columns: scenario, scene, split, problem, status, solved, message, length [m], raw_length [m] (before shortcuts),
    the counters, path, waypoints, dimension, and planning_time [s], which alone does not repeat.
    """
    names = Names("oracle", oracle.planner.kind, "uniform", oracle.adherence.kind)
    manifold = Manifold(oracle.adherence, environment.margin, environment.self_margin)
    route = Ours(names, manifold, oracle.planner.make(PLANNERS, "oracle.planner"), UniformSampler())
    termination, judges = Termination(max_iterations=oracle.max_iterations), Judges()
    rows: list[dict[str, Any]] = []
    for split, case in zip(problems["split"], cases(environment.name, scenes, problems), strict=True):
        head = {"scenario": case.scenario, "scene": case.scene, "split": split, "problem": case.problem}
        space, seed = manifold.at(case.task), case.seed(oracle.seed)
        try:
            result = route.plan(case, termination, seed)
        except PipelineError as error:  # a problem that cannot be planned is counted, not the end of the stage
            none = dict.fromkeys(("length", "raw_length", "planning_time"), np.nan)
            empty = flatten(np.empty((0, space.dimension)))
            rows.append({**head, "status": "refused", "solved": False, "message": str(error), **none, **empty})
            continue
        path = shortcut(space, result.path, np.random.default_rng(seed), oracle.shortcuts)
        verdict = judges.verdict(case.task, path) if result.solved else None
        solved, message = result.solved, ""
        record = {k: v for k, v in result.row().items() if k not in ("claimed", "network_time")}
        if verdict is not None and not verdict.passed:
            solved, message, path = False, verdict.message, np.empty((0, space.dimension))
            record["status"] = UNVERIFIED
        paths = {"length": path, "raw_length": result.path}
        lengths = {name: path_length(states) if solved else np.nan for name, states in paths.items()}
        rows.append({**head, "solved": solved, "message": message, **lengths, **record, **flatten(path)})
    return pd.DataFrame(rows)
