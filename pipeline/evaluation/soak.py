"""The soak test: thousands of planned paths through the verifier."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, require
from pipeline.evaluation.families import Ours, Setting
from pipeline.planners import Termination, shortcut
from pipeline.tasks import build


@dataclass(frozen=True)
class Load:
    """How often a family is planned.

    Attributes:
        tasks: of the family.
        plans: of each task by each adherence method, with different seeds.
        max_iterations: of a plan, so that the same paths come out on every machine.
    """

    tasks: int
    plans: int
    max_iterations: int

    def __post_init__(self) -> None:
        require("tasks", self.tasks, at_least=1)
        require("plans", self.plans, at_least=1)
        require("max_iterations", self.max_iterations, at_least=1)


@dataclass(frozen=True)
class Soak:
    """See conf/soak.yaml.

    Attributes:
        families: by name.
        loads: of each family.
        seed: of tasks and plans; not one that settings were chosen on or that is measured.
        shortcuts: tried on every path; the shorter path is verified as well.
        adherence: parameters of every method that differ from the family's.
        shard: tasks per shard.
    """

    families: dict[str, Setting]
    loads: dict[str, Load]
    seed: int
    shortcuts: int
    adherence: dict[str, Any]
    shard: int

    def __post_init__(self) -> None:
        if set(self.families) != set(self.loads):
            raise ConfigError(f"loads has {', '.join(self.loads)}; the families are {', '.join(self.families)}")
        require("shortcuts", self.shortcuts, at_least=0)
        require("shard", self.shard, at_least=1)

    def shards(self) -> list[tuple[str, tuple[str, range]]]:
        """Return names and items of all shards: a family and numbers of its tasks."""
        found = []
        for label, load in self.loads.items():
            for first in range(0, load.tasks, self.shard):
                found.append((f"{label}-{first}", (label, range(first, min(first + self.shard, load.tasks)))))
        return found


def soak_shard(soak: Soak, item: tuple[str, range]) -> pd.DataFrame:
    """Plan and verify tasks of a family; return a row per plan."""
    label, numbers = item
    setting, load, rows = soak.families[label], soak.loads[label], []
    family = setting.family()
    routes = {
        name: Ours(setting, replace(choice, parameters={**choice.parameters, **soak.adherence}))
        for name, choice in setting.adherences.items()
    }
    for number in numbers:
        task = build(family.task(soak.seed, number).leg)
        for name, ours in routes.items():
            for repeat in range(load.plans):
                seed = soak.seed + 1000 * number + repeat
                result = ours.plan(task, Termination(max_iterations=load.max_iterations), seed)
                row: dict[str, Any] = {"family": label, "adherence": name, "task": number, "seed": seed}
                row |= {"solved": result.solved, "reason": "", "violation": np.nan, "states": 0, "length": np.nan}
                row |= {"proven": 0, "sampled": 0}
                row |= {"shortened": False, "short_reason": "", "short_length": np.nan}
                if result.solved:
                    verdict = setting.verdict(task, result.path)
                    row |= {"reason": verdict.failure.value if verdict.failure else ""}
                    row |= {"violation": verdict.max_violation, "states": verdict.states_checked}
                    row |= {"length": verdict.length}
                    row |= {"proven": verdict.chords_proven, "sampled": verdict.chords_sampled}
                    if soak.shortcuts:
                        rng = np.random.default_rng([seed, 2])
                        shorter = shortcut(ours.space(task), result.path, rng, soak.shortcuts)
                        after = setting.verdict(task, shorter)
                        row |= {"shortened": True, "short_reason": after.failure.value if after.failure else ""}
                        row |= {"short_length": after.length, "states": row["states"] + after.states_checked}
                        row |= {"proven": row["proven"] + after.chords_proven}
                        row |= {"sampled": row["sampled"] + after.chords_sampled}
                rows.append(row)
    return pd.DataFrame(rows)


def soak_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per family and adherence method, and one for all."""
    parts = [*rows.groupby(["family", "adherence"], sort=False), (("all", ""), rows)]
    found = []
    for (family, adherence), group in parts:
        paths, short = group[group["solved"]], group[group["shortened"]]
        found.append((
            family, adherence, group.groupby("family")["task"].nunique().sum(), len(group), len(paths),
            int((paths["reason"] != "").sum()), len(short), int((short["short_reason"] != "").sum()),
            int(group["proven"].sum()), int(group["sampled"].sum()), int(group["states"].sum()),
            group["violation"].max(),
        ))  # fmt: skip
    columns = (
        "family", "adherence", "tasks", "plans", "paths", "wrong paths", "shortened paths", "wrong shortened paths",
        "chords proven", "chords sampled", "states checked", "largest violation",
    )  # fmt: skip
    return pd.DataFrame(found, columns=columns)


def wrong(rows: pd.DataFrame) -> Sequence[dict[str, Any]]:
    """Return the rows with a path, raw or shortened, that the verifier refused."""
    bad = rows[(rows["reason"] != "") | (rows["short_reason"] != "")]
    return bad.to_dict("records")  # type: ignore[return-value]
