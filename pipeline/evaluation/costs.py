"""What the parts of planning cost, and how demonstrations scale over processes."""

import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.environments import Environment, Scene, validity
from pipeline.environments.oracle import Oracle, demonstrate, shards
from pipeline.errors import ConfigError
from pipeline.evaluation.statistics import summary
from pipeline.evaluation.verifier import VerifierParameters, verify
from pipeline.learning import CompnetxNetwork
from pipeline.manifolds import Adherence, Traversal, make_adherence
from pipeline.parallel import run_shards
from pipeline.planners import Planner, Problem, Termination
from pipeline.robots import Validity
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice

log = logging.getLogger(__name__)
PARTS = ("part", "per", "n", "median [us]", "p95 [us]")
SCALING = ("workers", "demonstrations", "time [s]", "speed-up", "same paths")
_WARM_UP = 10  # calls that are not counted
_BATCH = 32  # rows of a batch, of projections and network samples alike: a block of the uniform sampler
_Part = tuple[str, str, np.ndarray]  # name, what of, cost of each repetition [us]


@dataclass(frozen=True)
class Workplace:
    """Where and how often parts are timed.

    Attributes:
        environment, scenes: with the blocks.
        problems: columns scene, problem, start and goal.
        adherences: by key; the first also finds the paths that are refined and verified.
        planner: whose walks are timed.
        verifier: bounds of the check that is timed.
        plans: per adherence, one problem each; the problems are taken again when they run out.
        calls: of every other part.
        time_limit: of a plan [s].
        seed: of plans and arguments.
    """

    environment: Environment
    scenes: Mapping[str, Scene]
    problems: pd.DataFrame
    adherences: Mapping[str, Choice]
    planner: Planner
    verifier: VerifierParameters
    plans: int
    calls: int
    time_limit: float
    seed: int

    def __post_init__(self) -> None:
        for name in ("plans", "calls"):
            if getattr(self, name) < 1:
                raise ConfigError(f"parts.{name} is {getattr(self, name)}; it must be at least 1")

    def checker(self, scene: str, margin: float | None = None) -> Validity:
        """Return the checker of a scene by name."""
        return validity(self.environment, self.scenes[scene], self.environment.robot(), margin)

    def planned(self, space: Adherence, obstacles: bool = True) -> Iterator[tuple[Problem, np.ndarray]]:
        """Yield every problem with its path, after it was planned; the first one twice, to warm up."""
        for i in (0, *range(self.plans)):
            asked: Any = self.problems.iloc[i % len(self.problems)]
            free = Validity(self.environment.robot(), (), self.environment.margin)
            space.reset(self.checker(asked.scene) if obstacles else free)
            problem = Problem(space, np.array(asked.start), np.array(asked.goal), asked.scene)
            found = self.planner.plan(problem, UniformSampler(), Termination(time_limit=self.time_limit), self.seed + i)
            yield problem, found.path


def parts_table(place: Workplace, network: CompnetxNetwork, voxels: np.ndarray) -> pd.DataFrame:
    """Return the columns PARTS: median and 95th percentile of what each part costs.

    A walk's cost is that of all walks of one plan, failed ones and new charts included, over the states they reached;
    n counts plans there, and paths or calls elsewhere, each call with an argument of its own.

    Args:
        place: where and how often.
        network: as trained or not; its cost does not depend on its weights.
        voxels: grid of a scene (L, W, H), to be encoded.
    """
    rng, rows = np.random.default_rng(place.seed), []
    for costs in (_walks(place), _checks(place, rng), _network(place, network, voxels, rng), _paths(place)):
        for part, per, us in costs:
            found = summary(us)
            rows.append((part, per, found.n, found.median, found.p95))
            log.info("parts: %s", part)
    return pd.DataFrame(rows, columns=list(PARTS))


def scaling_table(
    oracle: Oracle,
    environment: Environment,
    scenes: dict[str, Scene],
    problems: pd.DataFrame,
    shard: int,
    workers: Sequence[int] = (1, 2),
) -> pd.DataFrame:
    """Return the columns SCALING: the same shards of demonstrations with each number of worker processes.

    The start of the processes is part of the time, as it is in the stage. The speed-up is over the first row.
    """
    work, items = partial(demonstrate, oracle, environment, scenes), list(shards(problems, shard))
    rows: list[tuple[int, int, float, float, bool]] = []
    first: list[bytes] = []
    for count in workers:
        with tempfile.TemporaryDirectory() as scratch:
            begin = time.perf_counter()
            frames = run_shards(work, items, Path(scratch), count, f"demonstrations with {count} workers")
            seconds = time.perf_counter() - begin
        paths = [np.asarray(path).tobytes() for frame in frames for path in frame["path"]]
        first = first or paths
        rows.append((count, len(paths), seconds, (rows[0][2] if rows else seconds) / seconds, paths == first))
    return pd.DataFrame(rows, columns=list(SCALING))


