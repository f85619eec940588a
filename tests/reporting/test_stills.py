"""Both ways of drawing stills, and how the second replaces the first."""

import logging
import sys

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from pipeline.errors import ProblemError
from pipeline.reporting import Globe, Stills
from pipeline.reporting.renderer import PLAIN
from pipeline.reporting.style import COLORS
from tests.reporting.synthetic import arc, band_scene, block_scene, unit

START, GOAL = unit(np.array([[1.0, 0.2, 0.3], [0.1, 1.0, 0.4]]))
PATHS = {"CoMPNetX-FMT*": arc(START, GOAL), "FMT*": arc(START, GOAL, -0.3), "RRTConnect": arc(START, GOAL, 0.6)}


def shows(image: np.ndarray, color: str, least: int = 150) -> bool:
    """True when many pixels have about the hue and saturation of a colour, whatever their shade."""
    pixels, wanted = image[..., :3].reshape(-1, 3), np.array(to_rgb(color))
    lengths = np.linalg.norm(pixels, axis=1)
    likeness = pixels @ wanted / np.where(lengths > 0, lengths, 1) / np.linalg.norm(wanted)
    return int(((likeness > 0.99) & (lengths > 0.2)).sum()) > least


@pytest.fixture(scope="module")
def vtk() -> Stills:
    return Stills(plain=False)


def test_vtk_draws_or_says_why(vtk, tmp_path, caplog):
    """With VTK, or after one warning without it, the still shows the paper's three colours; the bands are a relief."""
    with caplog.at_level(logging.WARNING):
        how = vtk.paths([Globe(band_scene(), START, GOAL, PATHS, title="n = 3 paths")], tmp_path / "still.png", "bands")
    assert (how == "VTK") != vtk.plain
    assert len(caplog.records) == (how != "VTK")
    image = imread(tmp_path / "still.png")
    assert image[..., :3].std() > 0.1
    assert all(shows(image, COLORS[method]) for method in PATHS)


def test_vtk_samples(vtk, tmp_path):
    """Clouds stand side by side; both of their colours are in the picture."""
    rng = np.random.default_rng(0)
    clouds = {"learned": unit(PATHS["FMT*"] + rng.normal(0, 0.1, (40, 3))), "uniform": unit(rng.normal(size=(300, 3)))}
    globe = Globe(block_scene(60), START, GOAL, {"CoMPNetX-FMT*": PATHS["CoMPNetX-FMT*"]})
    vtk.samples(globe, clouds, tmp_path / "samples.png", colors=["#009E73", "#0B4FA3"])
    image = imread(tmp_path / "samples.png")
    half = image.shape[1] // 2
    assert shows(image[:, :half], "#009E73") and not shows(image[:, half:], "#009E73")
    assert shows(image[:, half:], "#0B4FA3") and not shows(image[:, :half], "#0B4FA3")


@pytest.mark.parametrize("scene", [block_scene(100), band_scene(), []], ids=["blocks", "bands", "empty"])
def test_plain_pictures_show_paths_and_obstacles(scene, tmp_path):
    """The flat picture has the three colours too, the same bytes when drawn twice, and is not blank."""
    for name in ("a.png", "b.png"):
        how = Stills(plain=True).paths([Globe(scene, START, GOAL, PATHS)] * 2, tmp_path / name, "title")
        assert how == "matplotlib"
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    image = imread(tmp_path / "a.png")
    assert image[..., :3].std() > 0.05 and all(shows(image, COLORS[method]) for method in PATHS)


def test_plain_samples(tmp_path):
    """Samples work on the plain way too, also where a sampler gave none, off the sphere or in the origin."""
    clouds = {"learned": np.array([[0.1, 0.1, 0.2], [0.0, 0.0, 0.0], [2.0, 0, 0]]), "uniform": np.empty((0, 3))}
    assert Stills(plain=True).samples(Globe([], START, GOAL), clouds, tmp_path / "samples.png") == "matplotlib"


@pytest.mark.parametrize(
    "code, reason",
    [
        ("import os; os.abort()", "exit code -6"),
        ("raise ImportError('libEGL.so.1: cannot open shared object file')", "libEGL.so.1"),
        ("pass", "no images"),
        ("import sys, numpy; numpy.savez(sys.argv[2], images=numpy.zeros((1, 4, 4, 3), 'uint8'))", "blank"),
    ],
    ids=["abort", "import", "nothing", "blank"],
)
def test_a_broken_renderer_is_replaced_after_one_warning(code, reason, tmp_path, caplog):
    """Abort, missing library, no picture and a black picture: one warning that says why, then flat pictures."""
    stills = Stills(plain=False, renderer=[sys.executable, "-c", code])
    globe = Globe(block_scene(5), START, GOAL, PATHS)
    with caplog.at_level(logging.WARNING):
        for name in ("a.png", "b.png"):
            assert stills.paths([globe], tmp_path / name) == "matplotlib"
    (record,) = caplog.records
    assert reason in record.getMessage() and "libegl1" in record.getMessage() and PLAIN in record.getMessage()
    assert imread(tmp_path / "b.png")[..., :3].std() > 0.05


def test_a_renderer_that_does_not_exist_is_replaced(tmp_path):
    """A command that cannot be started counts as a failure of VTK."""
    stills = Stills(plain=False, renderer=["/nowhere/python"])
    assert stills.paths([Globe([], START, GOAL, PATHS)], tmp_path / "a.png") == "matplotlib"


@pytest.mark.parametrize("value, plain", [("1", True), ("0", False), ("", False)])
def test_the_environment_forces_plain_pictures(value, plain, monkeypatch):
    """The variable decides where the caller does not."""
    monkeypatch.setenv(PLAIN, value)
    assert Stills().plain is plain and Stills(plain=not plain).plain is not plain


def test_a_still_needs_a_globe(tmp_path):
    """Nothing to draw is an error, not an empty file."""
    with pytest.raises(ProblemError, match="at least one"):
        Stills(plain=True).paths([], tmp_path / "a.png")
