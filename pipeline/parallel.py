"""Resumable work over all cores or machines: shards are kept as they finish, so a killed run continues where it was.

What repeats to the bit is kept for any later run of equal inputs (`run_shards`). What a clock measured belongs to the
machine and the hour: only a run that was killed goes on with it (`timed_shards`).
"""

import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from threadpoolctl import threadpool_limits

from pipeline.atomic import exclusive
from pipeline.cluster import Cluster, check_cluster, opened
from pipeline.errors import ArtifactError, ConfigError
from pipeline.files import read_json, read_table, write_json, write_table
from pipeline.keys import digest
from pipeline.machine import now, processor

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
    cluster: str | None = None,
) -> list[pd.DataFrame]:
    """Return `work(item)` for every (name, item) in order; finished shards of an earlier run are read, not repeated.

    For work that repeats to the bit. Waits while another process works in the same scratch folder.

    Args:
        work: a picklable function of one item; runs in other processes with one thread each.
        items: unique shard names and their items.
        scratch: folder of the shards; its name must hold a hash of everything `work` depends on.
        workers: processes; 0 uses all cores, or all workers of the cluster.
        label: what the progress line says.
        cluster: whose workers do it; see `pipeline.cluster.opened`. None: processes of this machine, without Dask.

    Raises:
        ConfigError: a negative number of workers, or no such cluster.
        ClusterError: its workers cannot be used; see `pipeline.cluster`.
        ArtifactError: the system does not let us write.
    """
    _check(workers, cluster)
    with exclusive(scratch):
        return _finish(work, items, scratch, workers, label, opened(cluster, workers) if cluster else nullcontext())


@dataclass(frozen=True)
class Timed:
    """What was measured, and where and when.

    Attributes:
        frames: in the order of the items.
        provenance: what was given, under "machines" which of a cluster's worked, and under "measured" from when to
            when (UTC).
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
    where: Callable[[], Mapping[str, Any]],
    cluster: str | None = None,
) -> Iterator[Timed]:
    """Yield `work(item)` for every (name, item), with where it was measured; inside, write what it is for.

    Only a run that was killed, or whose block failed, leaves shards, and only a run of the same provenance takes them.
    Waits while another process works on the same.

    Args:
        work: see `run_shards`.
        items: likewise.
        workers: likewise.
        label: likewise.
        scratch: as there; the shards lie beside it, in a folder named by the provenance as well.
        where: gives the provenance of what is measured in the process that calls it, as plain data: commit, machine and
            versions. Each machine of a cluster is asked too.
        cluster: see `run_shards`; all its workers must have processors of the name of this machine's.

    Raises:
        ConfigError: a negative number of workers, or no such cluster.
        ClusterError: its workers cannot be used; see `pipeline.cluster`.
        ArtifactError: the system does not let us write.
    """
    _check(workers, cluster)
    with opened(cluster, workers, timed=True) if cluster else nullcontext() as crew:
        provenance = {**where(), **({"machines": crew.measured(where)} if crew else {})}
        folder = scratch.with_name(digest(scratch.name, provenance, workers))  # who work beside each other are slower
        with exclusive(folder):
            begun = _begun(folder, provenance)
            frames = _finish(work, items, folder, workers, label, nullcontext(crew))
            yield Timed(frames, {**provenance, "measured": f"{begun} to {now()}"})
            shutil.rmtree(folder, ignore_errors=True)


def _check(workers: int, cluster: str | None) -> None:
    if workers < 0:
        raise ConfigError(f"workers is {workers}; it must be at least 0 (0 uses all cores)")
    check_cluster(cluster)


def _finish(
    work: Callable[[Item], pd.DataFrame],
    items: Sequence[tuple[str, Item]],
    scratch: Path,
    workers: int,
    label: str,
    cluster: AbstractContextManager[Cluster | None],
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
    with _Progress(label, len(items), len(found)) as progress, cluster if waiting else nullcontext() as crew:
        finished = _finished_there(work, waiting, scratch, crew) if crew else _finished(work, waiting, scratch, workers)
        for name, frame in finished:
            found[name] = frame
            progress.advance()
    return [found[name] for name, _ in items]


def _finished(
    work: Callable[[Item], pd.DataFrame], waiting: Sequence[tuple[str, Item]], scratch: Path, workers: int
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield shards as processes of this machine finish and keep them."""
    processes = min(workers or len(os.sched_getaffinity(0)), max(len(waiting), 1))
    # One process runs in this one: no pool to start, and a debugger can step into it.
    jobs = (delayed(_shard)(work, name, item, scratch) for name, item in waiting)
    pool = Parallel(n_jobs=processes, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
    yield from pool(jobs)


def _finished_there(
    work: Callable[[Item], pd.DataFrame], waiting: Sequence[tuple[str, Item]], scratch: Path, cluster: Cluster
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield shards as workers of a cluster finish them; they are kept by this process, whose disk they may not see."""
    for name, frame in cluster.finished(partial(_alone, work), waiting):
        yield name, _kept(frame, name, scratch)


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

    For work that repeats but for the times among its columns: these outlive the run that measured them. The "machine"
    is the one that works, whichever asked for it.
    """
    begun = now()
    return work(item).assign(**{**provenance, "machine": processor()}, measured=begun)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Hold numpy and torch to one thread.

    Their threads on cores that others use cost more than they bring: a network sample of 20 took 68 ms instead of 0.3.
    """
    with threadpool_limits(limits=1):
        yield


def _shard(work: Callable[[Item], pd.DataFrame], name: str, item: Item, scratch: Path) -> tuple[str, pd.DataFrame]:
    return name, _kept(_alone(work, item), name, scratch)


def _alone(work: Callable[[Item], pd.DataFrame], item: Item) -> pd.DataFrame:
    with single_threaded():
        return work(item)


def _kept(frame: pd.DataFrame, name: str, scratch: Path) -> pd.DataFrame:
    """Write a shard, and return it as a later run would find it."""
    write_table(frame, scratch / f"{name}.parquet", "shard")
    return read_table(scratch / f"{name}.parquet", "shard")


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
