"""Resumable work over all cores: shards are kept as they finish, so a killed run continues where it was."""

import logging
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pandas as pd
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from threadpoolctl import threadpool_limits

from pipeline.errors import ArtifactError, ConfigError
from pipeline.files import exclusive, read_table, write_table

log = logging.getLogger(__name__)
Item = TypeVar("Item")
_LOG_SECONDS = 15.0  # without a terminal, a line at least this far from the last one


def run_shards(
    work: Callable[[Item], pd.DataFrame],
    items: Sequence[tuple[str, Item]],
    scratch: Path,
    workers: int,
    label: str,
) -> list[pd.DataFrame]:
    """Return `work(item)` for every (name, item) in order; finished shards of an earlier run are read, not repeated.

    Waits while another process works in the same scratch folder.

    Args:
        work: a picklable function of one item; runs in other processes with one thread each.
        items: unique shard names and their items.
        scratch: folder of the shards; its name must hold a hash of everything `work` depends on.
        workers: processes; 0 uses all cores.
        label: what the progress line says.

    Raises:
        ConfigError: a negative number of workers.
    """
    if workers < 0:
        raise ConfigError(f"workers is {workers}; it must be at least 0 (0 uses all cores)")
    with exclusive(scratch):
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
