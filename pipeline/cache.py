"""The user's cache: things that take long to make and depend on their content only."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Return the project's folder in $XDG_CACHE_HOME, or in ~/.cache; it need not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "constrained-motion-planning"
