"""What this process runs on, and when."""

import platform
from datetime import UTC, datetime
from pathlib import Path

from pipeline.provenance import commit, planning_versions


def here() -> dict[str, str]:
    """Return commit, machine and packages in a few words each: what measured times belong to."""
    packages = ", ".join(f"{name} {version}" for name, version in planning_versions().items())
    return {"commit": commit() or "unknown", "machine": processor(), "packages": packages}


def processor() -> str:
    """Return the name of the processor."""
    return described(Path("/proc/cpuinfo"), "model name") or platform.processor() or "unknown"


def now() -> str:
    """Return the date and the time, to the minute (UTC)."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def described(path: Path, key: str) -> str | None:
    """Return the value of the first line of `path` that begins with `key`; None where there is none."""
    if not path.is_file():
        return None
    for line in path.read_text().splitlines():
        if line.startswith(key):
            return line.split(":", 1)[1].strip()
    return None
