"""An environment whose scenes and tasks are a user's own: problem files in a folder."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError, PipelineError, ProblemError, require, require_name
from pipeline.keys import digest
from pipeline.problems import ProblemFile, read_problem
from pipeline.problems.build import build, sound, statement_of
from pipeline.problems.sources import from_here, read_by_problem
from pipeline.spec.scene import Scene, Split, task_rows
from pipeline.spec.statement import Statement
from pipeline.tasks import hold
from pipeline.tasks.sources import contents, installed, near
from pipeline.verification.judge import Judge

_UNTIMED = 1e9  # [s] inverse kinematics ends by tries, not by the clock: same files, same bytes


@dataclass(frozen=True)
class FolderEnvironment:
    """See docs/own_robot.md.

    Every file `<folder>/<split>/*.yaml` is a task, whatever the numbers of a profile. Files of a split whose statements
    are equal are tasks of one scene, which is named after the first of them. What a file says of how to plan (margins,
    planner, time limit) is for planning it alone: the pipeline has that from conf/.

    Attributes:
        name: of the environment and of its only scenario.
        folder: with problem files (see `ProblemFile`) in `train`, `validation` and `test`.
        margin, self_margin: see `Environment`.
        files: files and folders outside of `folder` that problems read: descriptions of robots, meshes. Stages run
            again when one of them, or `folder`, changes.
    """

    name: str
    folder: Path
    margin: float
    self_margin: float
    files: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        for name in ("margin", "self_margin"):
            require(f"environment.{name}", getattr(self, name), at_least=0)

    def scenes(self, counts: dict[Split, int]) -> list[Scene]:
        """Return the scenes of all files; `counts` change nothing.

        Raises:
            ConfigError: a split has no file, or a file reads another one that DVC would not see change,
                or its name is none that scenes can have.
            ProblemError: a file that is no problem, or of another robot than the first; the message names it.
        """
        del counts
        return [scene for scene, _ in self._found.values()]

    def tasks(self, scene: Scene, count: int) -> pd.DataFrame:
        """Return a task for each file of a scene, from its first start to the nearest goal; `count` changes nothing.

        Raises:
            ProblemError: a file has no start or goal that may be planned for; the message names it.
        """
        del count
        judge = Judge(scene.statement)
        return task_rows(scene, [self._ends(path, judge) for path in self._found[scene.name][1]])

    @cached_property
    def _found(self) -> dict[str, tuple[Scene, tuple[Path, ...]]]:
        """Scenes by name, each with its files."""
        found: dict[str, tuple[Scene, tuple[Path, ...]]] = {}
        names: dict[tuple[Split, str], str] = {}
        first: tuple[Path, Statement] | None = None
        for split in Split:
            for path in self._paths(split):
                require_name(f"the name of problem file {path}", path.stem)
                file, statement = self._asked(path)
                first = first or (path, statement)
                _check_alike(path, statement, *first)
                name = names.setdefault((split, digest(statement)), f"{split.value}-{path.stem}")
                scene, before = found.get(name, (Scene(self.name, name, split, (statement,)), ()))
                sources = {**scene.sources, **self._sources(path, file, statement)}
                found[name] = replace(scene, sources=sources), (*before, path)
        return found

    def _paths(self, split: Split) -> list[Path]:
        place = self.folder / split.value
        found = sorted(path for path in place.glob("*.yaml") if not path.name.startswith("."))
        if not found:
            every = ", ".join(str(self.folder / each.value) for each in Split)
            raise ConfigError(f"{place} holds no problem file (*.yaml); each of {every} needs one at least")
        return found

    def _asked(self, path: Path) -> tuple[ProblemFile, Statement]:
        try:
            file = self._file(path)
            statement = from_here(statement_of(file))
            hold(statement)
            for body in statement.obstacles:  # their meshes may be missing
                body.body_shape()
        except PipelineError as error:
            raise _named(path, error) from error
        return file, statement

    def _file(self, path: Path) -> ProblemFile:
        return read_problem(path, margin=self.margin, self_margin=self.self_margin, time_limit=_UNTIMED)

    def _sources(self, path: Path, file: ProblemFile, statement: Statement) -> dict[str, str]:
        """Return `Scene.sources` of a problem: its file, without comments, and what it reads."""
        found = contents(read_by_problem(file, statement))
        allowed = [place.resolve() for place in (self.folder, *self.files)]
        for name in found:
            if not installed(name) and not any(Path(name).resolve().is_relative_to(place) for place in allowed):
                raise ConfigError(
                    f"problem file {path} reads {name}, which is not in {self.folder}: name it in "
                    "environment.parameters.files, so that stages run again when it changes"
                )
        return {near(path): digest(replace(file, folder=Path())), **found}

    def _ends(self, path: Path, judge: Judge) -> tuple[np.ndarray, np.ndarray]:
        try:
            built = build(self._file(path))
            start, goal = sound(judge, built.starts, "start")[0], sound(judge, built.goals, "goal")[0]
            for q, name in ((start, "start"), (goal, "goal")):
                if not built.validity.free(q):  # joints that a file gives are looked at for the first time
                    raise ProblemError(f"{name} is {built.validity.reason(q)}")
        except PipelineError as error:
            raise _named(path, error) from error
        return start, goal


def _check_alike(path: Path, statement: Statement, first: Path, of_first: Statement) -> None:
    """Refuse a problem of another robot than the first's: one network learns from all."""
    for what, its, firsts in (
        ("robot", statement.robot, of_first.robot),
        ("list of variables", hold(statement).robot.joint_names, hold(of_first).robot.joint_names),
    ):
        if its != firsts:
            raise ProblemError(
                f"problem file {path} has another {what} than {first}, and an environment has one: {its}, not {firsts}"
            )


def _named(path: Path, error: PipelineError) -> ProblemError:
    return ProblemError(str(error) if str(path) in str(error) else f"problem file {path}: {error}")
