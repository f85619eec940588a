"""Run a VTK script in a process of its own, because VTK may abort the process it runs in, and say so when it fails."""

import logging
import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

PLAIN = "PIPELINE_PLAIN_STILLS"  # environment variable: '1' draws flat pictures without trying VTK
_TIME_LIMIT = 180.0  # [s]; a still takes 2 to 10 s, a software renderer on a busy machine several times that
_LOG = logging.getLogger(__name__)


def plain_wanted() -> bool:
    """True when the environment asks for flat pictures."""
    return os.environ.get(PLAIN, "") not in ("", "0")


def render(command: Sequence[str], arrays: Mapping[str, np.ndarray], count: int) -> np.ndarray | None:
    """Return the images (count, height, width, 3) a script makes of arrays; None where it failed, after saying so.

    Args:
        command: gets two file names more: the arrays (npz), and where to write `images` (npz).
        arrays: what to draw.
        count: how many images to expect.
    """
    with tempfile.TemporaryDirectory() as folder:
        scene, images = Path(folder) / "scene.npz", Path(folder) / "images.npz"
        np.savez(scene, **arrays)  # type: ignore[arg-type]  # its stub takes names for options
        try:
            done = subprocess.run(
                [*command, str(scene), str(images)], capture_output=True, text=True, timeout=_TIME_LIMIT
            )
            reason = f"exit code {done.returncode}: {done.stderr.strip()[-300:]}" if done.returncode else ""
        except (OSError, subprocess.TimeoutExpired) as error:
            reason = str(error)
        if not reason:
            try:
                with np.load(images, allow_pickle=False) as stored:
                    found: np.ndarray = stored["images"]
                # A broken driver gives panels of one colour.
                blank = found.ndim != 4 or found.std(axis=(1, 2, 3)).min() < 1
                if len(found) == count and not blank:
                    return found
                reason = "it returned blank images or too few"
            except (OSError, KeyError, ValueError) as error:
                reason = f"it returned no images ({error})"
    _LOG.warning(
        "VTK cannot render here (%s). Stills are drawn flat by matplotlib; for 3-D ones install libegl1 and libgl1 "
        "(or libosmesa6), or set %s=1 to silence this.", reason, PLAIN,
    )  # fmt: skip
    return None
