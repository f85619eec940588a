"""Statements as JSON: plain data in, the same plain data out, whatever is in between is refused by name."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from pipeline.errors import ArtifactError, PipelineError
from pipeline.robots.bodies import Geometry
from pipeline.robots.description import Movable
from pipeline.robots.obstacles import Obstacle, Shape
from pipeline.robots.placement import Placement
from pipeline.robots.urdf import UrdfRobot
from pipeline.spec import statement

_KIND, _ENUM, _ARRAY, _PAIRS, _NUMBER = "kind", "enum", "array", "pairs", "number"
_WORDS = {math.inf: "inf", -math.inf: "-inf"}  # JSON has no word for them
_CLASSES: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        *(UrdfRobot, Movable, Placement, Obstacle),
        *(statement.Point, statement.Carried, statement.Region, statement.ChainSpec, statement.Statement),
        *statement.Equation.__args__,
        *statement.Inequality.__args__,
    )
}
_ENUMS: dict[str, type[Enum]] = {kind.__name__: kind for kind in (Shape, Geometry)}


def encode(value: Any) -> Any:
    """Return a statement, or a part of one, as what JSON has words for; `decode` gives an equal one.

    Raises:
        TypeError: something that statements are not made of.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return {_NUMBER: _WORDS[value]} if math.isinf(value) else value
    if is_dataclass(value) and type(value).__name__ in _CLASSES:
        content = {field.name: encode(getattr(value, field.name)) for field in fields(value)}
        return {_KIND: type(value).__name__, **content}
    if isinstance(value, Enum):
        return {_ENUM: type(value).__name__, "value": value.value}
    if isinstance(value, np.ndarray):
        return {_ARRAY: value.tolist(), "type": str(value.dtype), "shape": list(value.shape)}
    if isinstance(value, Mapping):
        return {_PAIRS: [[encode(key), encode(item)] for key, item in value.items()]}
    if isinstance(value, list | tuple):
        return [encode(item) for item in value]
    raise TypeError(f"a statement holds no {type(value).__name__}")


def decode(value: Any, where: str = "a statement") -> Any:
    """Return what `encode` made JSON of; lists come back as tuples.

    Args:
        value: read from JSON.
        where: it stands, for messages.

    Raises:
        ArtifactError: a kind that is unknown, or numbers and names that fit none.
    """
    try:
        return _decoded(value)
    except (KeyError, TypeError, ValueError, AttributeError, PipelineError) as error:
        raise ArtifactError(f"{where} is none that can be read: {type(error).__name__}: {error}") from error


def _decoded(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_decoded(item) for item in value)
    if not isinstance(value, dict):
        return value
    if _KIND in value:
        content = {name: _decoded(item) for name, item in value.items() if name != _KIND}
        return _CLASSES[value[_KIND]](**content)
    if _ENUM in value:
        return _ENUMS[value[_ENUM]](value["value"])
    if _ARRAY in value:
        return np.array(value[_ARRAY], dtype=np.dtype(value["type"])).reshape(value["shape"])
    if _NUMBER in value:
        return float(value[_NUMBER])
    return {_decoded(key): _decoded(item) for key, item in value[_PAIRS]}
