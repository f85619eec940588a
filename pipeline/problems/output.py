"""What is written of a solution: path, summary, picture, recording."""

import os
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.errors import ConfigError
from pipeline.files import atomic_folder, write_json
from pipeline.problems.solve import Solution
from pipeline.recording import Recording, write_layout, write_recording
from pipeline.reporting.scene_still import draw_path

RESULT, PATH, PICTURE, RECORDING, LAYOUT = "result.json", "path.csv", "picture.png", "recording.mcap", "layout.json"
_KNOWN = {RESULT, PATH, PICTURE, RECORDING, LAYOUT}


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
    close that a controller may go straight between them.

    Raises:
        ConfigError: see `check_output`.
    """
    check_output(folder)
    summary = solution.summary()
    with atomic_folder(folder.resolve()) as out:
        write_json(summary, out / RESULT, "result")
        if solution.solved:
            frame = pd.DataFrame(solution.path, columns=list(solution.built.robot.joint_names))
            frame.insert(0, "time_s", solution.times)
            frame.to_csv(out / PATH, index=False, float_format="%.12g")
            write_recording(out / RECORDING, recording(solution, summary))
            write_layout(out / LAYOUT, solution.built.robot.dimension)
            if picture:
                robot = solution.built.robot
                title = f"{robot.name}: {solution.built.constraint.name}, {summary['length']:.2f} rad or m"
                draw_path(robot, solution.built.obstacles, solution.path, out / PICTURE, title, solution.built.held)
    return summary


def recording(solution: Solution, summary: dict[str, Any]) -> Recording:
    """Return the solution as a recording."""
    numbers = {k: v for k, v in (summary | summary["plan"]).items() if isinstance(v, int | float)}
    return Recording(
        robot=solution.built.robot,
        obstacles=solution.built.obstacles,
        states=solution.path,
        times=solution.times,
        tool=solution.built.robot.tool,
        start=solution.path[0],
        goal=solution.path[-1],
        counters=numbers,
        metadata={"constraint": solution.built.constraint.name, "status": solution.status},
    )
