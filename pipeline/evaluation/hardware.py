"""What a measurement was made on."""

import os
import platform
import subprocess
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pipeline.constraints.native import find_compiler
from pipeline.learning.inference import fastest_products

_PEERS = ("roboplan",)  # named where they are installed
PACKAGES = ("ompl", "pin", "coal", "casadi", "torch", "numpy", "scipy", "lightning", "hydra-core", "dvc")


def hardware() -> dict[str, Any]:
    """Return the commit, what of the machine matters to times, and versions."""
    return {
        "commit": _commit(),
        "cpu": _first(Path("/proc/cpuinfo"), "model name") or platform.processor() or "unknown",
        "cores": len(os.sched_getaffinity(0)),
        "networks": f"multiply batches in {fastest_products().value}",
        "compiler": _compiler(),
        "memory": _first(Path("/proc/meminfo"), "MemTotal") or "unknown",
        "platform": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES} | _installed(_PEERS),
    }


def _compiler() -> str:
    """Name the C compiler that `native` functions are made by."""
    compiler = find_compiler()
    if compiler is None:
        return "none: CasADi evaluates all functions itself"
    said = subprocess.run([compiler, "--version"], capture_output=True, text=True).stdout
    return said.splitlines()[0] if said else compiler


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
