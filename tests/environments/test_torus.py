"""Mazes on a torus: pixels by hand, mazes that are trees, and plans that go where a flood fill of the picture goes."""

from collections import deque

import numpy as np
import pytest
from matplotlib.image import imsave

from pipeline.environments.torus import (
    MAJOR,
    MINOR,
    TorusMaze,
    maze_problem,
    random_maze,
    read_maze,
    torus_constraint,
)
from pipeline.errors import ConfigError, ConstraintError, ProblemError
from pipeline.evaluation.verifier import VerifierParameters, verify
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.planners import Problem, RrtConnect, Termination
from pipeline.samplers import UniformSampler
from tests.robots.worlds import ball, differences


def flooded(walls: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Steps from a pixel to every other over bright neighbours, around the torus; -1 where there is no way."""
    found = np.full(walls.shape, -1)
    found[start], waiting = 0, deque([start])
    while waiting:
        row, column = waiting.popleft()
        for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            there = (row + dr) % walls.shape[0], (column + dc) % walls.shape[1]
            if not walls[there] and found[there] < 0:
                found[there] = found[row, column] + 1
                waiting.append(there)
    return found


def test_constraint():
    """F is the distance to the circle less the tube's radius, and its Jacobian that of finite differences."""
    constraint = torus_constraint(ball([-4] * 3, [4] * 3), "point")
    rng = np.random.default_rng(0)
    for q in rng.normal(size=(20, 3)) * 2:
        expected = np.hypot(np.hypot(q[0], q[1]) - MAJOR, q[2]) - MINOR
        assert constraint.value(q)[0] == pytest.approx(expected)
        np.testing.assert_allclose(constraint.jacobian(q), differences(constraint.value, q), atol=1e-6)
    with pytest.raises(ConstraintError, match="minor is 2 m, major 1 m"):
        torus_constraint(ball(), "point", 1, 2)


def test_pixels_and_points():
    """The point in the middle of every pixel is on the torus and has that pixel; a wall there is what is seen."""
    rng = np.random.default_rng(1)
    walls = rng.random((7, 11)) < 0.5
    maze, constraint = TorusMaze(walls), torus_constraint(ball([-4] * 3, [4] * 3), "point")
    for row in range(7):
        for column in range(11):
            q = maze.point(row + 0.5, column + 0.5)
            assert constraint.satisfied(q) and maze.pixel(q) == (row, column)
            assert maze.holds(q) != walls[row, column]


@pytest.mark.parametrize("seed", range(3))
def test_mazes_are_trees(seed):
    """Every bright pixel is reached, and as many walls are broken as there are cells less one."""
    walls = random_maze(np.random.default_rng(seed), 6, 9, corridor=3, wall=1)
    assert walls.shape == (24, 36)
    assert ((flooded(walls, (0, 0)) >= 0) == ~walls).all()
    assert (~walls).sum() == 6 * 9 * 9 + (6 * 9 - 1) * 3


def test_any_picture(tmp_path):
    """A picture in grey or colour comes back as its dark pixels; what is no picture, or all dark, is refused."""
    walls = random_maze(np.random.default_rng(3), 3, 4)
    for name, kind in (("grey.png", "gray"), ("colour.png", "bone")):
        imsave(tmp_path / name, (~walls).astype(float), cmap=kind)
        np.testing.assert_array_equal(read_maze(tmp_path / name).walls, walls)
    (tmp_path / "no.png").write_text("no picture")
    for path, message in ((tmp_path / "no.png", "cannot be read"), (tmp_path / "none.png", "cannot be read")):
        with pytest.raises(ProblemError, match=message):
            read_maze(path)
    with pytest.raises(ProblemError, match="no way through"):
        TorusMaze(np.ones((3, 3), bool))
    with pytest.raises(ConfigError, match=r"maze\.rows is 1"):
        random_maze(np.random.default_rng(0), 1, 4)
    with pytest.raises(ProblemError, match=r"goal .* is in a wall"):
        maze_problem(TorusMaze(walls), (0.5, 0.5), (3.5, 3.5))


@pytest.mark.parametrize("seed", range(3))
def test_plans_follow_the_corridors(seed):
    """A search goes from one cell of 24 to the farthest by flood fill; the path is bright everywhere."""
    walls = random_maze(np.random.default_rng(seed), 4, 6)
    far = flooded(walls, (1, 1))
    goal = np.unravel_index(int(far.argmax()), far.shape)
    maze = TorusMaze(walls)
    problem = maze_problem(maze, (1.5, 1.5), (goal[0] + 0.5, goal[1] + 0.5))
    space = ProjectionAdherence(problem.constraint, problem.validity, AdherenceParameters(refinement=0.005))
    asked = Problem(space, problem.start, problem.goal)
    result = RrtConnect(range=0.5, balanced=True).plan(asked, UniformSampler(), Termination(time_limit=60.0), seed)
    assert result.solved
    bounds = VerifierParameters(step=0.001, leap=0.2)
    verdict = verify(result.path, problem.start, problem.goal, problem.constraint, problem.validity, bounds)
    assert verdict.passed, verdict.message
    assert verdict.length > 0.5 * far.max() * 2 * np.pi * (MAJOR - MINOR) / walls.shape[1]
