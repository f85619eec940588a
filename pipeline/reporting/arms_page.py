"""The page of `stages/bench_arms.py`."""

from dataclasses import asdict
from typing import Any

import pandas as pd

from pipeline.environments.torus import Mazes
from pipeline.evaluation.arm_contest import ORDINARY, ROBOPLAN, ArmContest, arm_table, of_role, ratio_lines
from pipeline.evaluation.roboplan_peer import DIFFERENCES
from pipeline.evaluation.routes import Role
from pipeline.evaluation.upkeep import Maintained
from pipeline.reporting.markdown import escape
from pipeline.reporting.performance_page import describe, table
from pipeline.reporting.text import NONE, number

NOTE = (
    "n tasks with one seed each; every route plans a task before the next one comes, on one thread. Times are of all "
    "trials, failures included, ours with the proof of every chord of the found path, and where it is without proof "
    "with looks at points of them; making the scene and its collision checker is left out for all. "
    "Claimed: by the planner; verified: by `pipeline.verification`, which proves every chord of a path (those of "
    "others are joined on the manifold first, outside of the time), "
    "once with the geometry that the route planned with and once with ours; lengths, and how many chords are proven "
    "or only sampled, are of paths that pass with their own. Those differ for roboplan only, which has meshes as they "
    "are in the files; OMPL has our geometry, without margins. No route shortens its path. OMPL's ordinary route has "
    "constraint and checker by numpy and pinocchio, as "
    "its users write them; roboplan plans upright transport and trays: it has no chains, no feet on the ground, no "
    "pictures. Ratios are of the tasks that both planned, and an unsolved plan counts with the time it took."
)
PEERS = (
    "Versions are those that were installed when this was measured: {versions}. Newer ones are not considered. All "
    "routes have the same joint limits, pairs of bodies that may not touch, obstacles, starts, goals, tolerance and "
    "time limit. What roboplan has otherwise:"
)
WITHOUT = " roboplan was left out of this run."
GLANCE = (
    "Median planning time of all trials, failures included, and how many trials end with a path that the verifier "
    "passes by the geometry it was planned with. Ours with the proof of every chord; the best peer is the fastest of "
    "all routes but ours, OMPL with our constraint and checker among them; OMPL is as its users write it, with "
    "constraint and checker in Python, on fewer tasks where that is said. The same start, goal, "
    "tolerance and time limit for all."
)
TASKS = {
    "transport_panda": "Panda, a level hand among 15 to 40 bodies",
    "transport_baxter": "Baxter, a level hand among 15 to 40 bodies",
    "door_panda": "Panda opens a door",
    "tray_baxter": "Baxter, a tray in both hands",
    "reach_pholus": "Pholus, balanced reach, 41 joints",
    "corridor_panda": "Panda, a pen in corridors of 10 cm",
    "door_ur5": "UR5 opens a door",
    "maze": "Maze of 375 cells on a torus",
}
KINDS = {
    "transport": "Upright transport: boxes and cylinders, 15 to 40, on a table, for every other task in a shelf too; "
    "the hand stays level, start and goal are random configurations among them.",
    "door": "Door opening: a hinged door is pulled open by its handle among objects on the ground; a chain of two task "
    "space regions, 9 variables and 6 rows. Start and goal are joined by a way without the objects; with them there "
    "need not be one.",
    "tray": "Tray: a level tray in both hands of Baxter between pillars over a table; 14 variables, 8 rows.",
    "reach": "Balanced reach: Pholus on four feet reaches between two boards, its mass over its feet; 41 variables, 12 "
    "rows.",
    "corridor": "Corridors: a pen 1 cm thick, held upright at a fixed height, goes between thin walls, 10 cm apart, "
    "to the farthest cell; 7 variables, 3 rows.",
    "maze": "Mazes of {rows} x {columns} cells on a torus, corridors {corridor} pixels wide and walls {wall}, from a "
    "random place to the farthest one.",
}
TRIED = (
    "On tasks of seed {seed}, of which none is measured above; each row changes one thing of the first, which is "
    "ours by projection."
)
UPKEEP = (
    "Checks are of configurations near start and goal of the first task of each family, {calls} in all; projections "
    "start at random configurations, whether they converge or not. n counts calls."
)


