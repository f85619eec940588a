"""Shards on workers of a Dask cluster are those of one process, whatever becomes of workers; unfit ones are refused."""

import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import cloudpickle
import distributed
import numpy as np
import pandas as pd
import pytest

from pipeline import cluster, process
from pipeline.config import compose, load
from pipeline.environments import ENVIRONMENTS
from pipeline.errors import ClusterError, ConfigError, ProblemError
from pipeline.evaluation.oracle import demonstrate, shards
from pipeline.keys import loaded_packages, package_files, package_versions
from pipeline.parallel import run_shards, timed_shards
from pipeline.process import this_process
from pipeline.spec.scene import Split
from stages.demonstrations import Config

cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers then import none of the above to get these


@pytest.fixture(scope="module")
def scheduler():
    """A scheduler whose two workers are processes of their own."""
    with distributed.LocalCluster(n_workers=2, processes=True, **cluster._LOCAL) as found:
        yield found


@pytest.fixture
def address(scheduler) -> str:
    with distributed.Client(scheduler, set_as_default=False) as client:
        client.wait_for_workers(2)  # a killed one is started again
    return scheduler.scheduler_address


@pytest.fixture
def log(tmp_path) -> Path:
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


def work(log: Path, item: int) -> pd.DataFrame:
    """Return a table that numpy had a part in; leave a note of who made it."""
    (log / f"{item}-{os.getpid()}").touch()
    if item < 0:
        raise ProblemError(f"item {item} cannot be worked on")
    Q = np.random.default_rng(item).normal(size=(50, 50))
    return pd.DataFrame({"item": [item] * 2, "name": ["a", "b"], "q": [list(Q[0]), [1 / 3]], "det": np.linalg.det(Q)})


def mortal(log: Path, task, item) -> pd.DataFrame:
    """Kill the process once, in the middle of the work; then return `task(item)`."""
    try:
        (log / "killed").touch(exist_ok=False)
    except FileExistsError:
        return task(item)
    os.kill(os.getpid(), signal.SIGKILL)


def untimed(task, item) -> pd.DataFrame:
    return task(item).drop(columns="planning_time")


def fatal(item: int) -> pd.DataFrame:
    os.kill(os.getpid(), signal.SIGKILL)


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.parquet")}


def test_a_killed_worker_changes_nothing(tmp_path, address):
    """Demonstrations by two workers, one of which is killed at its work, are those of one process to the bit."""
    small = ["environment.parameters.blocks=60", "environment.parameters.grid=2000", "oracle.shortcuts=5"]
    config = load(compose("demonstrations", small), Config)
    environment = config.environment.environment(ENVIRONMENTS)
    scene = environment.scenes({Split.TRAIN: 1})[0]
    items = list(shards(environment.tasks(scene, 6), 1))
    plan = partial(demonstrate, config.oracle, config.environment, {scene.name: scene})
    tables = {}
    for name, at in (("one", None), ("many", address)):
        task = partial(untimed, plan if at is None else partial(mortal, tmp_path, plan))
        tables[name] = run_shards(task, items, tmp_path / name, 1 if at is None else 0, "test", at)
    assert (tmp_path / "killed").exists()
    assert all(a.equals(b) for a, b in zip(tables["one"], tables["many"], strict=True))
    assert content(tmp_path / "one") == content(tmp_path / "many") and len(content(tmp_path / "one")) == 6


def test_shards_of_a_cluster_are_kept_by_whoever_asked(tmp_path, log, address):
    """A run on a cluster does what one without left undone, and the next one without finds all there, in order."""
    items = [(name, i) for i, name in enumerate("eadbc")]
    run_shards(partial(work, log), items[:2], tmp_path / "shards", 1, "test")
    frames = run_shards(partial(work, log), items, tmp_path / "shards", 1, "test", address)
    noted = sorted(path.name.split("-") for path in log.iterdir())
    assert [item for item, _ in noted] == list("01234")
    assert {pid == str(os.getpid()) for item, pid in noted if item in "01"} == {True}
    assert str(os.getpid()) not in {pid for item, pid in noted if item in "234"}
    again = run_shards(partial(work, log), items, tmp_path / "shards", 1, "test", "tcp://127.0.0.1:1")  # asks nobody
    assert all(a.equals(b) for a, b in zip(frames, again, strict=True)) and len(list(log.iterdir())) == 5
    assert [int(frame["item"][0]) for frame in frames] == list(range(5))


