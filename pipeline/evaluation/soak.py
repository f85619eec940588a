"""The soak test: thousands of planned paths through the verifier."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pipeline.errors import ConfigError, require, require_name
from pipeline.evaluation.families import Setting
from pipeline.evaluation.runner import Runner
from pipeline.planners import Termination


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
        for name in self.families:
            require_name("a name in families", name)
        require("shortcuts", self.shortcuts, at_least=0)
        require("shard", self.shard, at_least=1)

    def shards(self) -> list[tuple[str, tuple[str, range]]]:
        """Return names and items of all shards: a family and numbers of its tasks."""
        return [
            (f"{label}-{first}", (label, range(first, min(first + self.shard, load.tasks))))
            for label, load in self.loads.items()
            for first in range(0, load.tasks, self.shard)
        ]


def soak_shard(soak: Soak, item: tuple[str, range]) -> pd.DataFrame:
    """Plan and verify tasks of a family; return the runner's rows but for the times, which do not repeat."""
    label, numbers = item
    load, setting = soak.loads[label], soak.families[label].changed(adherence=soak.adherence)
    runner = Runner(Termination(max_iterations=load.max_iterations), setting.verifier, soak.shortcuts)
    routes = [setting.ours(adherence) for adherence in setting.adherences]
    rows = [
        runner.row(route, case, soak.seed + 1000 * case.problem + repeat)
        for case in setting.cases(label, soak.seed, numbers)
        for route in routes
        for repeat in range(load.plans)
    ]
    return pd.DataFrame(rows).drop(columns=["planning_time", "network_time"])


def soak_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per family and adherence method, and one for all."""
    parts = [*rows.groupby(["environment", "adherence"], sort=False), (("all", ""), rows)]
    found = [
        (
            family, adherence, group.groupby("environment")["problem"].nunique().sum(), len(group),
            int(group["claimed"].sum()), int((group["failure"] != "").sum()), int(group["shortened"].sum()),
            int((group["short_failure"] != "").sum()), int(group["chords_proven"].sum()),
            int(group["chords_sampled"].sum()), int(group["states_checked"].sum()), group["max_violation"].max(),
        )
        for (family, adherence), group in parts
    ]  # fmt: skip
    columns = (
        "family", "adherence", "tasks", "plans", "paths", "wrong paths", "shortened paths", "wrong shortened paths",
        "chords proven", "chords sampled", "states checked", "largest violation",
    )  # fmt: skip
    return pd.DataFrame(found, columns=columns)


def wrong(rows: pd.DataFrame) -> Sequence[dict[str, Any]]:
    """Return the rows with a path, raw or shortened, that the verifier refused."""
    bad = rows[(rows["failure"] != "") | (rows["short_failure"] != "")]
    return bad.to_dict("records")  # type: ignore[return-value]
