"""Demonstrations: paths of the oracle planner, which compnetx.txt, section VI-B, names as Atlas-RRTConnect."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import PipelineError, require
from pipeline.manifolds import make_adherence
from pipeline.planners import PLANNERS, Planner, Problem, Termination, path_length, shortcut
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.spec.scene import Scene, flatten
from pipeline.tasks import set_up
from pipeline.verification.judge import Judge

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
    """Plan the problems of one scene and verify the paths; one row each, failures included with an empty path.

    A path that the verifier refuses is no demonstration: its status is `unverified`, its message the verifier's.

    Columns: scenario, scene, split, problem, status, solved, message, length [m], raw_length [m] (before shortcuts),
    the counters, path, waypoints, dimension, and planning_time [s], which alone does not repeat.
    """
    scene = scenes[problems["scene"].iloc[0]]
    setup = set_up(scene.statement)
    validity = setup.validity(environment.margin, environment.self_margin)
    space = make_adherence(oracle.adherence, setup.constraint, validity)
    planner: Planner = oracle.planner.make(PLANNERS, "oracle.planner")
    judge = Judge(scene.statement)
    rows: list[dict[str, Any]] = []
    tuples: Any = problems.itertuples()  # pandas types its fields as any scalar
    for problem in tuples:
        head = {name: getattr(problem, name) for name in ("scenario", "scene", "split", "problem")}
        stream = np.random.SeedSequence([oracle.seed, int(problem.problem), *scene.name.encode()])
        seed = int(stream.generate_state(1)[0])
        termination = Termination(max_iterations=oracle.max_iterations)
        try:
            result = planner.plan(
                Problem(space, np.array(problem.start), np.array(problem.goal), scene.name),
                UniformSampler(),
                termination,
                seed,
            )
        except PipelineError as error:  # a problem that cannot be planned is counted, not the end of the stage
            none = dict.fromkeys(("length", "raw_length", "planning_time"), np.nan)
            empty = flatten(np.empty((0, space.dimension)))
            rows.append({**head, "status": "refused", "solved": False, "message": str(error), **none, **empty})
            continue
        path = shortcut(space, result.path, np.random.default_rng(seed), oracle.shortcuts)
        verdict = judge.verify(path, np.array(problem.start), np.array(problem.goal)) if result.solved else None
        solved, message = result.solved, ""
        record = {k: v for k, v in result.row().items() if k not in ("claimed", "network_time")}
        if verdict is not None and not verdict.passed:
            solved, message, path = False, verdict.message, np.empty((0, space.dimension))
            record["status"] = UNVERIFIED
        paths = {"length": path, "raw_length": result.path}
        lengths = {name: path_length(states) if solved else np.nan for name, states in paths.items()}
        rows.append({**head, "solved": solved, "message": message, **lengths, **record, **flatten(path)})
    return pd.DataFrame(rows)
