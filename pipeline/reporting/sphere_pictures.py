"""The pictures of the sphere's page: which problems are shown, and what stands below each picture."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.errors import ArtifactError
from pipeline.reporting import figures, text
from pipeline.reporting.frames import PATH_COLUMNS, check, check_trials, ordered, path_array
from pipeline.reporting.globe import Globe
from pipeline.reporting.markdown import Illustration
from pipeline.reporting.paper import Paper
from pipeline.reporting.stills import Stills
from pipeline.robots import Obstacle

SUCCESS, TIME, LENGTH, PROGRESS, TRAINING = "success", "time", "length", "solved_over_time", "training"
SAMPLES = "samples_"  # and the scenario
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sampled:
    """The samples drawn for one problem of a scenario.

    Attributes:
        start, goal: of the problem (3,) [m].
        clouds: method that draws such samples -> samples (N, 3) [m].
    """

    start: np.ndarray
    goal: np.ndarray
    clouds: dict[str, np.ndarray]


def environment_figures(
    trials: pd.DataFrame, curves: pd.DataFrame, folder: Path, paper: Paper
) -> dict[str, Illustration]:
    """Draw the figures of the page into `folder`, which lies beside it, and return them by name.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check_trials(trials)
    n, boxes = f"n = {len(trials)} trials", "Box: quartiles and median; whiskers: 5th and 95th percentile"
    means, rates = ("; diamonds: the paper's means", "; diamonds: the paper's rates") if paper.results else ("", "")
    drawn: dict[str, tuple[Figure, str, str]] = {
        SUCCESS: (
            figures.success_bars(trials, paper),
            "Success",
            f"Share of trials with a verified path, with 95 % intervals over scenes{rates}; {n}.",
        ),
        TIME: (
            figures.time_boxes(trials, paper),
            "Planning time",
            f"Solved trials only, {int(trials['solved'].astype(bool).sum())} of {n}. {boxes}{means}.",
        ),
        LENGTH: (
            figures.length_boxes(trials, paper),
            "Path length",
            f"Solved trials only, {int(trials['solved'].astype(bool).sum())} of {n}. {boxes}{means}.",
        ),
        PROGRESS: (
            figures.solved_over_time(trials),
            "Solved over time",
            f"Share of all trials solved within a planning time; {n}. Dashed: classical; solid: learned.",
        ),
        TRAINING: (
            figures.training_curves(curves),
            "Training",
            f"Loss over n = {len(curves)} epochs; the ring marks the least validation loss.",
        ),
    }
    found = {}
    for name, (figure, title, caption) in drawn.items():
        figures.save(figure, folder / f"{name}.svg")
        found[name] = Illustration(f"{folder.name}/{name}.svg", title, caption)
    return found


def sphere_stills(
    trials: pd.DataFrame,
    paths: pd.DataFrame,
    obstacles: Mapping[str, Sequence[Obstacle]],
    samples: Mapping[str, np.ndarray],
    folder: Path,
    stills: Stills,
    drawn: Sequence[str],
    adherence: str = "atlas",
    columns: int = 3,
) -> dict[str, Illustration]:
    """Draw paths and samples of each scenario into `folder`; return them by scenario and by SAMPLES + scenario.

    A scenario in which no problem was solved by all drawn methods has no picture of paths.

    Args:
        trials: of the benchmark.
        paths: of the benchmark.
        obstacles: of each scene by its name.
        samples: of the benchmark: "<scenario>/<method>" (N, 3), "<scenario>/start" and "<scenario>/goal" (3,) [m].
        folder: beside the page.
        stills: draws.
        drawn: methods whose paths are drawn, of those that there are.
        adherence: whose paths are drawn (the paper draws atlas).
        columns: problems side by side.

    Raises:
        ArtifactError: columns or samples are missing or unknown, a scene has no obstacles, or a solved trial no path.
    """
    check_trials(trials)
    check(paths, PATH_COLUMNS, "paths")
    found = {}
    for scenario in ordered(trials["scenario"], "scenario"):
        present = set(trials.loc[trials["scenario"] == scenario, "method"])
        methods = [method for method in drawn if method in present]
        chosen, candidates = typical_problems(trials, scenario, adherence, methods, columns)
        if not chosen:
            continue
        globes = [_globe(paths, obstacles, scenario, *key, methods, adherence) for key in chosen]
        name = f"paths_{scenario}"
        how = stills.paths(globes, folder / f"{name}.png", f"scenario '{scenario}', {adherence.replace('_', ' ')}")
        caption = (
            f"{' and '.join(filter(None, (', '.join(methods[:-1]), methods[-1])))} with {adherence.replace('_', ' ')}; "
            f"above each sphere the path lengths in this order. n = {len(chosen)} of {candidates} problems that all of "
            f"them solved, evenly spread by the length of the path of {methods[0]}. Drawn by {how}."
        )
        found[scenario] = Illustration(f"{folder.name}/{name}.png", f"Paths, scenario '{scenario}'", caption)
    for scenario, sampled in sampled_by_scenario(samples, ordered(trials["method"], "method")).items():
        picture = _samples(trials, paths, obstacles, scenario, sampled, folder, stills)
        if picture is not None:
            found[SAMPLES + scenario] = picture
    return found