def test_an_error_arrives_as_itself(tmp_path, log, address):
    """An error inside an item ends the run as itself; what was finished stays."""
    with pytest.raises(ProblemError, match="item -1 cannot be worked on"):
        run_shards(partial(work, log), [("a", 0), ("bad", -1)], tmp_path / "shards", 1, "test", address)
    assert list(content(tmp_path / "shards")) == ["a.parquet"]


def test_a_shard_that_ends_every_worker_is_named(tmp_path, scheduler, address, monkeypatch):
    """A shard whose workers all end, as where memory is short, ends the run with its name."""
    monkeypatch.setattr(scheduler.scheduler, "allowed_failures", 0)
    with pytest.raises(ClusterError, match="shard a has ended every worker that was at it"):
        run_shards(fatal, [("a", 0)], tmp_path / "shards", 1, "test", address)


@pytest.fixture
def pretend(monkeypatch):
    """Make this process, not the workers, differ in a function that tells what it is."""

    def change(name, value):
        monkeypatch.setattr(process, name, lambda *_: value)
        this_process.cache_clear()

    yield change
    this_process.cache_clear()


@pytest.mark.parametrize(
    ("name", "changed", "said"),
    [
        ("package_files", "pipeline/__init__.py", r"pipeline/__init__\.py$"),
        ("package_versions", "numpy", rf"numpy {np.__version__} instead of another$"),
    ],
)
def test_workers_of_other_code_are_refused(tmp_path, log, address, pretend, name, changed, said):
    """Where a worker's files or packages differ from those of this process, that is said before any work."""
    found = package_files() if name == "package_files" else package_versions(loaded_packages())
    pretend(name, {**found, changed: "another"})
    with pytest.raises(ClusterError, match=rf"worker tcp://\S+ \(\S+\) differs from this process: {said}"):
        run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 0, "test", address)
    assert not list(log.iterdir()) and not content(tmp_path / "shards")


def test_a_worker_that_comes_later_is_asked_too():
    """A worker refuses work of a process that runs other code, before it looks at the work."""
    mine = this_process(("numpy",))
    others = [
        (replace(mine, files={}), False),
        (replace(mine, packages={}), False),
        (replace(mine, processor=""), True),
    ]
    for other, timed in others:
        with pytest.raises(ClusterError, match="differs from this process"):
            cluster._work(pickle.dumps((other, ("numpy",), timed, b"no pickle")), b"")


def test_a_measurement_says_which_machines_made_it(tmp_path, log, address):
    """What was measured on a cluster has how many workers each machine has, and what differs there from here."""

    def where() -> dict:
        return {"commit": "1234567", "process": os.getpid()}

    with timed_shards(partial(work, log), [("a", 0)], tmp_path / "key", 0, "test", where, address) as measured:
        (machine,) = measured.provenance["machines"]
    assert measured.provenance["process"] == os.getpid() and measured.provenance["commit"] == "1234567"
    assert machine.keys() == {"workers", "process"} and machine["workers"] == 2
    assert str(os.getpid()) not in {path.name.split("-")[1] for path in log.iterdir()}


def test_other_processors_are_no_measurement(tmp_path, log, address, pretend, caplog):
    """Workers with another processor are refused where times are measured, and named where only results count."""
    pretend("processor", "abacus")
    with (
        pytest.raises(ClusterError, match=r"a .* instead of a abacus"),
        timed_shards(partial(work, log), [("a", 0)], tmp_path / "key", 0, "test", dict, address),
    ):
        pass
    assert not list(log.iterdir())
    run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 0, "test", address)
    assert "last bits may differ" in caplog.text and "abacus" in caplog.text


