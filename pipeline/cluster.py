"""Workers of a Dask cluster, on this machine or on others, that finish shards of work.

A worker needs this code, the same packages and one thread, but no disk that it shares with this process: what it works
on is sent to it, and what it finds comes back. Dask itself does again elsewhere what a killed worker was at. It is not
asked through joblib, whose Dask backend cannot give results as they come.
"""

import asyncio
import itertools
import json
import logging
import os
import pickle
import re
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from types import ModuleType
from typing import Any, TypeVar

import cloudpickle

from pipeline.errors import ClusterError, ConfigError, shown
from pipeline.keys import loaded_packages
from pipeline.process import Process, listed, this_process

log = logging.getLogger(__name__)
Item = TypeVar("Item")
Found = TypeVar("Found")
LOCAL = "local"
_ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):\d{1,5}")
_CONNECT = 5.0  # [s] for a scheduler to answer, and for its first worker to be there
_PATIENCE = 30.0  # [s] without any worker; one that was killed is started again in less
_LOCAL: dict[str, Any] = {
    "threads_per_worker": 1,  # numpy's and torch's threads, and functions with buffers of their own, are one's alone
    "memory_limit": None,  # joblib's processes have none either
    # Ctrl-C at a terminal reaches workers too: they end with the process that started them.
    "preload": "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n",
    "silence_logs": logging.CRITICAL,
    "dashboard_address": None,
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},  # it listens all the same: not at a port others want
}


def check_cluster(cluster: str | None) -> None:
    """Refuse what names no cluster, and any cluster where Dask is not installed.

    Raises:
        ConfigError: says which values there are, or what to install.
    """
    if cluster is None:
        return
    if cluster != LOCAL and not _ADDRESS.fullmatch(cluster):
        raise ConfigError(
            f"cluster is {shown(cluster)}; it must be null (processes of this machine, without Dask), {LOCAL!r} or "
            "the address of a scheduler, as tcp://host:8786"
        )
    _dask(cluster)


@contextmanager
def opened(cluster: str, workers: int, timed: bool = False) -> Iterator["Cluster"]:
    """Yield a cluster once each of its workers has been found to run what this process runs.

    Args:
        cluster: `LOCAL` starts worker processes on this machine, and ends them; else the address of a scheduler.
        workers: processes to start, 0 for one per core; of a scheduler, how many work at once, 0 for all there are.
        timed: whether times are measured: workers then need processors of the name of this machine's.

    Raises:
        ConfigError: see `check_cluster`.
        ClusterError: no scheduler answers, it has no workers, or one has several threads or differs from this process.
    """
    check_cluster(cluster)
    dask = _dask(cluster)
    with ExitStack() as stack:
        place: Any = cluster
        if cluster == LOCAL:
            count = workers or len(os.sched_getaffinity(0))
            place = stack.enter_context(dask.LocalCluster(n_workers=count, **_LOCAL))
        else:
            try:
                asyncio.run(_connect(cluster))
            except (OSError, TimeoutError) as error:
                raise ClusterError(f"no scheduler of Dask answers at {cluster} within {_CONNECT:g} s") from error
        yield Cluster(stack.enter_context(dask.Client(place)), cluster, workers, timed)


