"""Figures: what is drawn, equal bytes, and nothing that crashes."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from pipeline.errors import ArtifactError, ConfigError
from pipeline.reporting import length_boxes, save, solved_over_time, success_bars, time_boxes, training_curves
from pipeline.reporting.frames import TRIAL_COLUMNS
from tests.reporting.synthetic import PAPER, make_trials

PANELS = (time_boxes, length_boxes, success_bars)  # with the paper's numbers
FIGURES = (*PANELS, solved_over_time)


def curves(n: int = 20) -> pd.DataFrame:
    epochs = np.arange(n)
    return pd.DataFrame(
        {"epoch": epochs, "train_loss": np.exp(-epochs / 5) + 0.1, "val_loss": np.exp(-epochs / 4) + 0.2}
    )


def drawn(draw, trials: pd.DataFrame):
    """A figure, with the paper's numbers where it shows them."""
    return draw(trials, PAPER) if draw in PANELS else draw(trials)


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_same_data_same_bytes(suffix, tmp_path):
    """A figure drawn twice from the same trials is the same file, without a date in it."""
    files = []
    for name in ("first", "second"):
        files.append(tmp_path / f"{name}.{suffix}")
        save(time_boxes(make_trials(5), PAPER), files[-1])
    assert files[0].read_bytes() == files[1].read_bytes()
    assert b"<dc:date>" not in files[0].read_bytes() and b"tIME" not in files[0].read_bytes()
    assert [f.name for f in sorted(tmp_path.iterdir())] == [f"first.{suffix}", f"second.{suffix}"]


@pytest.mark.parametrize("draw", FIGURES)
def test_pictures_are_not_blank(draw, tmp_path):
    """There are many dark and coloured points on the white paper."""
    save(drawn(draw, make_trials(5)), tmp_path / "figure.png")
    assert (imread(tmp_path / "figure.png")[..., :3].min(axis=2) < 0.6).mean() > 0.01


def test_boxes_are_the_quartiles_of_the_solved():
    """The box of a method spans its quartiles, counted from the sorted solved times; n stands below it."""
    trials = make_trials(21, ("blocks",), ("FMT*",), ("atlas",))
    times = sorted(trials.loc[trials["solved"], "planning_time"])
    (axes,) = time_boxes(trials, PAPER).axes
    box = axes.patches[0].get_path().vertices[:, 1]
    for edge, share in ((box.min(), 0.25), (box.max(), 0.75)):
        place = share * (len(times) - 1)
        low, high = times[int(place)], times[min(int(place) + 1, len(times) - 1)]
        assert edge == pytest.approx(low + (place % 1) * (high - low))
    assert axes.get_xticklabels()[0].get_text() == f"n={len(times)}\natlas"


def test_curves_over_time_end_at_the_share_solved():
    """The line of a method counts the solved trials up to each time; n of the title counts all."""
    trials = make_trials(40, ("blocks",), ("FMT*", "RRTConnect"), ("atlas",))
    (axes,) = solved_over_time(trials).axes
    for line, method in zip(axes.get_lines(), ("FMT*", "RRTConnect"), strict=True):
        part = trials[trials["method"] == method]
        x, y = line.get_data()
        assert y[0] == 0 and y[-1] == pytest.approx(100 * part["solved"].sum() / len(part))
        middle = sum(1 for t in part[part["solved"]]["planning_time"] if t <= x[150]) / len(part)
        assert y[150] == pytest.approx(100 * middle)
    assert "n = 40" in axes.get_title()


def test_success_bars_have_the_height_of_the_count():
    """A method that solved nothing has a bar of height 0 that says 0 %."""
    trials = make_trials(10, ("blocks",), ("FMT*", "RRTConnect"), ("atlas",))
    trials.loc[trials["method"] == "FMT*", "solved"] = False
    (axes,) = success_bars(trials, PAPER).axes
    heights = [patch.get_height() for patch in axes.patches]
    assert heights == [0, pytest.approx(100 * trials.loc[trials["method"] == "RRTConnect", "solved"].mean())]
    assert axes.texts[0].get_text() == "0 %"


@pytest.mark.parametrize("draw", FIGURES)
def test_gaps_do_not_crash(draw, tmp_path):
    """Nothing solved, a combination not run, one trial, unknown methods, and no trials at all."""
    nothing = make_trials(3, ("blocks",))
    nothing["solved"], nothing["path_length"] = False, np.nan
    hole = make_trials(3)
    hole = hole[~((hole["method"] == "FMT*") & (hole["adherence"] == "atlas"))]
    hole = hole[~((hole["scenario"] == "bands") & (hole["adherence"] == "projection"))]
    single = make_trials(1, ("elsewhere",), ("PRM*",), ("relaxation",))
    for k, trials in enumerate((nothing, hole, single, pd.DataFrame(columns=list(TRIAL_COLUMNS)))):
        save(drawn(draw, trials), tmp_path / f"{k}.png")


def test_training_curves_mark_the_least_validation_loss(tmp_path):
    """The ring stands at the minimum; losses of zero or one epoch do not crash."""
    data = curves()
    data.loc[7, "val_loss"] = 0.05
    (axes,) = training_curves(data).axes
    ring = axes.get_lines()[-1]
    assert (ring.get_xdata()[0], ring.get_ydata()[0]) == (7, 0.05)
    save(training_curves(curves(1)), tmp_path / "one.png")
    save(training_curves(curves(3) * 0), tmp_path / "zero.png")
    save(training_curves(curves(0)), tmp_path / "none.png")


def test_foreign_tables_and_files_are_refused(tmp_path):
    """Unknown columns and suffixes are named."""
    with pytest.raises(ArtifactError, match="accuracy"):
        training_curves(curves().assign(accuracy=1))
    with pytest.raises(ArtifactError, match="surprise"):
        time_boxes(make_trials(2).assign(surprise=1), PAPER)
    with pytest.raises(ConfigError, match=r"figure\.pdf.*\.svg or \.png"):
        save(training_curves(curves()), tmp_path / "figure.pdf")
