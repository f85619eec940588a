"""The files that a problem reads besides its own, and statements that name them alike on every machine."""

from dataclasses import replace
from pathlib import Path

from pipeline.problems.file import CONF, ProblemFile
from pipeline.robots import Obstacle, UrdfRobot
from pipeline.spec.statement import Statement
from pipeline.tasks.sources import near, read_by


def read_by_problem(file: ProblemFile, statement: Statement) -> set[Path]:
    """Return the files that a problem with this statement reads besides its own: the robot's, meshes and points."""
    bodies = (*file.obstacles, *file.grasps)
    named = [file.folder / body.file for body in bodies if body.file]
    named += [CONF / "robot" / f"{file.robot}.yaml"] if isinstance(file.robot, str) else []
    return {*named, *read_by(statement)}


def from_here(statement: Statement) -> Statement:
    """Return a statement that names files from the working folder where they are in it: the same wherever that is."""
    robot = statement.robot
    if isinstance(robot, UrdfRobot):
        folders = tuple(map(near, robot.package_dirs))
        robot = replace(robot, urdf=near(robot.urdf), srdf=near(robot.srdf), package_dirs=folders)
    carried = tuple(replace(one, body=_moved(one.body)) for one in statement.carried)
    return replace(statement, robot=robot, carried=carried, obstacles=tuple(map(_moved, statement.obstacles)))


def _moved(body: Obstacle) -> Obstacle:
    return replace(body, file=near(body.file))
