"""What a measurement was made on."""

import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from pipeline.constraints.native import find_compiler
from pipeline.learning.products import fastest_products
from pipeline.machine import described, processor
from pipeline.provenance import commit, versions

_PEERS = ("roboplan",)  # named where they are installed
PACKAGES = ("ompl", "pin", "coal", "casadi", "torch", "numpy", "scipy", "lightning", "hydra-core", "dvc")


def hardware() -> dict[str, Any]:
    """Return the commit, what of the machine matters to times, and versions."""
    packages = versions((*PACKAGES, *_PEERS))
    return {
        "commit": commit() or "unknown",
        "cpu": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "networks": f"multiply batches in {fastest_products().value}",
        "compiler": _compiler(),
        "memory": described(Path("/proc/meminfo"), "MemTotal") or "unknown",
        "platform": platform.platform(),
        "python": packages.pop("python"),
        "packages": packages,
    }


def _compiler() -> str:
    """Name the C compiler that `native` functions are made by."""
    compiler = find_compiler()
    if compiler is None:
        return "none: CasADi evaluates all functions itself"
    said = subprocess.run([compiler, "--version"], capture_output=True, text=True).stdout
    return said.splitlines()[0] if said else compiler
