"""What all stages share: where their folders are and how an error ends them."""

import functools
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

from omegaconf import DictConfig

from pipeline.atomic import check_folder
from pipeline.errors import PipelineError

ARTIFACTS, SCRATCH = Path("artifacts"), Path("scratch")
_INTERRUPTED = 130  # the exit status of what Ctrl-C ended: 128 + 2


def folder(profile: str, stage: str, environment: str) -> Path:
    """Return the folder a stage writes for a profile and an environment."""
    return ARTIFACTS / profile / stage / environment


def destination(profile: str, stage: str, environment: str) -> Path:
    """Return the folder that this stage is about to write, to be asked for before work starts.

    Raises:
        ArtifactError: it cannot be written.
    """
    found = folder(profile, stage, environment)
    check_folder(found)
    return found


def guarded(main: Callable[[DictConfig], None]) -> Callable[[DictConfig], None]:
    """Turn an error of this package or of the system, or Ctrl-C, into one line: users read the message, not the trace.

    The exit status is 1, after Ctrl-C 130.
    """

    @functools.wraps(main)
    def run(config: DictConfig) -> None:
        try:
            main(config)
            print(end="", flush=True)
        except (PipelineError, OSError) as error:  # OSError: of files and pipes that are no artifacts
            logging.getLogger(__name__).debug("where it happened", exc_info=True)
            sentence = " ".join(str(error).split())  # some of OmegaConf's and pyarrow's are several lines
            _end(f"{type(error).__name__}: {sentence}", 1)
        except KeyboardInterrupt:
            _end("interrupted; nothing is half-written", _INTERRUPTED)

    return run


def _end(line: str, status: int) -> None:
    print(line, file=sys.stderr)
    try:
        print(end="", flush=True)
    except OSError:  # else Python tries again when it ends, and says more about it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)
