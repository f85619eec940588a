"""Evaluation: the trial runner (`pipeline.evaluation.trials`) and the statistics."""

from pipeline.evaluation.clusters import paired_interval, success_interval
from pipeline.evaluation.statistics import (
    Center,
    Comparison,
    Interval,
    McNemar,
    Method,
    Summary,
    mcnemar,
    summary,
    wilson,
)

__all__ = [
    "Center",
    "Comparison",
    "Interval",
    "McNemar",
    "Method",
    "Summary",
    "mcnemar",
    "paired_interval",
    "success_interval",
    "summary",
    "wilson",
]
