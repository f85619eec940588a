"""Plan one problem of a file and write path, picture, recording and summary. Not a stage of the pipeline."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig

from pipeline.config import load
from pipeline.errors import ConfigError
from pipeline.planning import solve
from pipeline.planning.output import check_output, write_solution
from pipeline.problems import read_problem
from pipeline.stage import guarded


@dataclass(frozen=True)
class Config:
    problem: Path | None
    output: Path | None
    picture: bool
    changes: dict[str, Any] = field(default_factory=dict)


@hydra.main(version_base="1.3", config_path="../conf", config_name="plan")
@guarded
def main(cfg: DictConfig) -> None:
    config = load(cfg, Config)
    if config.problem is None or config.output is None:
        raise ConfigError("name a problem and an output: problem=examples/upright_panda.yaml output=out/upright")
    check_output(config.output)
    solution = solve(read_problem(config.problem, **config.changes))
    summary = write_solution(solution, config.output, config.picture)
    for key in ("status", "planning_time_s", "length", "length_before_shortcuts", "duration_s", "largest_violation",
                "smallest_clearance_m"):  # fmt: skip
        print(f"{key}: {summary[key]}")
    for note in summary["notes"]:
        print(note)
    for pair, share in summary.get("often_in_contact", {}).items():
        print(f"in contact at {share:.0%} of random configurations: {pair}")
    print(f"written to {config.output}")
    if not solution.solved:
        raise SystemExit(2)


if __name__ == "__main__":
    main()