def scaling_lines(table: pd.DataFrame, bound: float) -> list[str]:
    """Return one line per number of workers above 1: whether these are as many times faster as was promised."""
    lines = []
    for row in table[table["workers"] > 1].to_dict("records"):
        met = "met" if row["speed-up"] >= bound else "not met"
        lines.append(
            f"Demonstrations with {row['workers']} workers at least {bound:g}x as fast: {met} ({row['speed-up']:.3g}x)"
        )
    return lines


def times_us(call: Callable[[Any], object], arguments: Sequence[Any] | np.ndarray) -> np.ndarray:
    """Return how long `call` takes for each argument [us], after a few calls to warm up."""
    for argument in arguments[:_WARM_UP]:
        call(argument)
    found = np.empty(len(arguments))
    for i, argument in enumerate(arguments):
        begin = time.perf_counter()
        call(argument)
        found[i] = time.perf_counter() - begin
    return 1e6 * found


class _TimedWalks:
    """Stands in for `traverse` of an adherence: adds up time [s] and states of the walks a planner asks for."""

    def __init__(self, space: Adherence) -> None:
        self.traverse, self.seconds, self.states = space.traverse, 0.0, 0

    def __call__(self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None) -> Traversal:
        begin = time.perf_counter()
        walk = self.traverse(q_from, q_to, max_states)
        self.seconds += time.perf_counter() - begin
        self.states += len(walk.states)
        return walk


def _walks(place: Workplace) -> Iterator[_Part]:
    for key, choice in place.adherences.items():
        for obstacles, name in ((True, "among obstacles"), (False, "without obstacles")):
            space = make_adherence(choice, place.environment.constraint(), Validity(place.environment.robot(), ()))
            walks = _TimedWalks(space)
            space.traverse = walks  # type: ignore[method-assign]  # planners know nothing but this method
            costs = []
            for _ in place.planned(space, obstacles):
                costs.append(1e6 * walks.seconds / max(walks.states, 1))
                walks.seconds, walks.states = 0.0, 0
            yield f"traverse, {key.replace('_', ' ')}, {name}", "state", np.array(costs[1:])


def _checks(place: Workplace, rng: np.random.Generator) -> Iterator[_Part]:
    robot, constraint = place.environment.robot(), place.environment.constraint()
    checker = place.checker(place.problems["scene"].iloc[0])
    states, _ = constraint.project_batch(rng.uniform(robot.lower, robot.upper, (4 * place.calls, constraint.n)))
    free = np.array([checker.collision_free(q) for q in states])
    for name, found in (("free", states[free]), ("colliding", states[~free])):
        yield f"validity, {name}", "check", times_us(checker.collision_free, found[: place.calls])
    random = rng.uniform(robot.lower, robot.upper, (place.calls, _BATCH, constraint.n))
    yield "projection of a random configuration", "call", times_us(constraint.project, random[:, 0])
    batches = times_us(constraint.project_batch, random) / _BATCH
    yield f"projection of {_BATCH} random configurations", "row", batches


def _network(
    place: Workplace, network: CompnetxNetwork, voxels: np.ndarray, rng: np.random.Generator
) -> Iterator[_Part]:
    robot = place.environment.robot()
    yield (
        "scene encoding",
        "scene",
        times_us(lambda key: network.encode(key, voxels), range(-_WARM_UP, place.calls))[_WARM_UP:],
    )
    for K in (1, _BATCH):
        pairs = rng.uniform(robot.lower, robot.upper, (place.calls, 2, K, robot.dimension))
        us = times_us(lambda pair: network.sample(0, pair[0], pair[1], rng), pairs)
        yield f"network sample, K = {K}", "call", us
        yield f"network sample, K = {K}", "sample", us / K


def _paths(place: Workplace) -> Iterator[_Part]:
    choice = next(iter(place.adherences.values()))
    space = make_adherence(choice, place.environment.constraint(), Validity(place.environment.robot(), ()))
    refine, check, states = [], [], []
    for problem, path in place.planned(space):
        if not len(path):
            continue
        exact = place.checker(problem.scene, 0.0)
        ...
