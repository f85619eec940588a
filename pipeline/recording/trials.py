"""Recordings of a benchmark: a few solved problems per method."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.provenance import commit, planning_versions
from pipeline.recording.content import Recording, time_parameterise
from pipeline.recording.layout import write_layout
from pipeline.recording.writer import write_recording
from pipeline.spec.scene import Scene, unflatten
from pipeline.spec.statement import OnSphere
from pipeline.tasks import set_up

_SPEED = 0.5  # of the configuration along the path [rad/s or m/s]: a crossing of the sphere takes some seconds
# No measured times, which the trials' table has: the same trial gives the same bytes.
_COUNTERS = (
    "path_length",
    "iterations",
    "traversals",
    "projections",
    "collision_checks",
    "samples",
    "fallback_samples",
    "nearest_queries",
    "network_calls",
    "charts",
    "repairs",
    "max_violation",
)


def record_trials(
    trials: pd.DataFrame,
    problems: pd.DataFrame,
    scenes: Mapping[str, Scene],
    settings: Any,
    count: int,
    folder: Path,
) -> list[Path]:
    """Write the first `count` solved trials of every scenario, method and adherence, and a layout to open them with."""
    code, versions = commit(), planning_versions()
    starts: Any = problems.set_index(["scene", "problem", "leg"])
    written = []
    for keys, rows in trials[trials.solved].groupby(["scenario", "method", "adherence"], sort=False):
        tuples: Any = rows.head(count).itertuples()  # pandas types its fields as any scalar
        for row in tuples:
            problem = starts.loc[(row.scene, row.problem, row.leg)]
            path = unflatten(pd.Series({"path": row.path, "waypoints": row.waypoints, "dimension": row.dimension}))
            setup = set_up(scenes[row.scene].legs[row.leg])
            spheres = [e.radius for e in setup.equations if isinstance(e, OnSphere)]
            recording = Recording(
                robot=setup.robot,
                obstacles=setup.obstacles,
                states=path,
                times=time_parameterise(path, _SPEED),
                tool=setup.robot.tool,
                start=np.array(problem.start),
                goal=np.array(problem.goal),
                counters={name: getattr(row, name) for name in _COUNTERS},
                metadata={
                    **{name: str(getattr(row, name)) for name in ("scene", "problem", "planner", "sampler", "seed")},
                    **dict(zip(("scenario", "method", "adherence"), map(str, keys), strict=True)),
                    "commit": code,
                },
                versions=versions,
                attachments={
                    "config": settings,
                    "problem": {
                        "scene": row.scene,
                        "problem": int(row.problem),
                        "start": list(map(float, problem.start)),
                        "goal": list(map(float, problem.goal)),
                    },
                },
                manifold_sphere_radius=spheres[0] if spheres else None,
            )
            name = "_".join((*map(str, keys), str(row.scene), f"{row.problem:04d}")).replace("*", "star")
            written.append(folder / f"{name}.mcap")
            write_recording(written[-1], recording)
    widest = max((len(row) for row in problems["start"]), default=0)
    write_layout(folder / "layout.json", widest)
    return written
