"""Evaluation: the trial runner (`pipeline.evaluation.trials`) and the statistics."""

from pipeline.evaluation.statistics import (
    Center,
    Comparison,
    Interval,
    McNemar,
    Method,
    Summary,
    mcnemar,
    paired_interval,
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
    "summary",
    "wilson",
]
