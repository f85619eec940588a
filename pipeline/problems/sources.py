"""The files that a problem reads besides its own, and statements that name them alike on every machine."""

from dataclasses import replace
from pathlib import Path

from pipeline.problems.file import CONF, ProblemFile
from pipeline.robots import Obstacle, UrdfRobot
from pipeline.robots.description import OWN, SHARE
from pipeline.spec.statement import Statement
from pipeline.tasks import hold


def read_by(file: ProblemFile, statement: Statement) -> list[Path]:
    """Return the files that a problem with this statement reads: the robot's, meshes and points, sorted.

    Those of installed packages are not among them: their versions tell whether they changed.
    """
    bodies = (*file.obstacles, *file.grasps)
    named = [file.folder / body.file for body in bodies if body.file]
    named += [CONF / "robot" / f"{file.robot}.yaml"] if isinstance(file.robot, str) else []
    found = {path.resolve() for path in (*named, *map(Path, hold(statement).robot.files))}
    installed = [place.resolve() for place in (SHARE, OWN)]
    return sorted(path for path in found if not any(path.is_relative_to(place) for place in installed))


def from_here(statement: Statement) -> Statement:
    """Return a statement that names files from the working folder where they are in it: the same wherever that is."""
    robot = statement.robot
    if isinstance(robot, UrdfRobot):
        folders = tuple(map(near, robot.package_dirs))
        robot = replace(robot, urdf=near(robot.urdf), srdf=near(robot.srdf), package_dirs=folders)
    carried = tuple(replace(one, body=_moved(one.body)) for one in statement.carried)
    return replace(statement, robot=robot, carried=carried, obstacles=tuple(map(_moved, statement.obstacles)))


def near(path: str | Path) -> str:
    """Return a path from the working folder where it is in it; the address of a package, or none, stays as it is."""
    if not str(path) or str(path).startswith("package://"):
        return str(path)
    whole, here = Path(path).resolve(), Path.cwd().resolve()
    return str(whole.relative_to(here) if whole.is_relative_to(here) else whole)


def _moved(body: Obstacle) -> Obstacle:
    return replace(body, file=near(body.file))
