"""Variants of methods, to show what a choice costs and brings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd

from pipeline.errors import ConfigError
from pipeline.evaluation.statistics import summary
from pipeline.evaluation.trials import Method, method_settings


@dataclass(frozen=True)
class Variant:
    """A method with some parameters changed.

    Attributes:
        base: key of the method.
        planner, sampler: parameters that differ; none for the base itself.
    """

    base: str
    planner: dict[str, Any] = field(default_factory=dict)
    sampler: dict[str, Any] = field(default_factory=dict)

    @property
    def changes(self) -> str:
        """What differs, in words of the configuration; empty for the base."""
        return ", ".join(f"{key} = {value}" for key, value in {**self.planner, **self.sampler}.items())


def variants(bases: Mapping[str, Method], changed: Sequence[Variant]) -> dict[str, Method]:
    """Return the methods of the variants by key, labelled with what differs.

    Raises:
        ConfigError: no variant, an unknown base, a parameter that the base does not name, or the same variant twice.
    """
    if not changed:
        raise ConfigError("variants is empty; name at least one base, as in conf/tried")
    found: dict[str, Method] = {}
    for variant in changed:
        if variant.base not in bases:
            raise ConfigError(f"variant of {variant.base!r}; bases: {', '.join(bases)}")
        base = bases[variant.base]
        for part, changes in (("planner", variant.planner), ("sampler", variant.sampler)):
            known = getattr(base, part).parameters
            unknown = [key for key in changes if key not in known]
            if unknown:
                raise ConfigError(f"{part} of {variant.base!r} has no {unknown[0]!r}; it has: {', '.join(known)}")
        label = f"{base.label} ({variant.changes})" if variant.changes else base.label
        if label in found:
            raise ConfigError(f"the variant {label!r} stands twice")
        found[label] = Method(
            label,
            replace(base.planner, parameters={**base.planner.parameters, **variant.planner}),
            replace(base.sampler, parameters={**base.sampler.parameters, **variant.sampler}),
        )
    return found


def variant_settings(bases: Mapping[str, Method], changed: Sequence[Variant]) -> dict[str, dict[str, Any]]:
    """Return the label of the 'base' and the parameters of 'planner' and 'sampler' of every variant, by its label."""
    settings = method_settings(variants(bases, changed))
    pairs = zip(settings.items(), changed, strict=True)
    return {label: {**parts, "base": bases[variant.base].label} for (label, parts), variant in pairs}


_PROBLEM = ["scenario", "scene", "problem", "adherence"]


def equal_sizes_table(
    trials: pd.DataFrame,
    settings: Mapping[str, Mapping[str, Any]],
    first: str,
    second: str,
    unit: str,
) -> pd.DataFrame:
    """Return one row per N_init with which two methods were both tried: median times and lengths, ratio of the times.

    The variant of a method that stands for a size is the first one with it. Lengths are of the problems that both
    solved.

    Args:
        trials: of the variants.
        settings: of the variants, by `variant_settings`.
        first: label of the method whose times stand above the fraction line.
        second: label of the other.
        unit: of lengths.
    """
    found: dict[str, dict[int, pd.DataFrame]] = {first: {}, second: {}}
    for label, group in trials.groupby("method", sort=False):
        parts = settings[str(label)]
        base, size = parts["base"], parts["planner"].get("samples")
        if base in found and size is not None:
            found[base].setdefault(size, group.set_index(_PROBLEM))
    rows = []
    for size in sorted(set(found[first]) & set(found[second])):
        one, other = found[first][size], found[second][size].reindex(found[first][size].index)
        both = one["solved"].astype(bool) & other["solved"].astype(bool)
        times = [1e3 * summary(side["planning_time"].to_numpy(float)).median for side in (one, other)]
        lengths = [summary(side.loc[both, "path_length"].to_numpy(float)).median for side in (one, other)]
        rows.append((size, len(one), *(f"{time:.1f}" for time in times), f"{times[0] / times[1]:.2f}",
                     *(f"{length:.3f}" for length in lengths)))  # fmt: skip
    names = [
        f"{label}: {what}" for what in ("time median [ms]", f"length median [{unit}]") for label in (first, second)
    ]
    return pd.DataFrame(rows, columns=["N_init", "n", *names[:2], "ratio of times", *names[2:]])


def choices_table(trials: pd.DataFrame, unit: str) -> pd.DataFrame:
    """Return one row per method: success, time, length over problems all solved, work and the network's part."""
    if trials.empty:
        return pd.DataFrame()
    keys = ["scene", "problem"]
    solved = trials.pivot_table(index=keys, columns="method", values="solved", aggfunc="all")
    common = solved.index[solved.all(axis=1)]
    rows = []
    for method, group in trials.groupby("method", sort=False):
        times, network = summary((1e3 * group.planning_time).to_numpy()), summary((1e3 * group.network_time).to_numpy())
        lengths = summary(group.path_length[group.set_index(keys).index.isin(common)].to_numpy())
        rows.append(
            {
                "method": method,
                "n": len(group),
                "solved [%]": f"{100 * group.solved.mean():.1f}",
                "time median [ms]": f"{times.median:.1f}",
                "time mean [ms]": f"{times.mean:.1f}",
                "time p95 [ms]": f"{times.p95:.1f}",
                "of it network, median [ms]": f"{network.median:.1f}",
                f"length median [{unit}], {len(common)} all solved": f"{lengths.median:.3f}",
                "collision checks, median": f"{group.collision_checks.median():.0f}",
                "samples, median": f"{group.samples.median():.0f}",
                "from the classical sampler [%]": f"{100 * group.fallback_samples.sum() / group.samples.sum():.1f}"
                if group.samples.sum()
                else "0.0",
            }
        )
    return pd.DataFrame(rows)
