"""The pictures of an environment's page: globes where paths lie on a sphere, else the robot among its obstacles."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError
from pipeline.reporting import text
from pipeline.reporting.frames import PATH_COLUMNS, check, check_trials, ordered, path_array
from pipeline.reporting.markdown import Illustration
from pipeline.reporting.paper import Paper
from pipeline.reporting.scene_still import draw_path
from pipeline.reporting.sphere_pictures import sphere_stills, typical_problems
from pipeline.reporting.stills import Stills
from pipeline.spec.scene import Scene
from pipeline.spec.statement import OnSphere, Point
from pipeline.tasks import set_up


def path_pictures(
    trials: pd.DataFrame,
    paths: pd.DataFrame,
    scenes: Mapping[str, Scene],
    samples: Mapping[str, np.ndarray],
    folder: Path,
    stills: Stills,
    paper: Paper,
) -> dict[str, Illustration]:
    """Draw what fits the environment into `folder`, which lies beside the page; return pictures by scenario.

    Args:
        trials: of the benchmark.
        paths: of the benchmark.
        scenes: of the environment, by name.
        samples: of the benchmark, see `sphere_stills`.
        folder: to draw into.
        stills: draws globes.
        paper: says which methods' paths they show.

    Raises:
        ArtifactError: columns are missing or unknown, a scene is not there, or a solved trial has no path.
    """
    if all(any(isinstance(e, OnSphere) for e in scene.statement.equations) for scene in scenes.values()):
        obstacles = {name: scene.obstacles for name, scene in scenes.items()}
        return sphere_stills(trials, paths, obstacles, samples, folder, stills, paper.drawn)
    return robot_stills(trials, paths, scenes, folder, stills.plain)


def robot_stills(
    trials: pd.DataFrame, paths: pd.DataFrame, scenes: Mapping[str, Scene], folder: Path, plain: bool = False
) -> dict[str, Illustration]:
    """Draw one path of each scenario, found by the first method in the first adherence, into `folder`.

    The path is the one of median length among those it found, so that nobody picks a pretty one. A point robot is
    not drawn: what there is of it to see is in the recordings.

    Raises:
        ArtifactError: columns are missing or unknown, a scene is not there, or a solved trial has no path.
    """
    check_trials(trials)
    check(paths, PATH_COLUMNS, "paths")
    found = {}
    for scenario in ordered(trials["scenario"], "scenario"):
        part = trials[trials["scenario"] == scenario]
        method, adherence = (ordered(part[kind], kind)[0] for kind in ("method", "adherence"))
        chosen, candidates = typical_problems(trials, scenario, adherence, [method], 1)
        if not chosen:
            continue
        (scene, problem), of_it = chosen[0], {"scenario": scenario, "method": method, "adherence": adherence}
        if scene not in scenes:
            raise ArtifactError(f"no scene {scene!r}; there are: {', '.join(sorted(scenes)[:5])}")
        statement = scenes[scene].statement
        if isinstance(statement.robot, Point):
            continue
        rows = paths[(paths[list(of_it)] == pd.Series(of_it)).all(axis=1)]
        rows = rows[(rows["scene"] == scene) & (rows["problem"] == problem)]
        if rows.empty:
            raise ArtifactError(f"paths: none of {text.method_name(method, adherence)} on {scene} problem {problem}")
        file, held = folder / f"paths_{scenario}.png", [carried.body.name for carried in statement.carried]
        robot, path = set_up(statement).robot, path_array(rows.iloc[0])
        how = draw_path(robot, statement.obstacles, path, file, f"{scene}, problem {problem}", held, plain)
        caption = (
            f"{text.method_name(method, adherence)}, {scene}, problem {problem}: the one of median length of the "
            f"{candidates} paths it found in this scenario. Drawn by {how}."
        )
        found[scenario] = Illustration(f"{folder.name}/{file.name}", f"A path, scenario '{scenario}'", caption)
    return found
