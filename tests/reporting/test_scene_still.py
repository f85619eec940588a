"""Pictures of an arm's path, by VTK or by matplotlib alone."""

import numpy as np
import pytest
from matplotlib.image import imread

from pipeline.reporting.renderer import PLAIN
from pipeline.reporting.scene_still import draw_path
from pipeline.robots import Obstacle, Shape
from tests.reporting.test_stills import shows
from tests.robots.named import named

BOX = Obstacle(Shape.BOX, (0.5, 0.4, 0.3), (0, 0, 0, 1), (0.2, 0.2, 0.6), "box")


@pytest.mark.parametrize("plain", ["0", "1"])
def test_picture_shows_start_and_goal(plain, tmp_path, monkeypatch):
    """Start and goal of Panda are in the picture in their colours, however it is drawn."""
    monkeypatch.setenv(PLAIN, plain)
    robot = named("panda")
    goal = np.add(robot.rest, [1.2, 0, 0, 0, 0, 0, 0])
    path = robot.rest + np.linspace(0, 1, 20)[:, None] * (goal - robot.rest)
    how = draw_path(robot, (BOX,), path, tmp_path / "still.png", "a title")
    assert plain == "0" or how == "matplotlib"
    image = imread(tmp_path / "still.png")
    assert image.shape[1] > image.shape[0] > 500
    assert shows(image, "#0072B2") and shows(image, "#D55E00")


def test_a_path_of_one_state(tmp_path, monkeypatch):
    """A robot that is where it should be has a picture too."""
    monkeypatch.setenv(PLAIN, "1")
    robot = named("sawyer")
    assert draw_path(robot, (), robot.rest[None], tmp_path / "still.png") == "matplotlib"
    assert imread(tmp_path / "still.png").std() > 0.01
