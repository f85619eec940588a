"""What is written of a solution: path, summary, picture, recording."""

import os
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.atomic import atomic_folder
from pipeline.errors import ConfigError
from pipeline.files import write_json
from pipeline.planning.resolved import documents
from pipeline.planning.solve import Solution
from pipeline.problems.file import choice
from pipeline.provenance import commit, planning_versions
from pipeline.recording import Recording, write_layout, write_recording
from pipeline.reporting.scene_still import draw_path

RESULT, PATH, PICTURE, RECORDING, LAYOUT = "result.json", "path.csv", "picture.png", "recording.mcap", "layout.json"
_KNOWN = {RESULT, PATH, PICTURE, RECORDING, LAYOUT}
# Of the summary, what does not depend on the clock: measured times stand in the result.
_COUNTERS = (
    "length",
    "length_before_shortcuts",
    "duration_s",
    "states",
    "states_checked",
    "largest_violation",
    "smallest_clearance_m",
    "starts",
    "goals",
)


def check_output(folder: Path) -> None:
    """Refuse a folder that holds anything but an earlier result, which would be replaced, or cannot be written.

    Raises:
        ConfigError: it is a file or below one, holds something else, or the system does not let us write there.
    """
    asked = f"output is {str(folder)!r}"
    try:
        folder = folder.resolve()  # a link's target is replaced, not the link
        if folder.exists() and not folder.is_dir():
            raise ConfigError(f"{asked}, which is a file; it must be a folder")
        if folder == Path.cwd() or os.path.ismount(folder):
            raise ConfigError(
                f"{asked}, the folder this runs in or a mounted one, which cannot be replaced: name another"
            )
        strangers = sorted({entry.name for entry in folder.iterdir()} - _KNOWN) if folder.exists() else []
        if strangers:
            raise ConfigError(f"{asked}, which holds {', '.join(strangers[:5])}: name a folder of its own")
        with tempfile.TemporaryDirectory(dir=next(parent for parent in folder.parents if parent.exists())):
            pass
    except OSError as error:
        raise ConfigError(f"{asked}, which cannot be written: {error.strerror}") from None


def write_solution(solution: Solution, folder: Path, picture: bool = True) -> dict[str, Any]:
    """Write the result, and for a solved problem its path, picture and recording, all or nothing; return the result.

    `path.csv` has a row per state: time [s] and the joints [rad or m] by name. Its states are on the manifold and so
    close that a controller may go straight between them. They are to the bit those that the verifier has passed: one
    on a limit, rounded, would be beyond it.

    Raises:
        ConfigError: see `check_output`.
        RobotError: a file of the robot is no longer there; see `recording`.
    """
    check_output(folder)
    summary = solution.summary()
    with atomic_folder(folder.resolve()) as out:
        write_json(summary, out / RESULT, "result")
        if solution.solved:
            frame = pd.DataFrame(solution.path, columns=list(solution.built.robot.joint_names))
            frame.insert(0, "time_s", solution.times)
            frame.to_csv(out / PATH, index=False)  # as many digits as bring the same numbers back
            write_recording(out / RECORDING, recording(solution, summary))
            write_layout(out / LAYOUT, solution.built.robot.dimension)
            if picture:
                robot = solution.built.robot
                title = f"{robot.name}: {solution.built.constraint.name}, {summary['length']:.2f} rad or m"
                draw_path(robot, solution.built.obstacles, solution.path, out / PICTURE, title, solution.built.held)
    return summary


def recording(solution: Solution, summary: dict[str, Any]) -> Recording:
    """Return the solution as a recording, with what it was planned from: see `documents`.

    Nothing in it was measured by a clock, so that the same problem and seed give the same bytes.

    Raises:
        ConfigError, RobotError: a file of the problem is no longer there.
    """
    file, built = solution.file, solution.built
    counted = {name: summary[name] for name in _COUNTERS if summary[name] is not None}
    chosen = {group: choice(getattr(file, group), group).kind for group in ("planner", "sampler", "adherence")}
    return Recording(
        robot=built.robot,
        obstacles=built.obstacles,
        states=solution.path,
        times=solution.times,
        tool=built.robot.tool,
        start=solution.path[0],
        goal=solution.path[-1],
        counters={**counted, "iterations": solution.plan.iterations, **asdict(solution.plan.counters)},
        metadata={
            "constraint": built.constraint.name,
            "status": solution.status,
            "seed": str(file.seed),
            "commit": commit(),
            **chosen,
        },
        versions=planning_versions(),
        files=documents(file),
    )
