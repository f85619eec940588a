"""The tables this room reads: their columns, the order in which groups are shown, paths as arrays."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError
from pipeline.files import read_json

TRIAL_COLUMNS = (
    "environment", "scenario", "scene", "problem", "method", "planner", "sampler", "adherence", "seed", "status",
    "claimed", "solved", "rejection", "planning_time", "network_time", "path_length", "iterations", "traversals",
    "projections", "collision_checks", "samples", "fallback_samples", "nearest_queries", "network_calls", "charts",
    "repairs", "max_violation", "min_clearance",
)  # fmt: skip
PATH_COLUMNS = ("scenario", "scene", "problem", "method", "adherence", "path", "waypoints", "dimension")
CURVE_COLUMNS = ("epoch", "train_loss", "val_loss")

LEARNED = "CoMPNetX-"  # names of learned methods begin with this
OURS, LITERAL = f"{LEARNED}FMT*", f"{LEARNED}FMT*, Algorithm 6"
TUNED, CLASSICAL = "FMT*, tuned", "FMT*"  # as ours is, on validation scenes; the paper's own setting
COMPARISONS = (  # learned, classical; first those in which both are tuned alike
    (OURS, TUNED), (OURS, CLASSICAL), (LITERAL, TUNED), (LITERAL, CLASSICAL), (f"{LEARNED}RRTConnect", "RRTConnect"),
)  # fmt: skip
_ORDER = {
    "scenario": ("blocks", "bands"),
    "method": (OURS, LITERAL, TUNED, CLASSICAL, "CoMPNetX-RRTConnect", "RRTConnect"),
    "adherence": ("projection", "atlas", "tangent_bundle"),
}


def check(frame: pd.DataFrame, columns: Sequence[str], name: str) -> None:
    """Refuse a table whose columns are not exactly the expected ones.

    Raises:
        ArtifactError: columns are missing or unknown; the message names them and the expected ones.
    """
    missing = [column for column in columns if column not in frame.columns]
    unknown = [str(column) for column in frame.columns if column not in columns]
    if missing or unknown:
        raise ArtifactError(f"{name}: missing columns {missing}, unknown columns {unknown}; expected {list(columns)}")


def check_trials(trials: pd.DataFrame) -> None:
    """Refuse a table that is not a benchmark's trials, or whose times and lengths cannot be compared.

    Raises:
        ArtifactError: wrong columns, a planning time that is not positive, or a solved trial without a path length.
    """
    check(trials, TRIAL_COLUMNS, "trials")
    if trials.empty:
        return
    times, lengths = (trials[name].to_numpy(float) for name in ("planning_time", "path_length"))
    for what, right in (
        ("planning_time is not above 0 s", (times > 0) & np.isfinite(times)),
        ("a solved trial has no path_length", np.isfinite(lengths) | ~trials["solved"].to_numpy(bool)),
    ):
        if not right.all():
            first = trials[~right].iloc[0]
            raise ArtifactError(
                f"trials: {what} in {int((~right).sum())} of {len(trials)} rows, the first is {first['method']} with "
                f"{first['adherence']} on scene {first['scene']} problem {first['problem']}"
            )


def ordered(values: Iterable[str], kind: str) -> list[str]:
    """Return the distinct values in the order of the paper ('scenario', 'method', 'adherence'), others at the end."""
    known = _ORDER[kind]
    distinct = sorted(set(values))
    return [v for v in known if v in distinct] + [v for v in distinct if v not in known]


def groups(trials: pd.DataFrame, scenario: str) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield (method, adherence, rows) for every method and adherence of a scenario; rows may be empty."""
    part = trials[trials["scenario"] == scenario]
    adherences = ordered(part["adherence"], "adherence")
    for method in ordered(part["method"], "method"):
        for adherence in adherences:
            yield method, adherence, part[(part["method"] == method) & (part["adherence"] == adherence)]


def method_pairs(methods: Iterable[str]) -> list[tuple[str, str]]:
    """Return (learned, classical) for every comparison of which both methods are present."""
    present = set(methods)
    return [(learned, classical) for learned, classical in COMPARISONS if {learned, classical} <= present]


def pair(trials: pd.DataFrame, scenario: str, adherence: str, first: str, second: str) -> pd.DataFrame:
    """Join the trials of two methods problem by problem; columns get the suffixes _1 and _2.

    Where a problem was tried several times, the k-th seed of one method meets the k-th seed of the other.
    """
    key = ["scene", "problem", "repetition"]
    part = trials[(trials["scenario"] == scenario) & (trials["adherence"] == adherence)]
    part = part.sort_values("seed", kind="stable").assign(solved=part["solved"].astype(bool))
    sides = []
    for method in (first, second):
        side = part[part["method"] == method]
        sides.append(side.assign(repetition=side.groupby(["scene", "problem"]).cumcount()))
    joined = sides[0].merge(sides[1], on=key, suffixes=("_1", "_2"))
    return joined.sort_values(key, ignore_index=True)


def both_solved(pairs: pd.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a column of the first and the second method (n,), (n,) on the problems of `pair` that both solved.

    The third array (n,) holds their scenes.
    """
    both = pairs[pairs["solved_1"] & pairs["solved_2"]]
    return both[f"{column}_1"].to_numpy(float), both[f"{column}_2"].to_numpy(float), both["scene"].to_numpy(str)


def path_array(row: pd.Series) -> np.ndarray:
    """Return the path of one row of the paths table as (waypoints, dimension).

    Raises:
        ArtifactError: the flat list does not hold waypoints times dimension numbers.
    """
    flat, shape = np.asarray(row["path"], float), (int(row["waypoints"]), int(row["dimension"]))
    if flat.size != shape[0] * shape[1]:
        raise ArtifactError(
            f"paths: {row['method']} on scene {row['scene']} problem {row['problem']} has {flat.size} numbers, "
            f"expected {shape[0]} waypoints times {shape[1]} dimensions"
        )
    return flat.reshape(shape)


def read_curves(folder: Path) -> pd.DataFrame:
    """Return the losses of all epochs: columns epoch, train_loss, val_loss.

    Args:
        folder: of a training; curves.csv and metrics.json are in it.

    Raises:
        ArtifactError: the file is missing, is not such a table, or has not as many epochs as the metrics say.
    """
    path, metrics = folder / "curves.csv", folder / "metrics.json"
    if not path.is_file():
        raise ArtifactError(f"{path} does not exist: run the stage that writes it (`make repro`, its PROFILE)")
    try:
        frame = pd.read_csv(path)
    except (ValueError, pd.errors.ParserError) as error:  # UnicodeDecodeError and EmptyDataError are ValueErrors
        raise ArtifactError(f"{path} is not a readable table (truncated or foreign): {error}") from error
    check(frame, CURVE_COLUMNS, str(path))
    epochs = read_json(metrics).get("epochs")
    if len(frame) != epochs or not np.isfinite(frame.apply(pd.to_numeric, errors="coerce").to_numpy(float)).all():
        raise ArtifactError(f"{path} has {len(frame)} rows, not all of them numbers, or not {epochs} as {metrics} says")
    return frame
