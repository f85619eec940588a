"""What all stages share: where their folders are and how an error ends them."""

import functools
import logging
import sys
from collections.abc import Callable
from pathlib import Path

from omegaconf import DictConfig

from pipeline.errors import PipelineError

ARTIFACTS, SCRATCH = Path("artifacts"), Path("scratch")


def folder(profile: str, stage: str, environment: str) -> Path:
    """Return the folder a stage writes for a profile and an environment."""
    return ARTIFACTS / profile / stage / environment


def guarded(main: Callable[[DictConfig], None]) -> Callable[[DictConfig], None]:
    """Turn an error of this package into one line and exit status 1: users read the message, not the trace."""

    @functools.wraps(main)
    def run(config: DictConfig) -> None:
        try:
            main(config)
        except PipelineError as error:
            logging.getLogger(__name__).debug("where it happened", exc_info=True)
            sentence = " ".join(str(error).split())  # some of OmegaConf's and pyarrow's are several lines
            print(f"{type(error).__name__}: {sentence}", file=sys.stderr)
            sys.exit(1)

    return run
