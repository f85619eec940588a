"""What processes must have in common for the same work to have the same results, and their times to be comparable."""

import platform
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from pipeline.keys import package_files, package_versions
from pipeline.machine import processor

_NAMED = 5  # differences of a kind that a message lists


@dataclass(frozen=True)
class Process:
    """What a process runs, and on what.

    Attributes:
        files: hash of every file of our package, by name.
        packages: versions of packages and of Python, by name.
        processor: its name.
        host: the name of the machine.
    """

    files: dict[str, str]
    packages: dict[str, str]
    processor: str
    host: str

    def differences(self, other: "Process", timed: bool) -> str:
        """Return in words in what another process differs; empty where both give the same results.

        Args:
            other: what is judged; its versions are named first.
            timed: whether their times must be comparable too: on processors of one name.
        """
        files = _differing(self.files, other.files)
        packages = [
            f"{name} {other.packages.get(name, 'none')} instead of {self.packages.get(name, 'none')}"
            for name in _differing(self.packages, other.packages)
        ]
        machines = [f"a {other.processor} instead of a {self.processor}"] if timed else []
        kinds = (files, packages, machines if self.processor != other.processor else [])
        return "; ".join(listed(kind) for kind in kinds if kind)


@cache  # a worker keeps modules that it has imported, whatever becomes of their files
def this_process(packages: tuple[str, ...]) -> Process:
    """Return what this process ran when it was first asked, with the versions of these packages.

    Modules that it imports after that from files that have changed since go unnoticed: whoever changes files of a
    worker starts it again.
    """
    versions = {**package_versions(packages), "python": platform.python_version()}
    return Process(package_files(), versions, processor(), socket.gethostname())


def listed(names: list[str]) -> str:
    """Return the first of the names, and how many more there are."""
    more = [f"{len(names) - _NAMED} more"] if len(names) > _NAMED else []
    return ", ".join([*names[:_NAMED], *more])


def _differing(mine: Mapping[str, str], others: Mapping[str, str]) -> list[str]:
    return sorted(name for name in {*mine, *others} if mine.get(name) != others.get(name))
