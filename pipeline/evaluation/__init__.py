"""Evaluation: the independent verifier, the trial runner (`pipeline.evaluation.trials`) and the statistics."""

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
from pipeline.evaluation.verifier import Failure, Verdict, VerifierParameters, verify

__all__ = [
    "Center",
    "Comparison",
    "Failure",
    "Interval",
    "McNemar",
    "Method",
    "Summary",
    "Verdict",
    "VerifierParameters",
    "mcnemar",
    "paired_interval",
    "success_interval",
    "summary",
    "verify",
    "wilson",
]