def sampled_by_scenario(samples: Mapping[str, np.ndarray], methods: Sequence[str]) -> dict[str, Sampled]:
    """Sort the benchmark's arrays of samples by scenario, and those of methods by the order of these.

    Raises:
        ArtifactError: a name that is not "<scenario>/<method>", or a scenario without start or goal.
    """
    sorted_: dict[str, dict[str, np.ndarray]] = {}
    for name, array in samples.items():
        scenario, _, kind = name.partition("/")
        if not kind:
            raise ArtifactError(
                f"samples: {name!r} is not '<scenario>/<method>', '<scenario>/start' or '<scenario>/goal'"
            )
        sorted_.setdefault(scenario, {})[kind] = np.asarray(array, float)
    for scenario, arrays in sorted_.items():
        missing = [kind for kind in ("start", "goal") if kind not in arrays]
        if missing:
            raise ArtifactError(f"samples: scenario {scenario!r} has no {' and no '.join(missing)}; got {list(arrays)}")
    return {
        scenario: Sampled(arrays.pop("start"), arrays.pop("goal"), {m: arrays[m] for m in methods if m in arrays})
        for scenario, arrays in sorted_.items()
    }


def typical_problems(
    trials: pd.DataFrame, scenario: str, adherence: str, methods: Sequence[str], count: int
) -> tuple[list[tuple[str, int]], int]:
    """Return (scene, problem) of problems that all methods solved, and how many of those there are.

    They stand at evenly spaced ranks of the first method's path length, so that nobody picks the pretty ones.
    """
    part = trials[(trials["scenario"] == scenario) & (trials["adherence"] == adherence)]
    part = part[part["method"].isin(methods)]
    part = part[part["solved"].astype(bool)]
    solved = part.pivot_table(index=["scene", "problem"], columns="method", values="path_length")
    if not methods or not set(methods) <= set(solved.columns):
        return [], 0
    ranked = solved[list(methods)].dropna().sort_values(methods[0], kind="stable")
    ranks = sorted({int((k + 0.5) / count * len(ranked)) for k in range(count)}) if len(ranked) else []
    return [(str(ranked.index[r][0]), int(ranked.index[r][1])) for r in ranks], len(ranked)


def _samples(
    trials: pd.DataFrame,
    paths: pd.DataFrame,
    obstacles: Mapping[str, Sequence[Obstacle]],
    scenario: str,
    sampled: Sampled,
    folder: Path,
    stills: Stills,
) -> Illustration | None:
    part = paths[paths["scenario"] == scenario]
    ends, n = np.concatenate([sampled.start, sampled.goal]), len(sampled.start)
    same = [len(path) >= n and np.allclose(np.concatenate([path[:n], path[-n:]]), ends) for path in part["path"]]
    solved = part[np.array(same, bool)]
    if solved.empty or not sampled.clouds:
        # Only a path tells which scene the samples belong to.
        _LOG.warning("no picture of samples for scenario %r: no method solved the problem they are for", scenario)
        return None
    solved = solved.assign(rank=[list(ordered(part["method"], "method")).index(m) for m in solved["method"]])
    row = solved.sort_values("rank", kind="stable").iloc[0]
    globe = _globe(
        paths, obstacles, scenario, str(row["scene"]), int(row["problem"]), [row["method"]], row["adherence"]
    )
    samplers = trials.drop_duplicates("method").set_index("method")["sampler"].to_dict()
    clouds = {
        f"{method} ({samplers[method]})" if method in samplers else method: c for method, c in sampled.clouds.items()
    }
    where = f"scene {row['scene']}, problem {row['problem']}"
    how = stills.samples(globe, clouds, folder / f"{SAMPLES}{scenario}.png", where)
    counts = ", ".join(f"n = {len(cloud)} of {name}" for name, cloud in clouds.items())
    caption = (
        f"Samples for one problem ({where}; {counts}) and its path found by "
        f"{text.method_name(row['method'], row['adherence'])}. Learned ones are all of the network, which plans "
        f"ask only so often before they fall back to the classical sampler; uniform ones are uniform in the box of the "
        f"joints, then projected. Obstacles may hide samples inside them. Drawn by {how}."
    )
    return Illustration(f"{folder.name}/{SAMPLES}{scenario}.png", f"Samples, scenario '{scenario}'", caption)


def _globe(
    paths: pd.DataFrame,
    obstacles: Mapping[str, Sequence[Obstacle]],
    scenario: str,
    scene: str,
    problem: int,
    methods: Sequence[str],
    adherence: str,
) -> Globe:
    if scene not in obstacles:
        raise ArtifactError(f"no obstacles for scene {scene!r}; there are: {', '.join(sorted(obstacles))}")
    part = paths[
        (paths["scenario"] == scenario)
        & (paths["scene"].astype(str) == scene)
        & (paths["problem"] == problem)
        & (paths["adherence"] == adherence)
    ]
    drawn = {}
    for method in methods:
        rows = part[part["method"] == method]
        if rows.empty:
            raise ArtifactError(f"paths: none of {text.method_name(method, adherence)} on {scene} problem {problem}")
        drawn[method] = path_array(rows.iloc[0])
    first = next(iter(drawn.values()))
    lengths = " / ".join(f"{np.linalg.norm(np.diff(path, axis=0), axis=1).sum():.2f}" for path in drawn.values())
    return Globe(obstacles[scene], first[0], first[-1], drawn, title=f"{scene}, problem {problem}\n{lengths} m")
