"""What the parts of planning cost, and how demonstrations scale over processes."""

import itertools
import logging
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from pipeline.errors import ConfigError, require
from pipeline.evaluation.oracle import Oracle, demonstrate, shards
from pipeline.evaluation.peers import Contest
from pipeline.evaluation.routes import Case
from pipeline.evaluation.statistics import summary
from pipeline.learning.choices import check_sampler
from pipeline.learning.compnetx import CompnetxNetwork, Model
from pipeline.learning.dropout import draw_masks
from pipeline.learning.products import Products
from pipeline.manifolds import Adherence, Traversal, make_adherence
from pipeline.manifolds.screening import POINTS
from pipeline.parallel import run_shards
from pipeline.planners import PLANNERS, Planner, Query, Termination
from pipeline.robots import Validity
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.spec.environment import Margins
from pipeline.spec.scene import Scene
from pipeline.tasks import Task
from pipeline.verification.judge import Judge

log = logging.getLogger(__name__)
PARTS = ("part", "per", "n", "median [us]", "p95 [us]")
SCALING = (
    "workers", "demonstrations", "start [s]", "work [s]", "plans [s]", "speed-up", "speed-up without start",
    "of the machine", "in rounds: least", "in rounds: most", "same paths",
)  # fmt: skip
_WARM_UP = 10  # calls that are not counted
_BATCH = 32  # rows of a batch of projections: a block of the uniform sampler
_EDGE = 0.3  # length of a typical edge of FMT* [m]
_Part = tuple[str, str, np.ndarray]  # name, what of, cost of each repetition [us]


@dataclass(frozen=True)
class Parts:
    """How often parts are timed.

    Attributes:
        planner: whose walks are timed.
        samplers: learned ones by key; the network is asked for as many samples at once as they ask it for.
        plans: per adherence, one problem each; the problems are taken again when they run out.
        calls: of every other part.
    """

    planner: Choice
    samplers: dict[str, Choice]
    plans: int
    calls: int

    def __post_init__(self) -> None:
        for key, choice in self.samplers.items():
            check_sampler(choice)
            if "batch" not in choice.parameters:
                raise ConfigError(f"parts.samplers.{key} names no batch: how many samples are asked for at once?")
        for name in ("plans", "calls"):
            require(f"parts.{name}", getattr(self, name), at_least=1)

    @property
    def batches(self) -> list[int]:
        """Numbers of samples that the network is asked for at once, ascending."""
        return sorted({int(choice.parameters["batch"]) for choice in self.samplers.values()})


@dataclass(frozen=True)
class Workplace:
    """Where parts are timed.

    Attributes:
        cases: among blocks.
        margin: that planning keeps [m].
        contest: has the adherence methods, of which the first also finds the paths that are refined and verified, the
            bounds of the check that is timed, and time limit and seed of plans.
        parts: how often.
    """

    cases: Sequence[Case]
    margin: float
    contest: Contest
    parts: Parts

    @property
    def task(self) -> Task:
        """The first one; all have the same robot and constraint."""
        return self.cases[0].task

    def planned(self, space: Adherence, obstacles: bool = True) -> Iterator[tuple[Task, np.ndarray]]:
        """Yield every task with its path, after it was planned; the first one twice, to warm up."""
        planner: Planner = self.parts.planner.make(PLANNERS, "parts.planner")
        for i in (0, *range(self.parts.plans)):
            case = self.cases[i % len(self.cases)]
            free = Validity(self.task.robot, (), self.margin)
            space.reset(case.task.validity(self.margin) if obstacles else free)
            problem = Query(space, case.task.start, case.task.goal, case.scene)
            termination = Termination(time_limit=self.contest.time_limit)
            found = planner.plan(problem, UniformSampler(), termination, self.contest.seed + i)
            yield case.task, found.path


def parts_table(place: Workplace, model: Model, voxels: np.ndarray) -> pd.DataFrame:
    """Return the columns PARTS: median and 95th percentile of what each part costs.

    A walk's cost is that of all walks of one plan, failed ones and new charts included, over the states they reached;
    n counts plans there, and paths or calls elsewhere, each call with an argument of its own.

    Args:
        place: where and how often.
        model: as trained or not; its cost does not depend on its weights.
        voxels: grid of a scene (L, W, H), to be encoded.
    """
    rng, rows = np.random.default_rng(place.contest.seed), []
    for costs in (_walks(place), _checks(place, rng), _network(place, model, voxels, rng), _paths(place)):
        for part, per, us in costs:
            found = summary(us)
            rows.append((part, per, found.n, found.median, found.p95))
            log.info("parts: %s", part)
    return pd.DataFrame(rows, columns=list(PARTS))


