"""What every planner takes and gives."""

import time
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

import numpy as np

from pipeline.errors import ConfigError, ProblemError, require, told_apart
from pipeline.manifolds import Adherence, Counters, OutOfTime
from pipeline.manifolds.chords import CLEARANCE
from pipeline.samplers.base import Asked, Sampler


class PlanStatus(Enum):
    """How a plan ended."""

    SOLVED = "solved"
    TIME_LIMIT = "time limit"
    ITERATION_LIMIT = "iteration limit"
    FAILED = "failed"  # the planner gave up by itself


@dataclass(frozen=True)
class Termination:
    """When to stop; at least one of the first two must be given. Repeatable work ends by iterations, not by the clock.

    Attributes:
        time_limit: [s].
        max_iterations: of the planner's outer loop.
        cost_below: keep improving until the path is shorter than this [rad or m]; None stops at the first path. Our
            planners do not improve a path: they search anew, which is an iteration, with the charts they have, and keep
            the shortest. The best path found is the result also where another bound ends the search first.
    """

    time_limit: float | None = None
    max_iterations: int | None = None
    cost_below: float | None = None

    def __post_init__(self) -> None:
        if self.time_limit is None and self.max_iterations is None:
            raise ConfigError("termination needs a time_limit [s] or max_iterations; both are empty")
        for name in ("time_limit", "max_iterations", "cost_below"):
            value = getattr(self, name)
            if value is not None:
                require(f"termination.{name}", value, above=0)


@dataclass(frozen=True, eq=False)
class Query:
    """What a planner is asked: a way between starts and goals on the manifold of an adherence method.

    Attributes:
        adherence: manifold, obstacles and parameters.
        starts: configurations (S, n), any of which will do, or one (n,); FMT* and OMPL set out from the first only.
        goals: likewise (G, n) or (n,); planners that grow no tree from the goal go for the first only.
        scene: key of the scene for samplers that condition on it.
    """

    adherence: Adherence
    starts: np.ndarray
    goals: np.ndarray
    scene: str | None = None

    def __post_init__(self) -> None:
        for name in ("starts", "goals"):
            ends = np.array(getattr(self, name), float)
            object.__setattr__(self, name, ends[None] if ends.ndim < 2 else ends)

    @property
    def start(self) -> np.ndarray:
        """The first start (n,)."""
        return np.asarray(self.starts[0])

    @property
    def goal(self) -> np.ndarray:
        """The first goal (n,)."""
        return np.asarray(self.goals[0])

    def check(self) -> None:
        """Refuse a start or goal that no path can have.

        Raises:
            ProblemError: none, wrong size, not finite, outside the bounds, off the manifold or in collision; the
                message names which, the value and the bound.
        """
        space = self.adherence
        for which, ends in (("start", self.starts), ("goal", self.goals)):
            if not len(ends):
                raise ProblemError(f"there is no {which}")
        named = [
            (which, i, q)
            for which, ends in (("start", self.starts), ("goal", self.goals))
            for i, q in enumerate(ends, 1)
        ]
        for which, i, q in named:
            name = which if i == 1 else f"{which} {i}"
            if q.shape != (space.dimension,):
                raise ProblemError(f"{name} has shape {q.shape}, the robot has {space.dimension} joints")
            if not np.isfinite(q).all():
                raise ProblemError(f"{name} is not finite: {q.tolist()}")
            for joint, value, low, high in zip(
                space.validity.robot.joint_names, q, space.lower, space.upper, strict=True
            ):
                if not low <= value <= high:
                    said, least, most = told_apart(value, low, high)
                    raise ProblemError(f"{name}: joint {joint} is {said}, outside its limits [{least}, {most}]")
            distance = space.constraint.distance(q)
            if not distance < space.constraint.tolerance:
                off, most = told_apart(distance, space.constraint.tolerance)
                raise ProblemError(
                    f"{name} is off the manifold {space.constraint.name!r}: ||F|| = {off}, tolerance {most}; "
                    "project it first (in a problem file: `project: true`)"
                )
            if not space.validity.free(q):
                raise ProblemError(f"{name} is {space.validity.reason(q)}")
            if not space.provable(q):
                raise ProblemError(
                    f"{name} is nearer than {1e3 * CLEARANCE:g} mm to contact, or deeper in a contact that is allowed: "
                    "no path from there can be proven"
                )


