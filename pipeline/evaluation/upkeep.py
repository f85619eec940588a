"""What planning for arms costs beside the planning time: checks, projections, memory, overrun of time limits."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require
from pipeline.evaluation.families import Setting
from pipeline.evaluation.statistics import summary
from pipeline.planners import Termination
from pipeline.robots import Obstacle
from pipeline.tasks import Task, set_up

_BLOCK = 50  # calls timed together: one is as short as reading the clock


@dataclass(frozen=True)
class Upkeep:
    """What is measured.

    Attributes:
        calls: of a collision check, and random configurations to project.
        obstacles: of the first task that checks are made among.
        plans: one after the other, for the memory.
        limits: time limits of plans [s].
        limited: plans per family and limit.
    """

    calls: int
    obstacles: int
    plans: int
    limits: list[float]
    limited: int

    def __post_init__(self) -> None:
        for name in ("calls", "obstacles", "plans", "limited"):
            require(f"upkeep.{name}", getattr(self, name), at_least=1)
        if self.plans < 20:
            raise ConfigError(f"upkeep.plans is {self.plans}; a trend of the memory needs at least 20")
        for limit in self.limits:
            require("upkeep.limits", limit, above=0, unit=" s")


@dataclass(frozen=True)
class Maintained:
    """What `maintain` found: tables of costs and overruns, a line on the memory, and how many calls were asked for."""

    costs: pd.DataFrame
    memory: str
    overruns: pd.DataFrame
    calls: int


def maintain(upkeep: Upkeep, families: dict[str, Setting], seed: int) -> Maintained:
    """Measure everything; the memory with the first family."""
    label = next(iter(families))
    memory = memory_line(upkeep, label, families[label], seed)  # before the others have made anything
    return Maintained(costs_table(upkeep, families, seed), memory, overrun_table(upkeep, families, seed), upkeep.calls)


def costs_table(upkeep: Upkeep, families: dict[str, Setting], seed: int) -> pd.DataFrame:
    """Return what checks and projections cost, a row each [us]; families without a robot are left out."""
    rows = []
    for label, setting in families.items():
        if setting.robot is None:
            continue
        task = next(setting.cases(label, seed, [0])).task
        robot, constraint = task.robot, task.constraint
        few = set_up(replace(task.statement, obstacles=_some(task, upkeep.obstacles)))
        validity = few.validity(setting.margin, setting.self_margin)
        Q = _near(task, np.random.default_rng(seed), upkeep.calls)
        free = np.array([validity.free(q) for q in Q])
        for name, group in (("check, free", Q[free]), ("check, colliding", Q[~free])):
            checked = _timed(lambda block: [validity.free(q) for q in block], group)  # noqa: B023  # called at once
            rows.append((label, f"{name}, {len(few.obstacles)} obstacles", *checked))
        random = np.random.default_rng(seed).uniform(*robot.box, (upkeep.calls, robot.dimension))
        reached = constraint.project_batch(random)[1]
        name = f"projection of a random configuration ({100 * reached.mean():.3g} % converge)"
        rows.append((label, name, *_timed(constraint.project_batch, random)))
    return pd.DataFrame(rows, columns=["family", "part", "n", "median [us]", "p95 [us]"])


def _some(task: Task, count: int) -> tuple[Obstacle, ...]:
    """Return the first obstacles of a task, and those that something may touch."""
    touched = {name for _, name in task.touching}
    return tuple(o for i, o in enumerate(task.obstacles) if i < count or o.name in touched)


def memory_line(upkeep: Upkeep, label: str, setting: Setting, seed: int) -> str:
    """Plan many tasks one after the other and say how resident memory grew."""
    ours, cases = setting.ours(next(iter(setting.adherences))), list(setting.cases(label, seed, range(20)))
    warm = upkeep.plans // 10
    sizes = []
    for number in range(upkeep.plans + warm):
        ours.plan(cases[number % len(cases)], Termination(time_limit=setting.time_limit), number)
        if number >= warm - 1:
            sizes.append(_resident())
    return (
        f"{label}: {sizes[0]:.1f} MB resident after {warm} plans, {sizes[-1]:.1f} MB after {upkeep.plans} more, "
        f"at most {max(sizes):.1f} MB"
    )


def overrun_table(upkeep: Upkeep, families: dict[str, Setting], seed: int) -> pd.DataFrame:
    """Return by how much plans exceed short time limits, a row per family and limit [ms]."""
    rows = []
    for label, setting in families.items():
        ours = setting.ours(next(iter(setting.adherences)))
        asked = list(setting.cases(label, seed, range(upkeep.limited)))
        for limit in upkeep.limits:
            over, solved = [], 0
            for number, case in enumerate(asked):
                result = ours.plan(case, Termination(time_limit=limit), number)
                solved += result.solved
                over.append(1e3 * max(result.planning_time - limit, 0.0))
            rows.append((label, 1e3 * limit, len(asked), solved, float(np.median(over)), max(over)))
    columns = ["family", "limit [ms]", "n", "solved", "overrun median [ms]", "overrun largest [ms]"]
    return pd.DataFrame(rows, columns=columns)


def _near(task: Task, rng: np.random.Generator, count: int) -> np.ndarray:
    """Configurations of the manifold (m, n) a few steps from start and goal, where planning checks."""
    robot = task.robot
    ends = np.stack([task.start, task.goal])[rng.integers(2, size=count)]
    Q = np.clip(ends + 0.3 * rng.normal(size=ends.shape), robot.lower, robot.upper)
    found, converged = task.constraint.project_batch(Q)
    return found[converged & ((found >= robot.lower) & (found <= robot.upper)).all(axis=1)]


def _timed(call: Callable[[np.ndarray], Any], Q: np.ndarray) -> tuple[int, float, float]:
    """Return how many configurations (m, n) there are, and what blocks of them cost each, median and p95 [us]."""
    times = []
    for first in range(0, len(Q), _BLOCK):
        block = Q[first : first + _BLOCK]
        begin = time.perf_counter()
        call(block)
        times.append(1e6 * (time.perf_counter() - begin) / len(block))
    found = summary(np.array(times))
    return len(Q), found.median, found.p95


def _resident() -> float:
    """Resident memory of this process [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return np.nan
