"""Pictures of an arm's path, by VTK or by matplotlib alone."""

import numpy as np
import pytest
from matplotlib.image import imread

from pipeline.reporting.renderer import PLAIN
from pipeline.reporting.scene_still import _extent, clearest, draw_path
from pipeline.robots import Obstacle, Shape, attach
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


def test_what_is_held_and_what_stands_around_are_shown(tmp_path, monkeypatch):
    """A cup has colours of its own at both ends; a table beside the robot is in the picture, a hall not as a whole."""
    monkeypatch.setenv(PLAIN, "1")
    cup = Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.05), (0, 0, 0, 1), (0.2, 0.2, 0.3), "cup")
    robot = attach(named("panda"), cup, "panda_hand_tcp")
    path = robot.rest + np.linspace(0, 1, 20)[:, None] * np.array([1.5, 0, 0, 0, 0, 0, 0])
    draw_path(robot, (BOX,), path, tmp_path / "still.png", held=["cup"])
    image = imread(tmp_path / "still.png")
    assert shows(image, "#56B4E9") and shows(image, "#E69F00")
    reach = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])
    for size, shown in ((0.2, 0.7), (100.0, 0.9)):
        far = 0.6 + np.array([[0.0, 0.0, 0.0], [size, 0.1, 0.1]]) / 2
        low, high = _extent([(reach, np.empty((0, 3), int), "", 1.0)], [(far, np.empty((0, 3), int), "", 1.0)], reach)
        np.testing.assert_allclose(low, reach[0])
        away = [(far + 5.0, np.empty((0, 3), int), "", 1.0)]
        np.testing.assert_allclose(_extent([(reach, np.empty((0, 3), int), "", 1.0)], away, reach), reach)
        assert high[0] == pytest.approx(shown)


def test_the_side_view_is_not_behind_a_wall():
    """With a wall on two of four sides the view is from a third; without any, or between equals, from the first."""
    sides = [(0.55, -0.7, 0.45), (0.55, 0.7, 0.45), (-0.55, -0.7, 0.45), (-0.55, 0.7, 0.45)]
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3))
    front = Obstacle(Shape.BOX, (0.5, 0, 0), (0, 0, 0, 1), (0.02, 4.0, 4.0))
    right = Obstacle(Shape.BOX, (0, -0.5, 0), (0, 0, 0, 1), (4.0, 0.02, 4.0))
    assert clearest(sides, points, ()) == sides[0]
    assert clearest(sides, points, (front,)) == sides[2]
    assert clearest(sides, points, (front, right)) == sides[3]


def test_a_path_of_one_state(tmp_path, monkeypatch):
    """A robot that is where it should be has a picture too."""
    monkeypatch.setenv(PLAIN, "1")
    robot = named("sawyer")
    assert draw_path(robot, (), robot.rest[None], tmp_path / "still.png") == "matplotlib"
    assert imread(tmp_path / "still.png").std() > 0.01
