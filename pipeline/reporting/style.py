"""One look for all figures, and one way to write them: the same figure gives the same bytes on the same libraries."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pipeline.atomic import atomic_file
from pipeline.errors import ConfigError

# The paper's colours for three methods (Fig. 7), in shades that differ in lightness too; the fourth is Okabe and Ito's.
COLORS = {"CoMPNetX-FMT*": "#C8102E", "FMT*": "#EDB700", "RRTConnect": "#0B4FA3", "CoMPNetX-RRTConnect": "#56B4E9"}
COLORS |= {"CoMPNetX-FMT*, Algorithm 6": "#D55E00", "FMT*, tuned": "#009E73"}
OTHERS = ("#CC79A7", "#555555", "#8B6C42", "#7B52AB")  # for methods the paper does not draw
_RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # ships with matplotlib, so pictures do not depend on the fonts of the machine
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.dpi": 150,
    "svg.hashsalt": "pipeline.reporting",  # without it SVG identifiers are random
    "svg.fonttype": "path",  # looks the same where DejaVu Sans is not installed
}


@contextmanager
def style() -> Iterator[None]:
    """Hold the room's matplotlib settings while a figure is drawn or written; whatever the user set is put aside."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_RC)  # type: ignore[arg-type]  # its stub wants every key as a literal
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size [inch] that needs no display and no global state."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def color(method: str, methods: list[str]) -> str:
    """Return the colour of a method; methods without one of their own share the rest in order."""
    strangers = [m for m in methods if m not in COLORS]
    return COLORS.get(method) or OTHERS[strangers.index(method) % len(OTHERS)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG or PNG, whole, without dates or versions inside.

    Raises:
        ConfigError: another suffix.
    """
    path = Path(path)
    metadata: dict[str, dict[str, Any]] = {".svg": {"Date": None, "Creator": None}, ".png": {"Software": None}}
    if path.suffix not in metadata:
        raise ConfigError(f"cannot write {path.name}: figures are {' or '.join(metadata)}")
    with style(), atomic_file(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], metadata=metadata[path.suffix])
