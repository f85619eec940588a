"""Plain data to dataclasses, with messages that name the value, the key and the choices."""

import difflib
import types
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from pipeline.errors import ConfigError


@dataclass(frozen=True)
class Choice:
    """One of several classes by name, with its parameters: how a config group stands in a stage's configuration.

    Attributes:
        kind: name in a registry, for example "atlas".
        parameters: of the class the registry names.
        name: of the config file, where artifacts are kept apart by it.
    """

    kind: str
    parameters: dict[str, Any] = field(default_factory=dict)
    name: str = ""

    def make(self, registry: Mapping[str, Any], what: str) -> Any:
        """Return the dataclass that `registry` has under `kind`, made from the parameters.

        Raises:
            ConfigError: no such kind, or parameters that do not fit.
        """
        if self.kind not in registry:
            raise ConfigError(f"{what} is {self.kind!r}; choices: {', '.join(sorted(registry))}")
        return convert(self.parameters, registry[self.kind], what)


def convert(value: Any, kind: Any, where: str = "") -> Any:
    """Return plain data (mappings, lists, scalars) as an instance of `kind`.

    Args:
        value: as read from YAML or JSON.
        kind: a dataclass, Enum, scalar type, or list, tuple, dict and Optional of these.
        where: the key it stands under, for messages.

    Raises:
        ConfigError: a misspelt or missing key, a value of the wrong type or an unknown choice.
    """
    name = where or "the configuration"
    if kind is Any:
        return value
    if is_dataclass(kind):
        return _dataclass(value, kind, where)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        (only,) = [a for a in arguments if a is not type(None)]
        return convert(value, only, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{name} is {value!r}; it must be a mapping")
        return {str(key): convert(item, arguments[1], f"{where}.{key}".strip(".")) for key, item in value.items()}
    if origin in (tuple, list):
        if not isinstance(value, list | tuple):
            raise ConfigError(f"{name} is {value!r}; it must be a list")
        if origin is tuple and arguments[-1] is not Ellipsis and len(arguments) != len(value):
            raise ConfigError(f"{name} has {len(value)} items, expected {len(arguments)}")
        return origin(convert(item, arguments[0], f"{where}[{i}]") for i, item in enumerate(value))
    return _scalar(value, kind, name)


def _dataclass(value: Any, kind: Any, where: str) -> Any:
    name = where or "the configuration"
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} is {value!r}; it must be a mapping with the keys {_names(kind)}")
    known = {f.name: f for f in fields(kind)}
    for key in value:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, 1)
            hint = f"; did you mean {close[0]!r}?" if close else "."
            raise ConfigError(f"unknown key {str(key)!r} in {name}{hint} Valid keys: {_names(kind)}")
    hints = get_type_hints(kind)
    found = {key: convert(item, hints[key], f"{where}.{key}".strip(".")) for key, item in value.items()}
    missing = [n for n, f in known.items() if n not in found and f.default is MISSING and f.default_factory is MISSING]
    if missing:
        raise ConfigError(f"{name} lacks {', '.join(missing)}")
    return kind(**found)


def _scalar(value: Any, kind: Any, name: str) -> Any:
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            choices = ", ".join(str(member.value) for member in kind)
            raise ConfigError(f"{name} is {value!r}; choices: {choices}") from None
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is float and isinstance(value, str) and value in ("inf", "nan"):
        return float(value)
    if kind is Path and isinstance(value, str):
        return Path(value)
    if isinstance(kind, type) and isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    raise ConfigError(f"{name} is {value!r} ({type(value).__name__}); it must be of type {kind.__name__}")


def _names(kind: Any) -> str:
    return ", ".join(f.name for f in fields(kind))
