"""Work in shards keeps its order, continues where it was killed, and lets errors through."""

import errno
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
from pipeline.errors import ArtifactError, ConfigError, ProblemError
from pipeline.files import read_table, write_json, write_table
from pipeline.parallel import run_shards, single_threaded, stamped, timed_shards

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


def test_a_full_disk_is_said(tmp_path, log, monkeypatch):
    """A shard that cannot be written ends the run with its file's name; it is done again by the next one."""

    def refuse(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("pyarrow.parquet.write_table", refuse)
        with pytest.raises(ArtifactError, match=r"shards/a\.parquet cannot be written: No space left on device$"):
            run(tmp_path, log, [("a", 0)])
    assert list((tmp_path / "shards").iterdir()) == []
    run(tmp_path, log, [("a", 0)])
    assert done(log) == [0, 0]


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


HERE = {"commit": "1234567", "cpu": "a processor", "packages": {"numpy": "2.0"}}


def measure(tmp_path, log, items, provenance=HERE, workers=1, fail=False):
    """Run timed shards; return their tables and what is said about where they are from."""
    scratch = tmp_path / "scratch" / "key"
    with timed_shards(partial(work, log, {}), items, scratch, workers, "test", partial(dict, provenance)) as measured:
        if fail:
            raise OSError("the disk is full")
    return measured.frames, measured.provenance


ITEMS = [("a", 0), ("b", 1), ("bad", -1)]  # the third ends the run


def killed(tmp_path, log, **settings) -> None:
    """Leave the shards that a killed run leaves: two of three."""
    with pytest.raises(ProblemError):
        measure(tmp_path, log, ITEMS, **settings)
    assert done(log) == [-1, 0, 1]


def test_a_killed_measurement_goes_on(tmp_path, log):
    """A run of equal commit, machine and versions takes the shards of one that was killed."""
    killed(tmp_path, log)
    frames, _ = measure(tmp_path, log, [*ITEMS[:2], ("c", 2)])
    assert done(log) == [-1, 0, 1, 2]
    assert [int(frame["item"][0]) for frame in frames] == [0, 1, 2]


def test_a_measurement_that_could_not_be_written_goes_on(tmp_path, log):
    """Where writing what was measured fails, the shards stay for the next run."""
    with pytest.raises(OSError, match="the disk is full"):
        measure(tmp_path, log, ITEMS[:2], fail=True)
    measure(tmp_path, log, ITEMS[:2])
    assert done(log) == [0, 1]


def test_a_finished_measurement_is_made_anew(tmp_path, log):
    """What was measured and written is measured again by the next run, and nothing of it stays in scratch."""
    for times in (1, 2):
        measure(tmp_path, log, ITEMS[:2])
        assert done(log) == sorted([0, 1] * times)
        assert list((tmp_path / "scratch").iterdir()) == []


@pytest.mark.parametrize(
    "settings",
    [
        {"provenance": {**HERE, "commit": "7654321"}},
        {"provenance": {**HERE, "cpu": "another processor"}},
        {"provenance": {**HERE, "packages": {"numpy": "2.1"}}},
        {"provenance": {**HERE, "cores": 2}},
        {"workers": 2},  # beside each other they are slower
    ],
)
def test_measurements_from_elsewhere_are_not_taken(tmp_path, log, settings):
    """Shards of another commit, machine, version or number of workers are measured again."""
    killed(tmp_path, log)
    measure(tmp_path, log, ITEMS[:1], **settings)
    assert done(log) == [-1, 0, 0, 1]


@pytest.mark.parametrize("damage", ["of another commit", "missing", "foreign"])
def test_measurements_that_do_not_say_where_they_are_from_are_not_taken(tmp_path, log, damage):
    """Shards that lie where they belong, but do not say so themselves, or say something else, are measured again."""
    killed(tmp_path, log)
    (begun,) = (tmp_path / "scratch").glob("*/begun.json")
    if damage == "missing":
        begun.unlink()
    else:
        begun.write_text(begun.read_text().replace("1234567", "7654321") if damage == "of another commit" else "{}")
    measure(tmp_path, log, ITEMS[:2])
    assert done(log) == [-1, 0, 0, 1, 1]


def test_a_measurement_says_when(tmp_path, log, monkeypatch):
    """Provenance comes back whole, with when the first run began, though it was killed, and when the last one ended."""
    times = iter(["Monday", "Tuesday", "Wednesday"])
    monkeypatch.setattr(parallel, "now", lambda: next(times))
    killed(tmp_path, log)
    _, provenance = measure(tmp_path, log, ITEMS[:2])
    assert provenance == {**HERE, "measured": "Monday to Tuesday"}


def test_times_in_shards_that_stay_say_where_they_are_from(tmp_path, log):
    """A stamped shard that a later run takes keeps the commit and machine of the run that measured it."""
    for commit, items in (("old", [("a", 0)]), ("new", [("a", 0), ("b", 1)])):
        here = partial(stamped, partial(work, log, {}), {"commit": commit, "machine": "m"})
        frames = run_shards(here, items, tmp_path / "shards", 1, "test")
    assert [frame["commit"].unique().tolist() for frame in frames] == [["old"], ["new"]]
    assert {"machine", "measured"} <= set(read_table(tmp_path / "shards" / "a.parquet", "shard"))
    assert done(log) == [0, 1]
