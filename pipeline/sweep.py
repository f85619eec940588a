"""Hydra sweeps: no two jobs may write the same place, and those of `stages/tune.py` end in a table."""

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from pipeline.atomic import atomic_file
from pipeline.files import read_json, write_json
from pipeline.machine import processor
from pipeline.provenance import commit

ROW = "row.json"


def keep_row(row: dict[str, Any]) -> None:
    """Keep the outcome of a sweep's job, with commit and machine, beside the others; a single run only logs it."""
    hydra = HydraConfig.get()
    if hydra.mode is not None and hydra.mode.name == "MULTIRUN":
        overrides = dict(item.partition("=")[::2] for item in hydra.overrides.task)  # a deleted key has no value
        made = {"commit": commit() or "unknown", "cpu": processor()}
        write_json({**overrides, **row, **made}, Path(hydra.sweep.dir) / str(hydra.sweep.subdir) / ROW)


class OwnFolders(Callback):
    """Refuses, before its first job begins, a sweep of which two jobs would write the same folder or page."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Compare what the jobs write: their `output`, or the folder of their profile and environment."""
        _refuse_shared(config, _written)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Nothing to do per job."""


class SweepTable(Callback):
    """Prints the rows of all jobs as one table and writes it as `table.md` and `table.csv` into the sweep's folder."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Refuse a sweep of which two jobs would keep their rows in the same folder."""
        folder = config.hydra.sweep.dir  # asked of each job, its clock would go on
        _refuse_shared(config, lambda job: os.path.join(folder, str(job.hydra.sweep.subdir)))

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Gather the rows; jobs that failed have none."""
        folder = Path(config.hydra.sweep.dir)
        rows = [read_json(path) for path in sorted(folder.glob(f"*/{ROW}"), key=lambda path: int(path.parent.name))]
        if not rows:
            return
        table = pd.DataFrame(rows)
        markdown = table.to_markdown(index=False, floatfmt=".4g")
        with atomic_file(folder / "table.md") as temporary:
            temporary.write_text(markdown + "\n")
        with atomic_file(folder / "table.csv") as temporary:
            table.to_csv(temporary, index=False)
        print(f"{markdown}\n\nwritten to {folder / 'table.md'}")

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Nothing to do per job."""


def _written(job: DictConfig) -> str | None:
    """Return the place a stage's job writes; None for one that prints only."""
    if "output" in job:
        return None if job.output is None else os.path.abspath(str(job.output))
    names = [OmegaConf.select(job, key) for key in ("profile.name", "environment.name")]
    return ", ".join(f"{key} {name}" for key, name in zip(("profile", "environment"), names, strict=True) if name)


def _refuse_shared(config: DictConfig, place: Callable[[DictConfig], str | None]) -> None:
    """End the process with one line and status 1 where two jobs have one place; of an exception Hydra only warns."""
    taken: dict[str, int] = {}
    try:
        for number, job in enumerate(_jobs(config)):
            found = place(job)
            if found in taken:
                said = f"jobs {taken[found]} and {number} of this sweep would write the same place ({found})"
                ways = "give each its own, such as 'output=out/${hydra:job.num}', or sweep with stages/tune.py"
                print(f"ConfigError: {said}: {ways}", file=sys.stderr)
                sys.exit(1)
            if found is not None:
                taken[found] = number
    except (HydraException, OmegaConfBaseException):  # Hydra composes the same next, and says what is wrong
        return


def _jobs(config: DictConfig) -> Iterator[DictConfig]:
    """Yield what Hydra composes for each job, while its number is that of the running one."""
    loader, running = GlobalHydra.instance().config_loader(), HydraConfig.instance()
    arguments = [f"{key}={value}" for key, value in (config.hydra.sweeper.get("params") or {}).items()]
    asked_for: Any = OmegaConf.to_container(config.hydra.overrides.task, resolve=False)
    arguments += asked_for
    overrides = OverridesParser.create(config_loader=loader).parse_overrides(arguments)
    (all_jobs,) = BasicSweeper.split_arguments(overrides, None)
    before = running.cfg
    try:
        for number, asked in enumerate(all_jobs):
            job = loader.load_sweep_config(config, list(asked))
            with open_dict(job):
                job.hydra.job.id = job.hydra.job.num = number
            running.set_config(job)
            yield job
    finally:
        running.cfg = before
