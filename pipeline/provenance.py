"""Which code and which packages made a file."""

import platform
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PLANNING = ("numpy", "pin", "coal", "casadi", "ompl")  # of which a path may depend on the version
_HERE = Path(__file__)
_CODE = tuple(str(_HERE.parents[1] / name) for name in ("pipeline", "stages", "conf"))  # what results depend on


def commit() -> str:
    """Return the short hash of this code's commit, marked where tracked code or configuration differs from it.

    Empty where there is no git, and where this code is not what the repository around it tracks.
    """
    if _git("ls-files", "--error-unmatch", _HERE.name) is None:  # installed below somebody else's repository
        return ""
    head = _git("rev-parse", "--short", "HEAD")
    if not head:
        return ""
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", *_CODE)
    return head + ("-dirty" if changed else "")


def versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of Python and of those packages that are installed; none of them is imported."""
    found = {"python": platform.python_version()}
    for name in packages:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def planning_versions() -> dict[str, str]:
    """Return the versions of what a path may depend on; of torch only where it is loaded, as learned samplers do."""
    return versions((*PLANNING, "torch") if "torch" in sys.modules else PLANNING)


def _git(*arguments: str) -> str | None:
    """Return what git says of this folder; None where it fails or does not exist."""
    try:
        said = subprocess.run(["git", *arguments], cwd=_HERE.parent, capture_output=True, text=True)
    except OSError:
        return None
    return said.stdout.strip() if said.returncode == 0 else None
