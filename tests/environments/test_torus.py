"""Mazes on a torus: pixels by hand, mazes that are trees, and plans that go where a flood fill of the picture goes."""

from collections import deque

import numpy as np
import pytest
from matplotlib.image import imsave

from pipeline.constraints.torus import MAJOR, MINOR, TorusMaze, torus_constraint
from pipeline.environments.torus import Mazes, maze_task, random_maze, read_maze
from pipeline.errors import ConfigError, ConstraintError, ProblemError
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.planners import DynamicDomainRrtConnect, Query, Termination
from pipeline.samplers import UniformSampler
from pipeline.tasks import Task, build
from pipeline.verification.judge import Judge
from tests.robots.worlds import ball, differences


def maze_of(task: Task) -> TorusMaze:
    """The condition of a maze's task."""
    (maze,) = task.conditions
    assert isinstance(maze, TorusMaze)
    return maze


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
        maze_task(TorusMaze(walls), (0.5, 0.5), (3.5, 3.5))


def test_margin_is_a_distance():
    """With a margin a point is refused exactly where a wall's pixel is nearer along rows and columns; not beyond it."""
    rng = np.random.default_rng(4)
    walls = rng.random((6, 9)) < 0.3
    maze = TorusMaze(walls)
    wide = maze.kept(0.3 * maze.pixel_size)
    for row, column in rng.uniform([0, 0], [6, 9], (400, 2)):
        q = maze.point(row, column)
        ring = MAJOR + MINOR * np.cos(2 * np.pi * row / 6)
        reach = [wide.margin / (2 * np.pi * MINOR / 6), wide.margin / (2 * np.pi * ring / 9)]  # in pixels
        rows = np.arange(np.floor(row - reach[0]), np.floor(row + reach[0]) + 1).astype(int) % 6
        columns = np.arange(np.floor(column - reach[1]), np.floor(column + reach[1]) + 1).astype(int) % 9
        assert wide.holds(q) == (not walls[np.ix_(rows, columns)].any())
    with pytest.raises(ConfigError, match=r"maze\.margin"):
        maze.kept(maze.pixel_size)


def test_farthest_places():
    """A family's goal is the farthest open place from its start by flood fill, both in the middle of a corridor."""
    task = build(Mazes(5, 7).task(3, 1).leg)
    maze = maze_of(task)
    start, goal = (maze.pixel(q) for q in (task.start, task.goal))
    far = flooded(maze.walls, start)
    middles = ~maze.walls
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        middles = middles & ~np.roll(maze.walls, shift, axis)
    assert middles[start] and middles[goal]
    assert far[goal] == far[middles].max()


def test_a_picture_is_a_family(tmp_path):
    """Tasks in a given picture have its walls and different starts."""
    walls = random_maze(np.random.default_rng(3), 4, 5)
    imsave(tmp_path / "maze.png", (~walls).astype(float), cmap="gray")
    tasks = [build(Mazes(picture=tmp_path / "maze.png").task(0, number).leg) for number in range(3)]
    assert all((maze_of(task).walls == walls).all() for task in tasks)
    assert len({maze_of(task).pixel(task.start) for task in tasks}) > 1


@pytest.mark.parametrize("seed", range(2))
def test_plans_follow_the_corridors(seed):
    """In a maze of 150 cells the path to the farthest place is bright everywhere and as long as the corridors ask."""
    task = build(Mazes(10, 15).task(11, seed).leg)
    maze = maze_of(task)
    margin = 0.25 * maze.pixel_size
    parameters = AdherenceParameters(step=0.06, resolution=2 * margin)
    space = ProjectionAdherence(task.constraint, task.validity(margin), parameters)
    planner = DynamicDomainRrtConnect(domain=0.42, spacing=0.105, node_states=1, balanced=True)
    asked = Query(space, task.start, task.goal)
    result = planner.plan(asked, UniformSampler(), Termination(max_iterations=100_000), seed)
    assert result.solved
    verdict = Judge(task.statement).verify(result.path, task.start, task.goal)
    assert verdict.passed, verdict.message
    far = flooded(maze.walls, maze.pixel(task.start))[maze.pixel(task.goal)]
    assert verdict.length > 0.5 * far * maze.pixel_size