@pytest.mark.parametrize(
    ("workers", "threads", "said"),
    [(0, 1, "has no workers; start some: dask worker tcp://"), (1, 2, "more than one thread: tcp://.*--nthreads 1")],
)
def test_unfit_clusters_are_refused(tmp_path, log, monkeypatch, workers, threads, said):
    """A scheduler without workers, and workers of several threads, are refused with how to start better ones."""
    monkeypatch.setattr(cluster, "_CONNECT", 0.5)
    settings = {"processes": False, "protocol": "tcp://", "scheduler_kwargs": cluster._LOCAL["scheduler_kwargs"]}
    with (
        distributed.LocalCluster(n_workers=workers, threads_per_worker=threads, **settings) as found,
        pytest.raises(ClusterError, match=said),
    ):
        run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 0, "test", found.scheduler_address)
    assert not list(log.iterdir())


@pytest.mark.parametrize("listening", [True, False])
def test_where_no_scheduler_answers(tmp_path, log, monkeypatch, listening):
    """Where nothing listens, or something else does, that is said before any work."""
    monkeypatch.setattr(cluster, "_CONNECT", 0.3)
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        if listening:
            found.listen()
        place = f"tcp://127.0.0.1:{found.getsockname()[1]}"
        with pytest.raises(ClusterError, match=f"no scheduler of Dask answers at {place} within 0.3 s"):
            run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 0, "test", place)


@pytest.mark.parametrize(
    "name", ["here", "tcp://", "tcp://host", "host:8786", "http://host:8786", "tcp://a:b:8786", ""]
)
def test_what_is_no_cluster_is_refused(tmp_path, log, name):
    """What is neither null nor local nor an address is refused with the choices, and nothing is written."""
    with pytest.raises(ConfigError, match=f"cluster is '{name}'; it must be null .*'local' .*tcp://host:8786"):
        run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 0, "test", name)
    assert not (tmp_path / "shards").exists()


def test_without_dask(tmp_path, log, monkeypatch):
    """Without Dask a cluster is refused with how to install it; without a cluster it is not needed."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    run_shards(partial(work, log), [("a", 0)], tmp_path / "shards", 1, "test")
    with pytest.raises(ConfigError, match=r"Dask is not installed: pip install -e '\.\[cluster\]'"):
        run_shards(partial(work, log), [("b", 1)], tmp_path / "shards", 1, "test", "local")


SCRIPT = """
import time
from pathlib import Path
import pandas as pd
from pipeline.keys import loaded_packages, package_files, package_versions
from pipeline.parallel import run_shards
def work(item):
    if item:
        time.sleep(0.5)
    return pd.DataFrame({"item": [item]})
if __name__ == "__main__":
    try:
        run_shards(work, [(str(i), i) for i in range(1000)], Path("shards"), 1, "test", "local")
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_ctrl_c_leaves_no_process(tmp_path):
    """Ctrl-C, which a terminal sends to all processes, ends a local cluster without a word of its workers."""
    (tmp_path / "script.py").write_text(SCRIPT)
    begun = subprocess.Popen(
        [sys.executable, "script.py"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(Path(cluster.__file__).parents[1])}, start_new_session=True,
    )  # fmt: skip
    while begun.poll() is None and not content(tmp_path / "shards"):
        time.sleep(0.05)
    os.killpg(begun.pid, signal.SIGINT)
    assert begun.communicate(timeout=60) == ("interrupted\n", "") and begun.returncode == 0
    end = time.monotonic() + 60
    with pytest.raises(ProcessLookupError):
        while time.monotonic() < end:  # multiprocessing's last one ends a moment later
            os.killpg(begun.pid, 0)
            time.sleep(0.05)
