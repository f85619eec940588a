"""Work in shards keeps its order, continues where it was killed, and lets errors through."""

import os
import time
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from threadpoolctl import threadpool_info

from pipeline import parallel
from pipeline.errors import ConfigError, ProblemError
from pipeline.files import write_json, write_table
from pipeline.parallel import run_shards, single_threaded

NAMES = ("e", "a", "d", "b", "c")  # neither sorted nor in the order they finish


def work(log: Path, after: dict[int, int], item: int) -> pd.DataFrame:
    """Return a table of the item once `after` others are done, and leave a note that it is done too."""
    end = time.monotonic() + 60
    while len(list(log.iterdir())) < after.get(item, 0) and time.monotonic() < end:
        time.sleep(0.01)
    (log / f"{item}-{time.monotonic_ns()}").touch()
    if item < 0:
        raise ProblemError(f"item {item} cannot be worked on")
    return pd.DataFrame({"item": [item, item], "root": [item**0.5, -(item**0.5)], "q": [[1 / 3, item], [0.1]]})


@pytest.fixture
def log(tmp_path):
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


def done(log: Path) -> list[int]:
    """Return the items that were worked on, one entry per call."""
    return sorted(int(path.name.rpartition("-")[0]) for path in log.iterdir())


def run(tmp_path, log, items, workers=1, after=None):
    return run_shards(partial(work, log, after or {}), items, tmp_path / "shards", workers, "test")


def test_results_come_in_the_order_of_the_items(tmp_path, log):
    """With two processes and a first item that finishes last, the tables come in the order of the items."""
    items = list(zip(NAMES, range(5), strict=True))
    frames = run(tmp_path, log, items, workers=2, after={0: 4})
    assert [frame["item"].tolist() for frame in frames] == [[i, i] for i in range(5)]
    stamps = {int(path.name.split("-")[1]): path.name.split("-")[0] for path in log.iterdir()}
    assert stamps[max(stamps)] == "0"
    assert sorted(path.name for path in (tmp_path / "shards").iterdir()) == [f"{n}.parquet" for n in sorted(NAMES)]


def test_number_of_workers_changes_nothing(tmp_path, log):
    """One process and two give equal tables; so does reading them back in a later run, which works on nothing."""
    items = list(zip(NAMES, range(5), strict=True))
    one = run_shards(partial(work, log, {}), items, tmp_path / "one", 1, "test")
    two = run_shards(partial(work, log, {}), items, tmp_path / "two", 2, "test")
    assert done(log) == sorted(2 * list(range(5)))
    again = run_shards(partial(work, log, {}), items, tmp_path / "two", 2, "test")
    assert len(done(log)) == 10
    for a, b, c in zip(one, two, again, strict=True):
        pd.testing.assert_frame_equal(a, b)
        pd.testing.assert_frame_equal(a, c)
    for name in NAMES:
        assert (tmp_path / "one" / f"{name}.parquet").read_bytes() == (
            tmp_path / "two" / f"{name}.parquet"
        ).read_bytes()


def test_finished_shards_are_read_not_repeated(tmp_path, log):
    """Shards that are there stay untouched and are not worked on again; the others are, and order is kept."""
    run(tmp_path, log, [("b", 1), ("d", 3)])
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "shards").iterdir()}
    frames = run(tmp_path, log, [("a", 0), ("b", 1), ("c", 2), ("d", 3)])
    assert [int(frame["item"][0]) for frame in frames] == [0, 1, 2, 3]
    assert done(log) == [0, 1, 2, 3]
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "shards").iterdir()}
    assert len(after) == 4 and before.items() <= after.items()


@pytest.mark.parametrize("damage", ["truncated", "empty", "foreign", "other schema"])
def test_damaged_shard_is_done_again(tmp_path, log, damage):
    """A shard that is cut off, empty or not a shard is worked on again, and only that one."""
    items = [("a", 0), ("b", 1)]
    expected = run(tmp_path, log, items)
    path = tmp_path / "shards" / "a.parquet"
    whole = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "foreign":
        write_json({"a": 1}, path)
    else:
        write_table(pd.DataFrame({"item": [7]}), path, "paths")
    frames = run(tmp_path, log, items)
    assert done(log) == [0, 0, 1]
    assert path.read_bytes() == whole
    for a, b in zip(expected, frames, strict=True):
        pd.testing.assert_frame_equal(a, b)


@pytest.mark.parametrize("workers", [1, 2])
def test_error_surfaces_and_leaves_finished_shards(tmp_path, log, workers):
    """An error inside an item ends the run as itself, out of this process or another; what was finished stays."""
    items = [("a", 0), ("b", 1), ("bad", -1)]
    with pytest.raises(ProblemError, match="item -1 cannot be worked on"):
        run(tmp_path, log, items, workers, after={-1: 2})
    assert sorted(path.name for path in (tmp_path / "shards").iterdir()) == ["a.parquet", "b.parquet"]
    run(tmp_path, log, items[:2], workers)
    assert done(log) == [-1, 0, 1]


@pytest.mark.parametrize("workers", [-1, -8])
def test_negative_workers_are_refused(tmp_path, log, workers):
    """A negative number of processes is refused with its value and the bound, before anything is written."""
    with pytest.raises(ConfigError, match=f"workers is {workers}; it must be at least 0"):
        run(tmp_path, log, [("a", 0)], workers)
    assert not (tmp_path / "shards").exists()


@pytest.mark.parametrize(("workers", "items", "processes"), [(0, 50, "all"), (0, 1, 1), (3, 50, 3), (3, 2, 2)])
def test_number_of_processes(tmp_path, log, monkeypatch, workers, items, processes):
    """As many processes work as were asked for, with 0 as many as there are cores, never more than there are items."""
    asked = []

    class Pool(parallel.Parallel):
        def __init__(self, n_jobs, **settings):
            asked.append(n_jobs)
            super().__init__(1, **settings)

    monkeypatch.setattr(parallel, "Parallel", Pool)
    run(tmp_path, log, [(f"{i}", i) for i in range(items)], workers)
    assert asked == [min(items, len(os.sched_getaffinity(0))) if processes == "all" else processes]


def test_no_items_give_no_tables(tmp_path, log):
    """Nothing to do gives an empty list."""
    assert run(tmp_path, log, []) == []


def test_single_threaded_holds_numpy_and_torch():
    """Within `single_threaded` BLAS and OpenMP have one thread each, afterwards as many as before."""
    np.ones((2, 2)) @ np.ones((2, 2))
    torch.ones(2, 2) @ torch.ones(2, 2)
    before = [pool["num_threads"] for pool in threadpool_info()]
    with single_threaded():
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
    assert [pool["num_threads"] for pool in threadpool_info()] == before


def test_log_says_what_is_resumed(tmp_path, log, caplog):
    """A run that continues another one says how much of it is there."""
    caplog.set_level("INFO")
    run(tmp_path, log, [("a", 0)])
    assert "earlier run" not in caplog.text
    run(tmp_path, log, [("a", 0), ("b", 1)])
    assert "test: 1 of 2 shards are there from an earlier run" in caplog.text
    assert "test: 2 of 2 in" in caplog.text
