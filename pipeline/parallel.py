"""Resumable work over all cores: shards are kept as they finish, so a killed run continues where it was.

What repeats to the bit is kept for any later run of equal inputs (`run_shards`). What a clock measured belongs to the
machine and the hour: only a run that was killed goes on with it (`timed_shards`).
"""

import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from threadpoolctl import threadpool_limits

from pipeline.atomic import exclusive
from pipeline.errors import ArtifactError, ConfigError
from pipeline.files import read_json, read_table, write_json, write_table
from pipeline.keys import digest
from pipeline.machine import now

log = logging.getLogger(__name__)
Item = TypeVar("Item")
_LOG_SECONDS = 15.0  # without a terminal, a line at least this far from the last one
_BEGUN = "begun.json"  # beside timed shards: when the first of them was begun, and where


def run_shards(
    work: Callable[[Item], pd.DataFrame],
    items: Sequence[tuple[str, Item]],
    scratch: Path,
    workers: int,
    label: str,
) -> list[pd.DataFrame]:
    """Return `work(item)` for every (name, item) in order; finished shards of an earlier run are read, not repeated.

    For work that repeats to the bit. Waits while another process works in the same scratch folder.

    Args:
        work: a picklable function of one item; runs in other processes with one thread each.
        items: unique shard names and their items.
        scratch: folder of the shards; its name must hold a hash of everything `work` depends on.
        workers: processes; 0 uses all cores.
        label: what the progress line says.

    Raises:
        ConfigError: a negative number of workers.
        ArtifactError: the system does not let us write.
    """
    _check(workers)
    with exclusive(scratch):
        return _finish(work, items, scratch, workers, label)


@dataclass(frozen=True)
class Timed:
    """What was measured, and where and when.

    Attributes:
        frames: in the order of the items.
        provenance: what was given, and under "measured" from when to when (UTC).
    """

    frames: list[pd.DataFrame]
    provenance: dict[str, Any]


@contextmanager
def timed_shards(
    work: Callable[[Item], pd.DataFrame],
    items: Sequence[tuple[str, Item]],
    scratch: Path,
    workers: int,
    label: str,
    provenance: Mapping[str, Any],
) -> Iterator[Timed]:
    """Yield `work(item)` for every (name, item), measured under `provenance`; inside, write what it is for.

    Only a run that was killed, or whose block failed, leaves shards, and only a run of the same provenance takes them.
    Waits while another process works on the same.

    Args:
        work: see `run_shards`.
        items: likewise.
        workers: likewise.
        label: likewise.
        scratch: as there; the shards lie beside it, in a folder named by the provenance as well.
        provenance: of the measurement, as plain data: commit, machine and versions.

    Raises:
        ConfigError: a negative number of workers.
        ArtifactError: the system does not let us write.
    """
    _check(workers)
    folder = scratch.with_name(digest(scratch.name, provenance, workers))  # who work beside each other are slower
    with exclusive(folder):
        begun = _begun(folder, provenance)
        frames = _finish(work, items, folder, workers, label)
        yield Timed(frames, {**provenance, "measured": f"{begun} to {now()}"})
        shutil.rmtree(folder, ignore_errors=True)


def _check(workers: int) -> None:
    if workers < 0:
        raise ConfigError(f"workers is {workers}; it must be at least 0 (0 uses all cores)")


def _finish(
    work: Callable[[Item], pd.DataFrame], items: Sequence[tuple[str, Item]], scratch: Path, workers: int, label: str
) -> list[pd.DataFrame]:
    found: dict[str, pd.DataFrame] = {}
    for name, _ in items:
        try:
            found[name] = read_table(scratch / f"{name}.parquet", "shard")
        except ArtifactError:
            continue
    waiting = [(name, item) for name, item in items if name not in found]
    if found:
        log.info("%s: %d of %d shards are there from an earlier run", label, len(found), len(items))
    processes = min(workers or len(os.sched_getaffinity(0)), max(len(waiting), 1))
    with _Progress(label, len(items), len(found)) as progress:
        # One process runs in this one: no pool to start, and a debugger can step into it.
        jobs = (delayed(_shard)(work, name, item, scratch) for name, item in waiting)
        pool = Parallel(n_jobs=processes, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
        for name, frame in pool(jobs):
            found[name] = frame
            progress.advance()
    return [found[name] for name, _ in items]


def _begun(folder: Path, provenance: Mapping[str, Any]) -> str:
    """Return when the shards of a folder were begun; shards that do not say so, or not from here, are removed."""
    try:
        stored = read_json(folder / _BEGUN, "begun")
        if digest(stored["provenance"]) == digest(provenance):
            return str(stored["begun"])
    except (ArtifactError, KeyError):
        pass
    for shard in folder.glob("*.parquet"):
        shard.unlink()
    begun = now()
    write_json({"begun": begun, "provenance": dict(provenance)}, folder / _BEGUN, "begun")
    return begun


def stamped(work: Callable[[Item], pd.DataFrame], provenance: Mapping[str, str], item: Item) -> pd.DataFrame:
    """Return `work(item)` with the provenance, and when it began as "measured", in columns of their own.

    For work that repeats but for the times among its columns: these outlive the run that measured them.
    """
    begun = now()
    return work(item).assign(**provenance, measured=begun)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Hold numpy and torch to one thread.

    Their threads on cores that others use cost more than they bring: a network sample of 20 took 68 ms instead of 0.3.
    """
    with threadpool_limits(limits=1):
        yield


def _shard(work: Callable[[Item], pd.DataFrame], name: str, item: Item, scratch: Path) -> tuple[str, pd.DataFrame]:
    with single_threaded():
        frame = work(item)
    write_table(frame, scratch / f"{name}.parquet", "shard")
    return name, read_table(scratch / f"{name}.parquet", "shard")  # as a later run would find it


class _Progress:
    """A bar on a terminal, now and then a line in a log."""

    def __init__(self, label: str, total: int, done: int) -> None:
        self.label, self.total, self.done = label, total, done
        self.begin = self.last = time.monotonic()
        self.bar: Progress | None = None
        if sys.stderr.isatty():
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
            self.bar = Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True))
            self.task = self.bar.add_task(label, total=total, completed=done)

    def __enter__(self) -> "_Progress":
        if self.bar:
            self.bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self.bar:
            self.bar.stop()
        log.info("%s: %d of %d in %.1f s", self.label, self.done, self.total, time.monotonic() - self.begin)

    def advance(self) -> None:
        self.done += 1
        if self.bar:
            self.bar.advance(self.task)
        elif time.monotonic() - self.last > _LOG_SECONDS and self.done < self.total:
            self.last = time.monotonic()
            log.info("%s: %d of %d after %.0f s", self.label, self.done, self.total, self.last - self.begin)
