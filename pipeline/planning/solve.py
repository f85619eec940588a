"""Plan one problem, shorten the path, verify it, and give it times."""

import time
from collections import Counter
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from pipeline.manifolds import Adherence, make_adherence, subdivided
from pipeline.planners import PLANNERS, PlanResult, Query, Termination, path_length, shortcut
from pipeline.problems.build import Built, build, sound
from pipeline.problems.file import ProblemFile, choice
from pipeline.recording.content import SHORTEST_STEP
from pipeline.robots.order import revolute
from pipeline.robots.turning import TURN
from pipeline.samplers.uniform import UniformParameters, UniformSampler
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Verdict

_HINTS = 100  # random configurations looked at for pairs in contact
_ROUNDED = 1e-6  # relative error of what files give of a step
_LEAST = 1e-3  # [s] given to a search when the time is over: it ends by itself


@dataclass(frozen=True)
class Solution:
    """What came of a problem.

    Attributes:
        file: the problem.
        built: what was made of it.
        plan: the planner's result.
        verdict: of the verifier, for `path` or, where it is empty, for the last that was found; None without any.
        path: (T, n) on the manifold, `spacing` apart; empty unless verified.
        times: of its states (T,) [s], within the joint velocity limits.
        raw_length: before shortcuts [rad or m].
        setup: making what the file says, inverse kinematics included [s].
        seconds: all after it: searches, shortcuts and checks [s].
    """

    file: ProblemFile
    built: Built
    plan: PlanResult
    verdict: Verdict | None
    path: np.ndarray
    times: np.ndarray
    raw_length: float
    setup: float
    seconds: float

    @property
    def solved(self) -> bool:
        """True when a path was found and verified."""
        return self.verdict is not None and self.verdict.passed

    @property
    def status(self) -> str:
        """`solved`, why the planner stopped, or why the verifier refused the path."""
        if self.verdict is None:
            return self.plan.status.value
        return "solved" if self.verdict.failure is None else f"refused: {self.verdict.message}"

    def summary(self) -> dict[str, Any]:
        """Return the result as plain data."""
        verdict = self.verdict
        said = [verdict.note] if verdict is not None and verdict.note else []
        hints = {} if self.solved else {"often_in_contact": often_in_contact(self.built)}
        clearance = self.built.exact.least_clearance(self.path)
        deepest = self.built.exact.deepest_contact(self.path)
        return {
            "status": self.status,
            "setup_time_s": self.setup,
            "planning_time_s": self.plan.planning_time,
            "total_time_s": self.seconds,
            "length": path_length(self.path),
            "length_before_shortcuts": self.raw_length,
            "duration_s": float(self.times[-1]) if len(self.times) else 0.0,
            "states": len(self.path),
            "largest_violation": verdict.max_violation if verdict is not None else None,
            "smallest_clearance_m": float(clearance) if np.isfinite(clearance) else None,
            "deepest_contact_m": 0.0 if deepest is None else deepest.depth,
            "deepest_contact": None if deepest is None else [deepest.first, deepest.second],
            "surfaces": list(self.built.exact.surfaces),
            "states_checked": verdict.states_checked if verdict is not None else 0,
            "chords_proven": verdict.chords_proven if verdict is not None else 0,
            "chords_sampled": verdict.chords_sampled if verdict is not None else 0,
            "starts": len(self.built.starts),
            "goals": len(self.built.goals),
            "notes": [*self.built.notes, *turned(self.path, self.built), *said],
            "robot": self.built.robot.name,
            "joints": list(self.built.robot.joint_names),
            "constraint": self.built.constraint.name,
            "rows": list(self.built.constraint.labels),
            "plan": self.plan.row(),
            **hints,
        }