def scaling_table(
    oracle: Oracle,
    environment: Margins,
    scenes: dict[str, Scene],
    problems: pd.DataFrame,
    shard: int,
    rounds: int,
    workers: Sequence[int] = (1, 2),
) -> pd.DataFrame:
    """Return the columns SCALING: the same shards of demonstrations with each number of worker processes.

    The shards are cut into rounds, and all numbers of workers do a round, in turn, before the next one comes: a machine
    that grows faster or slower meanwhile does so for all. The start of the processes counts in one speed-up and not in
    the other: the longer the work, the nearer they are. All are over the first number of workers, those in rounds of
    single rounds, without start. Plans: what they took by clocks of their own, in all; the speed-up of the
    machine follows from how much longer they take beside others. The same paths: as with the first number, bit by bit.
    """
    work, items = partial(demonstrate, oracle, environment, scenes), list(shards(problems, shard))
    starts, works = np.zeros(len(workers)), np.zeros((min(rounds, len(items)), len(workers)))
    plans, paths = np.zeros(len(workers)), [list[bytes]() for _ in workers]
    with tempfile.TemporaryDirectory() as scratch:
        for column, count in enumerate(workers):
            # To read these items a process imports what it needs to plan, and gives back the last part.
            idle = [(f"start-{i}", (oracle, environment, problems.head(1))) for i in range(count)]
            begin = time.perf_counter()
            run_shards(itemgetter(2), idle, Path(scratch, str(count)), count, f"start of {count} processes")
            starts[column] = time.perf_counter() - begin
        for row in range(len(works)):
            order = range(len(workers)) if row % 2 == 0 else reversed(range(len(workers)))
            for column in order:
                count = workers[column]
                label = f"demonstrations with {count} processes, round {row + 1} of {len(works)}"
                begin = time.perf_counter()
                frames = run_shards(work, items[row :: len(works)], Path(scratch, str(count)), count, label)
                works[row, column] = time.perf_counter() - begin
                plans[column] += sum(frame["planning_time"].sum() for frame in frames)
                paths[column] += [np.asarray(path).tobytes() for frame in frames for path in frame["path"]]
    total = works.sum(axis=0)
    rows = [
        (
            count,
            len(paths[i]),
            starts[i],
            total[i],
            plans[i],
            (starts[0] + total[0]) / (starts[i] + total[i]),
            total[0] / total[i],
            count / workers[0] * plans[0] / plans[i],
            *np.quantile(works[:, 0] / works[:, i], [0.0, 1.0]),
            paths[i] == paths[0],
        )
        for i, count in enumerate(workers)
    ]
    return pd.DataFrame(rows, columns=list(SCALING))


