"""Plain data to dataclasses, with messages that name the value, the key and the choices."""

import difflib
import types
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from pipeline.errors import ConfigError, shown

_LARGEST = 2**63  # of whole numbers: what numpy and compiled code take


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
        kind: a dataclass, Enum, scalar type, or a list, tuple, dict or union of these. Of a union the first type that
            takes the value makes it, after those whose very instance it is.
        where: the key it stands under, for messages.

    Raises:
        ConfigError: a misspelt or missing key, a value of the wrong type or an unknown choice.
    """
    name = where or "the configuration"
    if kind is Any:
        return _free(value, name, [])
    if is_dataclass(kind):
        return _dataclass(value, kind, where)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _one_of(value, arguments, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{name} is {shown(value)}; it must be a mapping")
        return {
            _key(key, arguments[0], name): convert(item, arguments[1], f"{where}.{key}".strip("."))
            for key, item in value.items()
        }
    if origin in (tuple, list):
        if not isinstance(value, list | tuple):
            raise ConfigError(f"{name} is {shown(value)}; it must be a list")
        kinds = (arguments[0],) * len(value) if origin is list or arguments[1:] == (Ellipsis,) else arguments
        if len(kinds) != len(value):
            raise ConfigError(f"{name} has {len(value)} items, expected {len(kinds)}")
        each = enumerate(zip(value, kinds, strict=True))
        return origin(convert(item, its, f"{where}[{i}]") for i, (item, its) in each)
    return _scalar(value, kind, name)


def _key(key: Any, kind: Any, name: str) -> Any:
    """Convert a key; YAML reads a name such as 7 as a number."""
    return convert(str(key) if kind is str and type(key) is int else key, kind, f"a key of {name}")


def _one_of(value: Any, kinds: tuple[Any, ...], where: str) -> Any:
    """Convert to the first of several types that takes the value, after those whose very instance it is."""
    if value is None and type(None) in kinds:
        return None
    others = [kind for kind in kinds if kind is not type(None)]
    if len(others) == 1:
        return convert(value, others[0], where)
    refused = []
    for kind in sorted(others, key=lambda kind: type(value) is not kind):
        try:
            return convert(value, kind, where)
        except ConfigError as error:
            refused.append(str(error))
    raise ConfigError(
        f"{where or 'the configuration'} is {shown(value)}, which none of its types takes: {'; '.join(refused)}"
    )


def _free(value: Any, name: str, around: list[Any]) -> Any:
    """Return data of any form as it is; refuse numbers that nothing can reckon with, and lists that hold themselves."""
    if any(value is outer for outer in around):
        raise ConfigError(f"{name} holds itself")
    if isinstance(value, Mapping):
        return {key: _free(item, f"{name}.{key}", [*around, value]) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_free(item, f"{name}[{i}]", [*around, value]) for i, item in enumerate(value))
    return _bounded(value, name) if isinstance(value, int) else value


def _bounded(value: int, name: str) -> int:
    if not -_LARGEST <= value < _LARGEST:
        raise ConfigError(f"{name} is a number of {len(str(abs(value)))} digits; whole numbers have at most 64 bits")
    return value


def _dataclass(value: Any, kind: Any, where: str) -> Any:
    name = where or "the configuration"
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} is {shown(value)}; it must be a mapping with the keys {_names(kind)}")
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
            raise ConfigError(f"{name} is {shown(value)}; choices: {choices}") from None
    if isinstance(value, int) and not isinstance(value, bool):
        value = _bounded(value, name)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is float and isinstance(value, str) and value in ("inf", "nan"):
        return float(value)
    if kind is Path and isinstance(value, str):
        return Path(value)
    if isinstance(kind, type) and isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    raise ConfigError(f"{name} is {shown(value)} ({type(value).__name__}); it must be of type {kind.__name__}")


def _names(kind: Any) -> str:
    """Return the keys that a file may have; a field that is marked hidden is filled in by code."""
    return ", ".join(f.name for f in fields(kind) if not f.metadata.get("hidden"))