def arms_page(
    trials: pd.DataFrame,
    tried: pd.DataFrame,
    upkept: Maintained,
    contest: ArmContest,
    command: str,
    machine: dict[str, Any],
) -> str:
    """Return the page in Markdown.

    Args:
        trials: by `arm_shard`, of what is measured.
        tried: by `arm_shard`, of what was tried.
        upkept: by `maintain`.
        contest: that made them.
        command: that made the page.
        machine: by `hardware`, when the measurement began.
    """
    rows_of_machine = [(key, describe(value)) for key, value in machine.items()]
    reasons = _refused(trials)
    compared, rows = arm_table(trials), arm_table(tried)
    blocks = [
        f"Generated by `{command}`, do not edit.",
        "# Arms",
        f"Families of tasks, ours beside peers. Seed {contest.seed}, tolerance 0.001 (rad or m).",
        "## At a glance", GLANCE, table(glance(trials)),
        "## How much faster", "\n".join(f"- {escape(line)}" for line in ratio_lines(trials)),
        "## Families", NOTE + ("" if (trials["planner"] == ROBOPLAN).any() else WITHOUT),
    ]  # fmt: skip
    for name, setting in contest.families.items():
        here = compared[compared["family"] == name]
        if len(here):
            scenes = KINDS[setting.kind].format(**{**asdict(Mazes()), **setting.parameters})
            said = f"{scenes} Time limit {setting.time_limit:g} s."
            blocks += [f"### {name}", said, table(here.drop(columns="family"))]
    blocks += ["### Claimed and refused", table(reasons) if len(reasons) else "None."]
    blocks += ["## Peers", PEERS.format(versions=_versions(machine)), "\n".join(f"- {line}" for line in DIFFERENCES)]
    blocks += ["## What was tried", TRIED.format(seed=contest.tried_seed)]
    for tried_name, part in rows.groupby("family", sort=False):
        blocks += [f"**{escape(str(tried_name))}**", table(part.drop(columns="family"))]
    blocks += [
        "## Checks and projections", UPKEEP.format(calls=upkept.calls), table(upkept.costs),
        "## Memory", escape(upkept.memory),
        "## Time limits", "Plans with limits so short that many end by them.", table(upkept.overruns),
        "## Machine and versions", table(pd.DataFrame(rows_of_machine, columns=["", "value"])),
    ]  # fmt: skip
    return "\n\n".join(blocks) + "\n"


def glance(trials: pd.DataFrame) -> pd.DataFrame:
    """Return a row per family: the task, and how fast and how often ours, the best peer and OMPL solve it."""
    rows = []
    for family, group in trials.groupby("environment", sort=False):
        medians = group.groupby("method", sort=False)["planning_time"].median()
        peers = medians[of_role(group, Role.PEER)]
        best = "" if peers.empty else str(peers.idxmin())
        rows.append((
            TASKS.get(str(family), str(family)), _cell(group, of_role(group, Role.OURS)[0]),
            _cell(group, best) + (f", {best}" if best else ""), _cell(group, ORDINARY), group["problem"].nunique(),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=["task", "ours", "best peer", "OMPL", "n"])


def _cell(group: pd.DataFrame, route: str) -> str:
    """Write the median time and the share of verified paths of a route; a dash where it planned nothing."""
    rows = group[group["method"] == route]
    if rows.empty:
        return NONE
    fewer = "" if len(rows) == group["problem"].nunique() else f" of {len(rows)}"
    return f"{number(1e3 * rows['planning_time'].median())} ms ({100 * rows['solved_own'].mean():.0f} %{fewer})"


def _refused(trials: pd.DataFrame) -> pd.DataFrame:
    """Return how many paths that planners claimed were refused, by route, geometry and reason."""
    refused = []
    for geometry, suffix in (("its own", "_own"), ("ours", "")):
        rows = trials[trials["claimed"] & ~trials[f"solved{suffix}"]]
        names = {"environment": "family", "method": "route", f"failure{suffix}": "reason"}
        refused.append(rows[list(names)].rename(columns=names).assign(geometry=geometry))
    columns = ["family", "route", "geometry", "reason"]
    return pd.concat(refused).groupby(columns, sort=False).size().reset_index(name="paths")


def _versions(machine: dict[str, Any]) -> str:
    """Return the versions of the peers that were measured."""
    packages = machine["packages"]
    return ", ".join(
        f"{name} {packages.get(key, 'none')}" for name, key in (("OMPL", "ompl"), ("roboplan", "roboplan"))
    )
