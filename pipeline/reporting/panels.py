"""The common frame of the figures: one panel per scenario, one place per method and adherence."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from pipeline.reporting.frames import check_trials, groups, ordered
from pipeline.reporting.paper import Paper, PaperResult
from pipeline.reporting.style import color, new_figure, style

_GAP = 0.7  # empty space between two methods, in widths of a place
_DIAMOND: dict[str, Any] = {
    "marker": "D",
    "color": "white",
    "markeredgecolor": "black",
    "markersize": 5.5,
    "linestyle": "none",
}


@dataclass(frozen=True)
class Place:
    """A place on the horizontal axis: its position, the colour of its method and the trials shown there."""

    x: float
    color: str
    method: str
    adherence: str
    trials: pd.DataFrame

    @property
    def solved(self) -> pd.DataFrame:
        """The solved ones of the trials."""
        return self.trials[self.trials["solved"].astype(bool)]


def draw_panels(
    trials: pd.DataFrame,
    label: str,
    draw: Callable[[Axes, Place], int],
    paper: Paper,
    printed: Callable[[PaperResult], float | None],
) -> Figure:
    """Draw one panel per scenario, the paper's value as a diamond on every place that has one.

    Args:
        trials: as the benchmark writes them.
        label: of the vertical axis.
        draw: draws the trials of one place and returns how many of them it shows.
        paper: the paper's results.
        printed: the value to mark, None for no diamond.
    """
    check_trials(trials)
    if trials.empty:
        return nothing("no trials")
    scenarios, methods = ordered(trials["scenario"], "scenario"), ordered(trials["method"], "method")
    with style():
        marked = False
        width = max(len(places(trials, scenario, methods)) for scenario in scenarios)
        figure = new_figure(1.6 + 0.75 * max(width, 5), 0.6 + 2.7 * len(scenarios))
        for axes, scenario in zip(figure.subplots(len(scenarios), squeeze=False)[:, 0], scenarios, strict=True):
            cells = places(trials, scenario, methods)
            shown = [draw(axes, place) for place in cells]
            for place in cells:
                said = paper.find(scenario, place.method, place.adherence)
                value = None if said is None else printed(said)
                if value is not None:
                    axes.plot(place.x, value, zorder=5, **_DIAMOND)
                    marked = True
            names = [f"n={n}\n{p.adherence.replace('_', chr(10))}" for p, n in zip(cells, shown, strict=True)]
            axes.set_xticks([place.x for place in cells], names, fontsize=8)
            axes.tick_params(axis="x", length=0)
            axes.grid(False, axis="x")
            axes.set_xlim(cells[0].x - 0.7, cells[-1].x + 0.7)
            axes.set_title(f"scenario '{scenario}'", loc="left")
            axes.set_ylabel(label)
        handles: list[Patch | Line2D] = [Patch(fc=color(m, methods), ec="black", lw=0.6, label=m) for m in methods]
        if marked:
            handles.append(Line2D([], [], label="paper", **_DIAMOND))
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def places(trials: pd.DataFrame, scenario: str, methods: list[str]) -> list[Place]:
    """Return the places of a scenario from left to right; methods stand apart."""
    found: list[Place] = []
    x = 0.0
    for method, adherence, group in groups(trials, scenario):
        if found:
            x += 1 if method == found[-1].method else 1 + _GAP
        found.append(Place(x, color(method, methods), method, adherence, group))
    return found


def plain_log(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis over [low, high] with plain numbers, 1-2-5 within two and a half decades."""
    if not 0 < low <= high:
        return
    steps = (1, 2, 5) if np.log10(high / low) < 2.5 else (1,)
    decades = range(int(np.floor(np.log10(low))) - 1, int(np.ceil(np.log10(high))) + 2)
    axis.set_major_locator(FixedLocator([step * 10.0**decade for decade in decades for step in steps]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def nothing(message: str) -> Figure:
    """Return a small figure that says there is nothing to show."""
    with style():
        figure = new_figure(4, 1)
        figure.text(0.5, 0.5, message, ha="center", va="center", color="#555555")
    return figure