def scaling_lines(table: pd.DataFrame, bound: float) -> list[str]:
    """Return one line per number of workers above 1: whether these are as many times faster as was promised."""
    lines = []
    for row in table[table["workers"] > 1].to_dict("records"):
        ratio, bare, most = (row[name] for name in ("speed-up", "speed-up without start", "of the machine"))
        lines.append(
            f"Demonstrations with {row['workers']} workers at least {bound:g}x as fast: "
            f"{'met' if ratio >= bound else 'not met'} ({ratio:.3g}x; {bare:.3g}x without the start of the processes, "
            f"{most:.3g}x if workers did nothing but plan)"
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

    def __call__(
        self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None, land: bool = True
    ) -> Traversal:
        begin = time.perf_counter()
        walk = self.traverse(q_from, q_to, max_states, land)
        self.seconds += time.perf_counter() - begin
        self.states += len(walk.states)
        return walk


def _walks(place: Workplace) -> Iterator[_Part]:
    for key, choice in place.contest.adherences.items():
        for obstacles, name in ((True, "among obstacles"), (False, "without obstacles")):
            space = make_adherence(choice, place.task.constraint, Validity(place.task.robot, ()))
            walks = _TimedWalks(space)
            space.traverse = walks  # type: ignore[method-assign]  # planners know nothing but this method
            costs = []
            for _ in place.planned(space, obstacles):
                costs.append(1e6 * walks.seconds / max(walks.states, 1))
                walks.seconds, walks.states = 0.0, 0
            yield f"traverse, {key.replace('_', ' ')}, {name}", "state", np.array(costs[1:])


def _checks(place: Workplace, rng: np.random.Generator) -> Iterator[_Part]:
    robot, constraint, checker = place.task.robot, place.task.constraint, place.task.validity(place.margin)
    states, _ = constraint.project_batch(rng.uniform(*robot.box, (4 * place.parts.calls, constraint.n)))
    free = np.array([checker.free(q) for q in states])
    for name, found in (("free", states[free]), ("colliding", states[~free])):
        yield f"validity, {name}", "check", times_us(checker.free, found[: place.parts.calls])
    begin = states[free][: place.parts.calls]
    way = rng.normal(size=begin.shape)
    way *= _EDGE / np.linalg.norm(way, axis=1, keepdims=True)
    lines = begin[:, None] + np.arange(1, POINTS + 1)[:, None] / (POINTS + 1) * way[:, None]
    edges = constraint.project_batch(lines.reshape(-1, constraint.n))[0].reshape(lines.shape)
    yield f"validity, {POINTS} along {_EDGE} m at once", "check", times_us(checker.all_free, edges[:, None]) / POINTS
    rows = [states[i : i + _BATCH] for i in range(0, len(states) - _BATCH + 1, _BATCH)]
    yield f"validity, {_BATCH} in one call", "check", times_us(checker.free_rows, rows) / _BATCH
    random = rng.uniform(*robot.box, (place.parts.calls, _BATCH, constraint.n))
    yield "projection of a random configuration", "call", times_us(constraint.project, random[:, 0])
    batches = times_us(constraint.project_batch, random) / _BATCH
    yield f"projection of {_BATCH} random configurations", "row", batches


def _network(place: Workplace, model: Model, voxels: np.ndarray, rng: np.random.Generator) -> Iterator[_Part]:
    robot, keys = place.task.robot, itertools.count()
    network, plain = CompnetxNetwork(model), CompnetxNetwork(model, Products.SINGLE)
    plain.encode(0, voxels)
    # A new key every time: a scene that is known already costs nothing.
    yield "scene encoding", "scene", times_us(lambda _: network.encode(next(keys), voxels), range(place.parts.calls))
    for K in place.parts.batches:
        pairs = rng.uniform(*robot.box, (place.parts.calls, 2, K, robot.dimension))
        us = times_us(lambda pair: network.sample(0, pair[0], pair[1], rng), pairs)
        yield f"network sample, K = {K}", "call", us
        yield f"network sample, K = {K}", "sample", us / K
        if K > 1:
            us = times_us(lambda pair: plain.sample(0, pair[0], pair[1], rng), pairs)
            yield f"network sample, K = {K}, in single precision", "call", us
        for name, forward in _alternatives(model, voxels, pairs[0], rng):
            yield f"network sample, K = {K}, {name}", "call", times_us(forward, pairs)


def _alternatives(
    model: Model, voxels: np.ndarray, pair: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[str, Callable[[np.ndarray], np.ndarray]]]:
    """Yield the ordinary ways to ask a trained network: torch, and exported as TorchScript; with cached encoding.

    `pair` is an example of what is asked (2, K, n). Normalisation, which they would need as well, is left out.
    """
    parameters, K = model.parameters, pair.shape[1]
    with torch.inference_mode():
        codes = model.network.encode(torch.as_tensor(voxels).float()[None]).expand(K, -1)

    def arguments(pair: np.ndarray) -> tuple[torch.Tensor, ...]:
        masks = draw_masks(rng, K, parameters.dropout_units, parameters.dropout)
        ends = torch.from_numpy(pair.astype(np.float32))
        return codes, ends[0], ends[1], torch.from_numpy(masks)

    def asked(network: Any) -> Callable[[np.ndarray], np.ndarray]:
        def forward(pair: np.ndarray) -> np.ndarray:
            with torch.inference_mode():
                return np.asarray(network(*arguments(pair)).numpy())

        return forward

    yield "torch", asked(model.network)
    with warnings.catch_warnings(), torch.inference_mode():
        warnings.simplefilter("ignore", DeprecationWarning)  # TorchScript is deprecated, not gone
        exported = torch.jit.freeze(torch.jit.trace(model.network, arguments(pair), check_trace=False))  # type: ignore[no-untyped-call]
    yield "exported as TorchScript", asked(exported)


def _paths(place: Workplace) -> Iterator[_Part]:
    choice = next(iter(place.contest.adherences.values()))
    space = make_adherence(choice, place.task.constraint, Validity(place.task.robot, ()))
    refine, check, states = [], [], []
    for task, path in itertools.islice(place.planned(space), 1, None):
        if not len(path):
            continue
        judge = Judge(task.statement, place.contest.verifier)
        verified = partial(judge.verify, start=task.start, goal=task.goal)
        refine.append(times_us(space.refine, [path])[0])
        check.append(times_us(verified, [path])[0])
        states.append(len(path))
    per = f"path (median of {summary(states).median:.0f} states)"
    yield "refine", per, np.array(refine)
    yield "verifier", per, np.array(check)
