"""A Hydra sweep that ends in a table."""

import logging
from pathlib import Path
from typing import Any

import pandas as pd
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from pipeline.files import atomic_file, read_json, write_json

log = logging.getLogger(__name__)
ROW = "row.json"


def keep_row(row: dict[str, Any]) -> None:
    """Keep the outcome of a sweep's job beside the others; a single run only logs it."""
    hydra = HydraConfig.get()
    if hydra.mode is not None and hydra.mode.name == "MULTIRUN":
        overrides = dict(item.partition("=")[::2] for item in hydra.overrides.task)  # a deleted key has no value
        write_json({**overrides, **row}, Path(hydra.sweep.dir) / str(hydra.sweep.subdir) / ROW)


class SweepTable(Callback):
    """Prints the rows of all jobs as one table and writes it as `table.md` and `table.csv` into the sweep's folder."""

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