class Cluster:
    """The workers of a scheduler; see `opened`."""

    def __init__(self, client: Any, name: str, workers: int, timed: bool) -> None:
        self._client, self._name, self._workers, self._timed = client, name, workers, timed
        self._packages = tuple(loaded_packages())
        start = f"dask worker {name} --nworkers 2 --nthreads 1"
        try:
            client.wait_for_workers(1, timeout=_CONNECT)
        except TimeoutError:
            raise ClusterError(f"the scheduler at {name} has no workers; start some: {start}") from None
        threaded = sorted(worker for worker, threads in client.nthreads().items() if threads != 1)
        if threaded:
            raise ClusterError(f"more than one thread: {listed(threaded)}; start workers by: {start}")
        self._processes = self._asked(partial(this_process, self._packages))
        mine = this_process(self._packages)
        for worker, process in self._processes.items():
            _refuse(worker, mine, process, timed)
        others = sorted({process.processor for process in self._processes.values()} - {mine.processor})
        if others:
            log.warning("last bits may differ: workers have %s, this machine a %s", listed(others), mine.processor)

    def finished(self, work: Callable[[Item], Found], items: Sequence[tuple[str, Item]]) -> Iterator[tuple[str, Found]]:
        """Yield the name and `work(item)` of every (name, item), as they are finished.

        Raises:
            ClusterError: the connection is lost, no worker is left, one that has come later differs, or a shard has
                ended whoever was at it, several times.
            Exception: whatever `work` raises.
        """
        dask, waiting, running = _dask(self._name), iter(items), dict[Any, str]()
        expected = this_process(self._packages), self._packages, self._timed, cloudpickle.dumps(work)
        # The scheduler keeps how this is made, and so brings it to workers that come later.
        carried = self._client.submit(_same, pickle.dumps(expected), pure=False)
        while True:
            room = (self._workers or 2 * self._count() or 1) - len(running)
            for name, item in itertools.islice(waiting, max(room, 0)):
                running[self._client.submit(_work, carried, cloudpickle.dumps(item), pure=False)] = name
            if not running:
                return
            try:
                done = dask.wait(list(running), timeout=_PATIENCE, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                if not self._count():
                    raise ClusterError(
                        f"no worker is left at {self._name}: start some and this run again, which goes on"
                    ) from None
                continue
            except dask.CancelledError as error:
                raise self._lost() from error
            for future in sorted(done, key=lambda future: future.status != "finished"):  # an error is the last
                name = running.pop(future)
                yield name, self._result(future, name)

    def measured(self, where: Callable[[], Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Return for each machine how many workers it has, and in what `where()` there differs from here."""
        mine, machines = where(), dict[str, dict[str, Any]]()
        for worker, there in self._asked(where, list(self._processes)).items():
            differing = {key: value for key, value in there.items() if value != mine.get(key)}
            machines[self._processes[worker].host] = differing
        counts = Counter(process.host for process in self._processes.values())
        rows = [{"workers": counts[host], **differing} for host, differing in machines.items()]
        return sorted(rows, key=lambda row: json.dumps(row, sort_keys=True))

    def _asked(self, question: Callable[[], Found], workers: list[str] | None = None) -> dict[str, Found]:
        """Return the answers of these workers, or of all, by their addresses."""
        answers: dict[str, Any] = self._client.run(question, workers=workers, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, Exception):
                raise ClusterError(
                    f"worker {worker} cannot run this code, {type(answer).__name__}: {answer}; start workers where "
                    "`import pipeline` finds this version of it"
                )
        return dict(sorted(answers.items()))

    def _result(self, future: Any, name: str) -> Any:
        dask = _dask(self._name)
        try:
            return future.result()
        except dask.KilledWorker as error:
            raise ClusterError(f"shard {name} has ended every worker that was at it; the last one: {error}") from error
        except dask.CancelledError as error:
            raise self._lost() from error

    def _count(self) -> int:
        """Return how many workers there are now."""
        try:
            return len(self._client.nthreads())
        except OSError as error:
            raise self._lost() from error

    def _lost(self) -> ClusterError:
        return ClusterError(f"the scheduler at {self._name} went away: start it and this run again, which goes on")


def _dask(cluster: str) -> ModuleType:
    try:
        import distributed
    except ImportError as error:
        raise ConfigError(
            f"cluster is {cluster!r}, for which Dask is not installed: pip install -e '.[cluster]'"
        ) from error
    for name in ("distributed", "distributed.client"):  # they tell of every connection; what matters is raised here
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


async def _connect(address: str) -> None:
    """Wait for a scheduler to answer: Dask's own limit does not hold where something else listens."""
    comm = await asyncio.wait_for(_dask(address).comm.connect(address, timeout=_CONNECT), _CONNECT)
    await comm.close()


def _same(value: bytes) -> bytes:
    return value


def _work(carried: bytes, item: bytes) -> Any:
    """Run on a worker: do one item, where it is known that the result will be that of the asking process."""
    mine, packages, timed, work = pickle.loads(carried)
    _refuse(socket.gethostname(), mine, this_process(packages), timed)
    return pickle.loads(work)(pickle.loads(item))


def _refuse(worker: str, mine: Process, process: Process, timed: bool) -> None:
    differences = mine.differences(process, timed)
    if differences:
        raise ClusterError(f"worker {worker} ({process.host}) differs from this process: {differences}")
