"""YAML of problem files, read so that nothing of it is lost or converted in silence, and changed entry by entry."""

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import yaml

from pipeline.errors import ConfigError, ProblemError, unknown
from pipeline.files import read_text

_INTEGER = re.compile(r"[-+]?[0-9]+$")
_FLOAT = re.compile(
    r"([-+]?(\.[0-9]+|[0-9]+\.[0-9]*)([eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$"
)
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_MERGE = "tag:yaml.org,2002:merge"


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """Numbers are those of YAML 1.2 (010 is ten, 1e-3 a number, 1:30 none), and keys are words, each once."""

    yaml_implicit_resolvers = {  # noqa: RUF012 (PyYAML reads it from the class)
        first: [(tag, pattern) for tag, pattern in known if tag not in _NUMBERS]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if key.tag == _MERGE:  # what it brings may be replaced
                continue
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or key.tag != "tag:yaml.org,2002:str":
                said = key.value if isinstance(key, yaml.ScalarNode) else "a list or mapping"
                raise ProblemError(f"has the key {said} on line {line}, which YAML takes for no word: put it in quotes")
            if key.value in lines:
                raise ProblemError(f"has the key {key.value!r} twice, on lines {lines[key.value]} and {line}")
            lines[key.value] = line
        return super().construct_mapping(node, deep)


def _float(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float:
    return float(node.value.lower().replace(".inf", "inf").replace(".nan", "nan"))


_Loader.add_implicit_resolver(_NUMBERS[0], _INTEGER, list("-+0123456789"))
_Loader.add_implicit_resolver(_NUMBERS[1], _FLOAT, list("-+.0123456789"))
_Loader.add_constructor(_NUMBERS[0], lambda loader, node: int(node.value))
_Loader.add_constructor(_NUMBERS[1], _float)


def read_yaml(path: Path) -> Any:
    """Return what a file says.

    Raises:
        ProblemError: the file is missing or no YAML, or has a key twice or one that is no word, with the line.
    """
    try:
        return yaml.load(read_text(path), _Loader)
    except OSError as error:
        raise ProblemError(f"problem file {path} cannot be read: {error.strerror}") from None
    except ProblemError as error:
        raise ProblemError(f"problem file {path} {error}") from None
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ProblemError(f"problem file {path} is no YAML: {' '.join(str(error).split())}") from None


def merged(content: Mapping[str, Any], changes: Mapping[str, Any], kind: Any, where: str = "") -> dict[str, Any]:
    """Return the content of a file with entries changed: those of a mapping one by one, anything else as a whole.

    None or an empty text takes an entry out, as if the file left it out. A mapping that has a `kind` is another choice,
    and replaces the one that is there.

    Args:
        content: as read.
        changes: likewise, only of what changes.
        kind: the dataclass the content is for, which knows what may be left out.
        where: the key it stands under, for messages.

    Raises:
        ConfigError: an entry that is to be left out is none.
    """
    hints = get_type_hints(kind) if is_dataclass(kind) else {}
    known = [field.name for field in fields(kind)] if is_dataclass(kind) else list(content)
    found = dict(content)
    for key, value in changes.items():
        name = f"{where}.{key}".strip(".")
        if value is None or (isinstance(value, str) and not value):
            if key not in known:
                raise ConfigError(
                    unknown(f"{where or 'the problem'} has no entry to leave out that is called", key, known)
                )
            found.pop(key, None)
        elif isinstance(value, Mapping) and "kind" not in value:
            before = found.get(key)
            found[key] = merged(before if isinstance(before, Mapping) else {}, value, _inner(hints.get(key)), name)
        else:
            found[key] = value
    return found


def _inner(hint: Any) -> Any:
    """Return the dataclass of a type that may be None."""
    return next((kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)), None)
