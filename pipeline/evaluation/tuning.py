"""The rule by which settings are chosen on validation scenes: one rule, for ours and for the baseline alike.

Of the variants that were tried, those that solve as many problems as any of them; of these, those whose median planning
time is within a tenth of the least; of these the one with the shortest paths (median over the problems it solved).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pipeline.errors import ArtifactError

NEAR = 1.1  # medians of 80 problems that are nearer than a tenth are not told apart (reports/sphere.md)
RULE = (
    "Of the variants that solve as many problems as any of them, those whose median time is within a tenth of the "
    "least; of these the one with the shortest paths."
)
Settings = Mapping[str, Mapping[str, Any]]  # label -> 'planner' and 'sampler', and of variants 'base'


@dataclass(frozen=True)
class Tuned:
    """What the rule chose for one method.

    Attributes:
        base: label of the method whose variants were tried.
        method: label of the benchmark's method that has the setting.
        tried: how many variants there were.
        chosen: label of the variant that the rule chooses.
        differs: parameters of the benchmark's method that are others, as 'name = its value, chosen value'.
    """

    base: str
    method: str
    tried: int
    chosen: str
    differs: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """What was chosen, and whether the benchmark's method has it."""
        said = f"{self.method}: of {self.tried} variants of {self.base} the rule chooses {self.chosen}"
        if not self.differs:
            return f"{said}, which is what was measured."
        return f"{said}; what was measured differs from it: {', '.join(self.differs)}."


def choose(trials: pd.DataFrame, labels: list[str]) -> str:
    """Return the label that the rule chooses; of equals the first.

    Args:
        trials: of the variants.
        labels: variants to choose from, in the order of the configuration.

    Raises:
        ArtifactError: none of them was tried.
    """
    groups = {label: trials[trials["method"] == label] for label in labels}
    tried = {label: group for label, group in groups.items() if len(group)}
    if not tried:
        raise ArtifactError(f"none of the variants {labels} has trials")
    most = max(float(group["solved"].mean()) for group in tried.values())
    sure = {label: group for label, group in tried.items() if float(group["solved"].mean()) == most}
    times = {label: float(group["planning_time"].median()) for label, group in sure.items()}
    near = [label for label in sure if times[label] <= NEAR * min(times.values())]
    lengths = {label: sure[label].loc[sure[label]["solved"].astype(bool), "path_length"].median() for label in near}
    known = [label for label in near if lengths[label] == lengths[label]]  # without a path there is no length
    return min(known or near, key=lambda label: lengths[label] if known else times[label])


def tuned(trials: pd.DataFrame, tried: Settings, base: str, settings: Settings, method: str) -> Tuned | None:
    """Return what the rule chooses among the variants of a base, held against a method of the benchmark.

    Args:
        trials: of the variants.
        tried: settings of the variants, each with its base.
        base: label of the base.
        settings: of the benchmark's methods.
        method: label of the one that should have what was chosen.

    Returns:
        None where no variant of the base was tried or the benchmark has no such method.
    """
    labels = [label for label, parts in tried.items() if parts["base"] == base]
    labels = [label for label in labels if (trials["method"] == label).any()]
    if not labels or method not in settings:
        return None
    chosen = choose(trials, labels)
    differs = [
        f"{name} = {value}, chosen {tried[chosen][part].get(name, 'nothing')}"
        for part in ("planner", "sampler")
        for name, value in settings[method][part].items()
        if tried[chosen][part].get(name) != value
    ]
    return Tuned(base, method, len(labels), chosen, tuple(differs))
