"""Measure what parts, plans and demonstrations cost, ours beside OMPL's. Not a stage of the pipeline."""

import shlex

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.atomic import check_file
from pipeline.config import load
from pipeline.evaluation.bench import Bench, measure
from pipeline.reporting.markdown import write_part
from pipeline.reporting.performance_page import performance_page
from pipeline.stage import guarded


@hydra.main(version_base="1.3", config_path="../conf", config_name="bench")
@guarded
def main(cfg: DictConfig) -> None:
    bench = load(cfg, Bench)
    if bench.output:
        check_file(bench.output)
    command = shlex.join(["python", "stages/bench.py", *HydraConfig.get().overrides.task])
    text = performance_page(measure(bench), command)
    print(text, end="")
    if bench.output:
        write_part(text, bench.output)


if __name__ == "__main__":
    main()