@dataclass(frozen=True)
class PlanResult:
    """What came of a plan.

    Attributes:
        status: how it ended.
        path: (T, n) from start to goal on the manifold, neighbours at most a leap apart; (0, n) when not solved.
        planning_time: wall clock, network calls and the finer walk included [s].
        network_time: of this, inside the network [s].
        iterations: of the planner's outer loop.
        counters: machine-independent work.
        seed: of the problem's random stream.
    """

    status: PlanStatus
    path: np.ndarray
    planning_time: float
    network_time: float
    iterations: int
    counters: Counters
    seed: int

    @property
    def solved(self) -> bool:
        """True when the planner claims a path; it counts only after the verifier has passed it."""
        return self.status is PlanStatus.SOLVED

    def row(self) -> dict[str, Any]:
        """Return the flat record of a trial (all but the path)."""
        return {
            "status": self.status.value,
            "claimed": self.solved,
            "planning_time": self.planning_time,
            "network_time": self.network_time,
            "iterations": self.iterations,
            "seed": self.seed,
            **asdict(self.counters),
        }


class Clock:
    """Counts iterations and time of one plan against its termination.

    Attributes:
        begin, end: of the plan, by `time.perf_counter` [s]; no end without a time limit.
    """

    def __init__(self, termination: Termination) -> None:
        self.begin = time.perf_counter()
        self.iterations = 0
        self._limit = np.inf if termination.max_iterations is None else termination.max_iterations
        self.end = np.inf if termination.time_limit is None else self.begin + termination.time_limit

    @property
    def elapsed(self) -> float:
        """Seconds since the plan began."""
        return time.perf_counter() - self.begin

    def out_of_time(self) -> bool:
        """True when the time limit has passed; for inner loops."""
        return time.perf_counter() >= self.end

    def tick(self) -> PlanStatus | None:
        """Count one iteration; return the status to stop with, or None to go on."""
        if self.iterations >= self._limit:
            return PlanStatus.ITERATION_LIMIT
        if self.out_of_time():
            return PlanStatus.TIME_LIMIT
        self.iterations += 1
        return None


class Planner(ABC):
    """A search for a path; knows nothing about projection, charts or collision."""

    def plan(self, query: Query, sampler: Sampler, termination: Termination, seed: int) -> PlanResult:
        """Search until solved or terminated. Failure is a result, never an exception.

        Raises:
            ProblemError: the start or goal is invalid (see `Query.check`).
        """
        query.check()
        space = query.adherence
        space.reset()
        self._prepare(space)
        clock = Clock(termination)
        rng, network_time = np.random.default_rng(seed), 0.0
        for q in (query.start, *query.goals, *query.starts[1:]):
            space.anchor(q)
        status = PlanStatus.SOLVED
        path: np.ndarray | None = None
        if np.array_equal(query.start, query.goal):
            path = np.stack([query.start, query.goal])
        while path is None or (termination.cost_below is not None and path_length(path) >= termination.cost_below):
            if path is not None and clock.tick() is not None:
                break
            sampler.begin(Asked(space, query.start, query.goal, query.scene), rng)
            try:
                with space.deadline.until(clock.end):
                    status, found = self._search(query, sampler, termination, clock)
            except OutOfTime:
                status, found = PlanStatus.TIME_LIMIT, None
            network_time += sampler.network_time
            if found is None:
                break
            if path is None or path_length(found) < path_length(path):
                path = found
        elapsed = clock.elapsed
        return PlanResult(
            status=status if path is None else PlanStatus.SOLVED,
            path=path if path is not None else np.empty((0, space.dimension)),
            planning_time=elapsed,
            network_time=network_time,
            iterations=clock.iterations,
            counters=space.counted(),
            seed=seed,
        )

    def _prepare(self, space: Adherence) -> None:
        """Make what is made once for a manifold, before the time runs."""
        del space

    @abstractmethod
    def _search(
        self, query: Query, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        """Run the search; return its status and the path (T, n) when solved."""


def path_length(path: np.ndarray) -> float:
    """Return the length of a path (T, n) in the configuration space [rad or m]; 0 for fewer than two states."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
