"""The tables this room reads: their columns, the order in which groups are shown, paths as arrays."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError

TRIAL_COLUMNS = (
    "environment", "scenario", "scene", "problem", "method", "planner", "sampler", "adherence", "seed", "status",
    "claimed", "solved", "rejection", "planning_time", "network_time", "path_length", "iterations", "traversals",
    "projections", "collision_checks", "samples", "fallback_samples", "nearest_queries", "network_calls", "charts",
    "repairs", "max_violation", "min_clearance",
)  # fmt: skip
PATH_COLUMNS = ("scenario", "scene", "problem", "method", "adherence", "path", "waypoints", "dimension")
CURVE_COLUMNS = ("epoch", "train_loss", "val_loss")

LEARNED = "CoMPNetX-"  # a learned method is this prefix and the name of the classical method it augments
_ORDER = {
    "scenario": ("blocks", "bands"),
    "method": ("CoMPNetX-FMT*", "FMT*", "CoMPNetX-RRTConnect", "RRTConnect"),
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
    """Refuse a table that is not a benchmark's trials, or whose solved trials lack a time or a length.

    Raises:
        ArtifactError: wrong columns, or a solved trial without a finite planning time and path length.
    """
    check(trials, TRIAL_COLUMNS, "trials")
    if trials.empty:
        return
    solved = trials[trials["solved"].astype(bool)]
    wrong = ~np.isfinite(solved[["planning_time", "path_length"]].to_numpy(float)).all(axis=1)
    if wrong.any():
        first = solved[wrong].iloc[0]
        raise ArtifactError(
            f"trials: {int(wrong.sum())} solved trials have no finite planning_time or path_length, the first is "
            f"{first['method']} with {first['adherence']} on scene {first['scene']} problem {first['problem']}"
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
    """Return (learned, classical) for every learned method whose classical counterpart is present."""
    present = ordered(methods, "method")
    return [(m, m.removeprefix(LEARNED)) for m in present if m.startswith(LEARNED) and m.removeprefix(LEARNED) in present]


def pair(trials: pd.DataFrame, scenario: str, adherence: str, first: str, second: str) -> pd.DataFrame:
    """Join the trials of two methods problem by problem; columns get the suffixes _1 and _2.

    Where a problem was tried several times, the k-th seed of one method meets the k-th seed of the other.
    """
    part = trials[(trials["scenario"] == scenario) & (trials["adherence"] == adherence)].sort_values("seed", kind="stable")
    key = ["scene", "problem", "repetition"]
    sides = []
    for method in (first, second):
        side = part[part["method"] == method]
        sides.append(side.assign(repetition=side.groupby(["scene", "problem"]).cumcount(), solved=side["solved"].astype(bool)))
    joined = sides[0].merge(sides[1], on=key, suffixes=("_1", "_2"))
    return joined.sort_values(key, ignore_index=True)


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
