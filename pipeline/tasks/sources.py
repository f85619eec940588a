"""The files that what is asked was read from, by names that are the same on every machine, with a hash of each.

Results follow from them as they follow from configuration and code. Files of this package are left out: keys of
resumable work hold all of it (`pipeline.keys.code_digest`).
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path

from pipeline.errors import ArtifactError
from pipeline.files import Stamp, stamps
from pipeline.keys import digest
from pipeline.robots.description import OWN, SHARE
from pipeline.spec.scene import Scene, read_scenes
from pipeline.spec.statement import Statement
from pipeline.tasks.build import robot_of

_PACKAGE = "package://"


def read_by(statement: Statement) -> set[Path]:
    """Return the files that a statement's robot, what it carries and its obstacles are read from.

    Raises:
        RobotError: the robot's files are missing or malformed.
    """
    bodies = (*statement.obstacles, *(carried.body for carried in statement.carried))
    return {Path(file) for file in (*robot_of(statement.robot).files, *(body.file for body in bodies)) if file}


def contents(files: Iterable[str | Path]) -> dict[str, str]:
    """Return a hash of each file's content by its name, sorted: `package://` where an installed package has it.

    Raises:
        ArtifactError: a file is missing.
    """
    share, ours = SHARE.resolve(), OWN.resolve().parents[1]
    found: dict[str, str] = {}
    for path in {Path(file).resolve() for file in files}:
        if not path.is_relative_to(ours):
            name = f"{_PACKAGE}{path.relative_to(share)}" if path.is_relative_to(share) else near(path)
            found[name] = _content(*stamps([path]))
    return dict(sorted(found.items()))


def current_scenes(folder: Path) -> dict[str, Scene]:
    """Read scenes back by name, where the files that they were made from are still the same.

    Raises:
        ArtifactError: see `read_scenes` and `check_sources`.
    """
    scenes = read_scenes(folder)
    check_sources(scenes.values())
    return scenes


def check_sources(scenes: Iterable[Scene]) -> None:
    """Refuse scenes whose files are not here as they were where the scenes were made.

    Raises:
        ArtifactError: names the scene and the file.
    """
    for scene in scenes:
        for name, found in contents(file for leg in scene.legs for file in read_by(leg)).items():
            if scene.sources.get(name, found) != found:
                raise ArtifactError(
                    f"scene {scene.name!r} was made from {name} with another content than it has here: run the "
                    "scenes stage again, or give this machine the same file"
                )


def installed(name: str) -> bool:
    """Tell whether a name that `contents` gives is that of an installed package's file."""
    return name.startswith(_PACKAGE)


def near(path: str | Path) -> str:
    """Return a path from the working folder where it is in it; the address of a package, or none, stays as it is."""
    if not str(path) or installed(str(path)):
        return str(path)
    whole, here = Path(path).resolve(), Path.cwd().resolve()
    return str(whole.relative_to(here) if whole.is_relative_to(here) else whole)


@cache  # many scenes are made from the same files
def _content(stamp: Stamp) -> str:
    return digest(Path(stamp[0]))