def solve(file: ProblemFile) -> Solution:
    """Plan the problem of a file (see `read_problem`).

    A path that the verifier refuses is searched for again, with another seed, while there is time. Shortcuts end with
    the time limit; the verifier, without which there is no path, has all the time it takes.

    Raises:
        ConfigError, RobotError, ConstraintError, ProblemError: whatever makes it no problem. A path that is not found
            is a result, not an error.
    """
    planner = choice(file.planner, "planner").make(PLANNERS, "planner")
    sampling = choice(file.sampler, "sampler").make({"uniform": UniformParameters}, "sampler")
    sampler = UniformSampler(sampling.batch, sampling.block, sampling.around, sampling.directions)
    adherence = choice(file.adherence, "adherence")
    begin = time.perf_counter()
    built = build(file)
    space = make_adherence(adherence, built.constraint, built.validity)
    judge = Judge(built.setup.statement)
    starts, goals = _allowed(space, built.starts), _allowed(space, built.goals)
    Query(space, starts, goals).check()
    problem = Query(space, sound(judge, starts, "start"), sound(judge, goals, "goal"))
    setup, begin = time.perf_counter() - begin, time.perf_counter()
    end = begin + file.time_limit
    verdict: Verdict | None = None
    for attempt in count():
        left = Termination(time_limit=max(end - time.perf_counter(), _LEAST))
        plan = planner.plan(problem, sampler, left, file.seed + attempt)
        if not plan.solved:
            break
        shorter = shortcut(space, plan.path, np.random.default_rng([file.seed, 2]), file.shortcuts, end)
        for candidate in (shorter, plan.path):
            path = subdivided(candidate, file.spacing)
            verdict = check(path, built, judge)
            if verdict.passed:
                break
        if (verdict is not None and verdict.passed) or time.perf_counter() > end:
            break
    if verdict is None or not verdict.passed:
        path = np.empty((0, space.dimension))
    times, seconds = timestamps(path, built, file.speed), time.perf_counter() - begin
    return Solution(file, built, plan, verdict, path, times, path_length(plan.path), setup, seconds)


def _allowed(space: Adherence, ends: np.ndarray) -> np.ndarray:
    """Return those of several starts or goals (S, n) that a path may have; the first, to be refused, where none may."""
    kept = [space.provable(q) for q in ends]
    return ends[kept] if any(kept) else ends[:1]


def often_in_contact(built: Built) -> dict[str, float]:
    """Return which pairs of bodies are in contact at more than a tenth of random configurations, and at how many.

    Where nothing was found these are worth a look: bodies that overlap by the way they are drawn (see `ignored` of a
    robot), or an obstacle that stands in the robot.
    """
    rng, robot, pairs = np.random.default_rng(0), built.robot, Counter[str]()
    for q in rng.uniform(*robot.box, (_HINTS, robot.dimension)):
        pairs.update(f"{one} with {other}" for one, other in built.exact.contacts(q))
    return {pair: times / _HINTS for pair, times in pairs.most_common() if times > _HINTS / 10}


def check(path: np.ndarray, built: Built, judge: Judge) -> Verdict:
    """Return the verifier's verdict on a path (T, n) between the start and goal it is nearest to."""
    turns = built.robot.turns
    start, goal = (
        ends[int(np.argmin(np.linalg.norm(ends - q if turns is None else turns.wrapped(ends - q), axis=1)))]
        for ends, q in ((built.starts, path[0]), (built.goals, path[-1]))
    )
    return judge.verify(path, start, goal)


def turned(path: np.ndarray, built: Built) -> list[str]:
    """Return a note for each joint whose angle at the end of a path (T, n) is whole turns from the file's goal."""
    if not len(path):
        return []
    angles = revolute(built.robot.model) & np.isfinite(built.asked)
    away = np.rint((path[-1] - np.where(angles, built.asked, path[-1])) / TURN).astype(int)
    return [
        f"goal: joint {built.robot.joint_names[i]} ends at {path[-1, i]:.6g}, {abs(away[i])} turn"
        f"{'s' if abs(away[i]) > 1 else ''} from the file's {built.asked[i]:.6g}"
        for i in np.flatnonzero(away).tolist()
    ]


def timestamps(path: np.ndarray, built: Built, speed: float) -> np.ndarray:
    """Return times (T,) [s], whole nanoseconds, at which no joint is faster than `speed` times its limit.

    Joints without a limit count as 1 rad/s or m/s. Rounded up, so that files, which round, keep the limits too.
    """
    if not len(path):
        return np.empty(0)
    limits = built.robot.velocity if built.robot.velocity is not None else np.ones(path.shape[1])
    steps = (np.abs(np.diff(path, axis=0)) / (speed * limits)).max(axis=1, initial=0.0)
    whole = np.ceil(np.maximum(steps * (1 + _ROUNDED), SHORTEST_STEP) * 1e9).astype(np.int64)
    return np.concatenate([[0], np.cumsum(whole)]) / 1e9
