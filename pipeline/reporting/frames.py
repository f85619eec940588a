"""The tables this room reads: their columns, the order in which groups are shown, paths as arrays."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError
from pipeline.evaluation.runner import COLUMNS, PATH
from pipeline.evaluation.tuning import Settings
from pipeline.files import read_json

TRIAL_COLUMNS = COLUMNS
PATH_COLUMNS = ("scenario", "scene", "problem", "leg", "method", "adherence", *PATH)
CURVE_COLUMNS = ("epoch", "train_loss", "val_loss")

_ORDER: dict[str, tuple[str, ...]] = {
    "scenario": ("blocks", "bands"),
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
    """Return the distinct values in the order of the paper ('scenario', 'adherence'), others behind as they come."""
    known, distinct = _ORDER.get(kind, ()), dict.fromkeys(values)
    return [v for v in known if v in distinct] + [v for v in distinct if v not in known]


def in_order(frame: pd.DataFrame, settings: Settings) -> pd.DataFrame:
    """Return trials or paths with methods in the order in which pages show them, each one's rows as they came.

    Methods that are compared with the same others stand together, and before these; what is not compared stands last.
    """
    sides = [parts["compared_with"] for parts in settings.values() if parts["compared_with"]]
    compared = [(*(m for m, parts in settings.items() if parts["compared_with"] == side), *side) for side in sides]
    order = dict.fromkeys(method for methods in (*compared, settings) for method in methods)
    place = {method: i for i, method in enumerate(order)}
    return frame.sort_values("method", key=lambda methods: methods.map(place), kind="stable", ignore_index=True)


def groups(trials: pd.DataFrame, scenario: str) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield (method, adherence, rows) for every method and adherence of a scenario; rows may be empty."""
    part = trials[trials["scenario"] == scenario]
    adherences = ordered(part["adherence"], "adherence")
    for method in ordered(part["method"], "method"):
        for adherence in adherences:
            yield method, adherence, part[(part["method"] == method) & (part["adherence"] == adherence)]


def method_pairs(methods: Iterable[str], settings: Settings) -> list[tuple[str, str]]:
    """Return (method, what it is compared with) for every comparison of which both methods are present."""
    present = set(methods)
    pairs = [(label, other) for label, parts in settings.items() for other in parts["compared_with"]]
    return [pair for pair in pairs if present.issuperset(pair)]


def pair(trials: pd.DataFrame, scenario: str, adherence: str, first: str, second: str) -> pd.DataFrame:
    """Join the trials of two methods problem by problem; columns get the suffixes _1 and _2.

    Where a problem was tried several times, the k-th seed of one method meets the k-th seed of the other.
    """
    key = ["scene", "problem", "leg", "repetition"]
    part = trials[(trials["scenario"] == scenario) & (trials["adherence"] == adherence)]
    part = part.sort_values("seed", kind="stable").assign(solved=part["solved"].astype(bool))
    sides = []
    for method in (first, second):
        side = part[part["method"] == method]
        sides.append(side.assign(repetition=side.groupby(["scene", "problem", "leg"]).cumcount()))
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
