"""Figures of a planner report: times, lengths, success, progress over time and training curves."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.evaluation import success_interval
from pipeline.reporting.frames import CURVE_COLUMNS, check, check_trials, ordered
from pipeline.reporting.panels import Place, draw_panels, nothing, plain_log
from pipeline.reporting.paper import Paper
from pipeline.reporting.style import color, new_figure, save, style

__all__ = ["length_boxes", "save", "solved_over_time", "success_bars", "time_boxes", "training_curves"]

_TICKS = 300  # points of a curve; keeps the file small for any number of trials
_BOX: dict[str, Any] = {"whis": (5, 95), "showfliers": False, "widths": 0.8, "patch_artist": True}
_TAG: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1}
_THIN: dict[str, Any] = {"color": "black", "linewidth": 0.8}


def time_boxes(trials: pd.DataFrame, paper: Paper) -> Figure:
    """Draw planning times of the solved trials [s, log], one box per method and adherence, one panel per scenario.

    Boxes are quartiles with the median, whiskers the 5th and 95th percentile; diamonds are the paper's means.
    """

    def draw(axes: Axes, place: Place) -> int:
        axes.set_yscale("log")
        return _box(axes, place, "planning_time")

    figure = draw_panels(
        trials,
        "planning time,\nsolved trials [s]",
        draw,
        paper,
        lambda said: None if said.time is None else said.time[0],
    )
    for axes in figure.axes:
        plain_log(axes.yaxis, *axes.get_ylim())
    return figure


def length_boxes(trials: pd.DataFrame, paper: Paper) -> Figure:
    """Draw path lengths of the solved trials, one box per method and adherence, one panel per scenario."""
    figure = draw_panels(
        trials,
        f"path length,\nsolved trials [{paper.unit}]",
        lambda axes, place: _box(axes, place, "path_length"),
        paper,
        lambda said: None if said.length is None else said.length[0],
    )
    for axes in figure.axes:
        axes.set_ylim(bottom=0)  # after the boxes: a limit set before them would end matplotlib's scaling of the top
    return figure


def success_bars(trials: pd.DataFrame, paper: Paper) -> Figure:
    """Draw the share of trials with a verified path [%] with 95 % intervals; diamonds are the paper's rates."""

    def draw(axes: Axes, place: Place) -> int:
        axes.set_ylim(0, 105)
        n = len(place.trials)
        rate = success_interval(place.trials["solved"].to_numpy(bool), place.trials["scene"].to_numpy(str))
        if n:
            axes.bar(place.x, 100 * rate.estimate, 0.8, color=place.color, edgecolor="black", linewidth=0.6)
            ends = [[100 * max(0.0, rate.estimate - rate.low)], [100 * max(0.0, rate.high - rate.estimate)]]
            axes.errorbar(place.x, 100 * rate.estimate, yerr=ends, color="black", linewidth=1, capsize=3)
            axes.text(place.x, 4, f"{100 * rate.estimate:.4g} %", ha="center", fontsize=8, bbox=_TAG)
        return n

    label = "trials solved,\nverified [%]"
    return draw_panels(trials, label, draw, paper, lambda said: None if said.success is None else 100 * said.success)


def solved_over_time(trials: pd.DataFrame) -> Figure:
    """Draw the share of all trials solved within a planning time; rows are scenarios, columns adherence methods."""
    check_trials(trials)
    if trials.empty:
        return nothing("no trials")
    scenarios, adherences = ordered(trials["scenario"], "scenario"), ordered(trials["adherence"], "adherence")
    methods = ordered(trials["method"], "method")
    with style():
        figure = new_figure(max(7.5, 0.6 + 3.1 * len(adherences)), 0.8 + 2.3 * len(scenarios))
        grid = figure.subplots(len(scenarios), len(adherences), squeeze=False, sharey=True, sharex="row")
        for row, scenario in zip(grid, scenarios, strict=True):
            part = trials[trials["scenario"] == scenario]
            times = part.loc[part["planning_time"] > 0, "planning_time"]
            low, high = (times.min() / 1.2, times.max() * 1.2) if len(times) else (0.1, 1.0)
            for axes, adherence in zip(row, adherences, strict=True):
                group = part[part["adherence"] == adherence]
                _progress(axes, group, methods, np.geomspace(low, high, _TICKS))
                axes.set_title(f"'{scenario}', {adherence.replace('_', ' ')}, {_each(group)}", fontsize=9)
                axes.set_xlim(low, high)
                plain_log(axes.xaxis, low, high)
        figure.supxlabel("planning time [s]", fontsize=9)
        figure.supylabel("trials solved, verified [%]", fontsize=9)
        lines = {line.get_label(): line for axes in figure.axes for line in axes.get_lines()}
        known = [m for m in methods if m in lines]
        figure.legend([lines[m] for m in known], known, loc="outside upper center", ncols=max(1, len(known)))
    return figure


def training_curves(curves: pd.DataFrame) -> Figure:
    """Draw training and validation loss over the epochs; a ring marks the least validation loss.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check(curves, CURVE_COLUMNS, "curves")
    if curves.empty:
        return nothing("no epochs")
    with style():
        figure = new_figure(5.6, 3.4)
        axes = figure.subplots()
        axes.plot(curves["epoch"], curves["train_loss"], "--", color="#555555", label="training")
        axes.plot(curves["epoch"], curves["val_loss"], "-", color="#0072B2", label="validation")
        values = curves[["train_loss", "val_loss"]].to_numpy(float)
        values = values[np.isfinite(values)]
        if curves["val_loss"].notna().any():
            best = curves.iloc[int(np.nanargmin(curves["val_loss"].to_numpy(float)))]
            label = f"least validation loss: {best['val_loss']:.3g} in epoch {best['epoch']:.0f}"
            axes.plot(best["epoch"], best["val_loss"], "o", mfc="none", mec="black", ms=8, label=label)
        if len(values) and values.min() > 0:
            axes.set_yscale("log")
            plain_log(axes.yaxis, *axes.get_ylim())
        axes.set_xlabel("epoch")
        axes.set_ylabel("loss")
        axes.set_title(f"n = {len(curves)} epochs", loc="left")
        axes.legend()
    return figure


def _box(axes: Axes, place: Place, column: str) -> int:
    values = place.solved[column].to_numpy(float)
    if len(values):
        # One dictionary per part: matplotlib changes the one given for the box.
        parts: dict[str, Any] = {f"{part}props": dict(_THIN) for part in ("whisker", "cap", "box")}
        parts["medianprops"] = _THIN | {"linewidth": 1.6}
        drawn = axes.boxplot([values], positions=[place.x], manage_ticks=False, **parts, **_BOX)
        drawn["boxes"][0].set_facecolor(place.color)
    return len(values)


def _progress(axes: Axes, group: pd.DataFrame, methods: list[str], ticks: np.ndarray) -> None:
    for method in methods:
        tried = group[group["method"] == method]
        if len(tried):
            found = np.sort(tried.loc[tried["solved"].astype(bool), "planning_time"].to_numpy(float))
            share = 100 * np.searchsorted(found, ticks, side="right") / len(tried)
            line = (
                "-" if (tried["network_time"] > 0).any() else "--"
            )  # a second cue beside the colour: whether it learned
            axes.plot(ticks, share, line, color=color(method, methods), linewidth=1.8, label=method)
    axes.set_xscale("log")
    axes.set_ylim(-3, 103)


def _each(group: pd.DataFrame) -> str:
    counts = group.groupby("method").size()
    if counts.empty:
        return "n = 0"
    return f"n = {counts.min()} each" if counts.nunique() == 1 else f"n = {counts.min()} to {counts.max()}"
