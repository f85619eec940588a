"""A problem with nothing left to defaults, written so that it stands for itself."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.manifolds import ADHERENCES
from pipeline.planners import PLANNERS
from pipeline.problems.build import robot_settings
from pipeline.problems.file import ProblemFile, choice
from pipeline.robots import ROBOTS
from pipeline.robots.description import resolve
from pipeline.samplers.uniform import UniformParameters

_CHOICES: dict[str, Any] = {
    "robot": ROBOTS,
    "planner": PLANNERS,
    "sampler": {"uniform": UniformParameters},
    "adherence": ADHERENCES,
}


def resolved(file: ProblemFile) -> dict[str, Any]:
    """Return a problem as plain data that `read_problem` takes for the same problem.

    What the file leaves to defaults is there by value, and so is the content of the files of conf/ that it names.
    Files beside it stay named as it names them. What is null is taken from the start, or free (docs/problems.md).

    Raises:
        ConfigError: see `ProblemFile.parts` and `choice`.
    """
    found = _plain({entry.name: getattr(file, entry.name) for entry in fields(file) if entry.name != "folder"})
    for group, registry in _CHOICES.items():
        chosen = choice(getattr(file, group), group)
        found[group] = {"kind": chosen.kind, "parameters": _plain(chosen.make(registry, group))}
    kinds = [entry["kind"] for entry in file.constraints]
    found["constraints"] = [{"kind": kind, **_plain(part)} for kind, part in zip(kinds, file.parts(), strict=True)]
    whole: dict[str, Any] = _framed(found, found["robot"]["parameters"]["tool"])
    return whole


def documents(file: ProblemFile) -> dict[str, bytes]:
    """Return name -> content of what a problem was planned from: `problem.yaml`, and the robot's URDF and SRDF.

    Raises:
        ConfigError, RobotError: whatever does not fit, or is no longer there.
    """
    text = yaml.safe_dump(resolved(file), sort_keys=False, allow_unicode=True, default_flow_style=None)
    settings = robot_settings(file)
    named = {"robot.urdf": settings.urdf, "robot.srdf": settings.srdf}
    paths = {name: resolve(address, settings.package_dirs) for name, address in named.items() if address}
    return {"problem.yaml": text.encode(), **{name: path.read_bytes() for name, path in paths.items()}}


def _plain(value: Any) -> Any:
    """Dataclasses, enumerations, tuples and numbers of numpy's as what YAML has words for."""
    if is_dataclass(value):
        return {entry.name: _plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    return str(value) if isinstance(value, Path) else value


def _framed(value: Any, tool: str) -> Any:
    """Every frame that is left out is the tool; a start or goal by joints is of no frame."""
    if isinstance(value, dict):
        of_none = {"pose", "region"} <= value.keys() and value["pose"] is None and value["region"] is None
        return {k: tool if k == "frame" and v == "" and not of_none else _framed(v, tool) for k, v in value.items()}
    return [_framed(item, tool) for item in value] if isinstance(value, list) else value
