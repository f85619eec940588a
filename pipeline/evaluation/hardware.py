"""What a measurement was made on."""

import os
import platform
import subprocess
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PEERS = ("roboplan",)  # named where they are installed
PACKAGES = ("ompl", "pin", "coal", "casadi", "torch", "numpy", "scipy", "lightning", "hydra-core", "dvc")


def hardware() -> dict[str, Any]:
    """Return the commit, processor, usable cores, memory, Python, platform and the versions that matter."""
    return {
        "commit": _commit(),
        "cpu": _first(Path("/proc/cpuinfo"), "model name") or platform.processor() or "unknown",
        "cores": len(os.sched_getaffinity(0)),
        "memory": _first(Path("/proc/meminfo"), "MemTotal") or "unknown",
        "platform": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES} | _installed(_PEERS),
    }


def _installed(names: tuple[str, ...]) -> dict[str, str]:
    found = {}
    for name in names:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _commit() -> str:
    """Return the short hash of the commit, marked where tracked code or configuration differs from it."""
    head = _git("rev-parse", "--short", "HEAD")
    if head is None:
        return "unknown"
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/pipeline", ":/stages", ":/conf")
    return head + ("-dirty" if changed else "")


def _git(*arguments: str) -> str | None:
    found = subprocess.run(["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True)
    return found.stdout.strip() if found.returncode == 0 else None


def _first(path: Path, key: str) -> str | None:
    """Return the value of the first line of `path` that begins with `key`; None where there is none."""
    if not path.is_file():
        return None
    for line in path.read_text().splitlines():
        if line.startswith(key):
            return line.split(":", 1)[1].strip()
    return None
