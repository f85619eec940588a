"""Keys of resumable work: short hashes of everything its outcome follows from."""

import ast
import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files import require_file

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGE = "pipeline"
# Distributions whose modules have another name. `importlib.metadata` knows them too, but for those that pin's wheel
# keeps in a folder of its own, and takes half a second.
_DISTRIBUTIONS = {
    "google": "protobuf",
    "hydra": "hydra-core",
    "mcap_protobuf": "mcap-protobuf-support",
    "mpl_toolkits": "matplotlib",
    "pinocchio": "pin",
    "yaml": "pyyaml",
}
_MOVES = "distributed"  # it moves work and results and changes none; whoever installs it keeps finished shards


def digest(*parts: Any) -> str:
    """Return a short hash of the content of files (Path) and of plain data.

    Plain data are mappings, sequences, sets, dataclasses, enums, scalars, paths (by name where they stand inside other
    data) and arrays, which count by type, shape and every one of their bytes.

    Raises:
        ArtifactError: a file is missing.
        TypeError: a part is something else, whose text may say too little to tell two of them apart.
    """
    state = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path):
            require_file(part)
            state.update(part.read_bytes())
        else:
            state.update(json.dumps(_plain(part)).encode())
        state.update(b"\0")  # (1, 23) is not (12, 3)
    return state.hexdigest()[:16]


def code_digest(*scripts: Path, root: Path = _ROOT) -> str:
    """Return a short hash of what scripts run: their code, that of our modules they import, versions of packages.

    Comments, docstrings and the layout of the text do not count, as they change no result. Data files of our package
    count, Python's version does, and so do the packages that are imported anywhere with all they require themselves.

    Args:
        scripts: files of ours, such as a stage's own.
        root: the folder that holds our package.
    """
    sources = _closure(scripts, root)
    data = {name: found for name, found in package_files(root).items() if not name.endswith(".py")}
    return digest(
        {name: source.code for name, source in sources.items()},
        data,
        package_versions(_modules(sources) - {_MOVES}),
        platform.python_version(),
    )


def package_files(root: Path = _ROOT) -> dict[str, str]:
    """Return a hash of the bytes of every file of our package, by its name relative to `root`."""
    files = [path for path in sorted((root / _PACKAGE).rglob("*")) if path.is_file() and not _ignored(path)]
    return {_name(path, root): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def loaded_packages() -> list[str]:
    """Return the packages that the modules of ours in this process may import, with all that these require."""
    ours = [module for name, module in sys.modules.items() if name.partition(".")[0] == _PACKAGE]
    files = [Path(file) for module in ours if (file := getattr(module, "__file__", None))]
    return list(package_versions(_modules(_closure(files, _ROOT))))


def imported_files(scripts: Iterable[Path], root: Path = _ROOT) -> list[str]:
    """Return scripts and the files of our package that they import, directly or not, relative to `root`, sorted."""
    return sorted(_closure(scripts, root))


def package_versions(modules: Iterable[str]) -> dict[str, str]:
    """Return the versions of the packages that hold top-level modules, and of all that these require.

    "none" where one is not installed.
    """
    found: dict[str, str] = {}
    waiting = [_DISTRIBUTIONS.get(module, module) for module in modules]
    while waiting:
        name = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        if name in found:
            continue
        try:
            installed = distribution(name)
        except PackageNotFoundError:  # optional, or for other systems
            found[name] = "none"
            continue
        found[name] = installed.version
        asked = [line for line in installed.requires or () if "extra ==" not in line]
        waiting += [match.group() for line in asked if (match := re.match(r"[\w.-]+", line))]
    return dict(sorted(found.items()))


def _modules(sources: Mapping[str, "_Source"]) -> set[str]:
    """Return the top-level modules of other packages that sources import."""
    names = {name.partition(".")[0] for source in sources.values() for name in source.imports}
    return names - set(sys.stdlib_module_names) - {_PACKAGE}


def _plain(value: Any) -> Any:
    """Return what JSON can say of a value without leaving anything out; different values give different texts."""
    if isinstance(value, Enum):
        return {"enum": [type(value).__qualname__, value.name]}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, np.ndarray):
        content = value.tolist() if value.dtype.hasobject else hashlib.sha256(value.tobytes()).hexdigest()
        return {"array": [value.dtype.str, list(value.shape), _plain(content)]}
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if isinstance(value, Path):
        return {"path": str(value)}
    if isinstance(value, Mapping):
        pairs = [[_plain(key), _plain(item)] for key, item in value.items()]
        return {"mapping": sorted(pairs, key=json.dumps)}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return {"set": sorted((_plain(item) for item in value), key=json.dumps)}
    if is_dataclass(value) and not isinstance(value, type):
        content = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {"dataclass": [type(value).__qualname__, content]}
    raise TypeError(f"a {type(value).__name__} cannot be part of a key: {value!r}")


def _closure(scripts: Iterable[Path], root: Path) -> dict[str, "_Source"]:
    """Return the scripts and every file of our package that they import, directly or not, by name."""
    found, waiting = dict[Path, _Source](), [Path(script).resolve() for script in scripts]
    while waiting:
        file = waiting.pop()
        if file in found:
            continue
        found[file] = _source(file.read_text(encoding="utf-8"))
        for parts in (name.split(".") for name in found[file].imports):
            # Importing a module runs the packages it is in.
            places = [root.joinpath(*parts[:length]) for length in range(1, len(parts) + 1)]
            for place in places if parts[0] == _PACKAGE else ():
                waiting += [path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()]
    return {_name(file, root): found[file] for file in sorted(found)}


@dataclass(frozen=True)
class _Source:
    """What counts of a file of Python.

    Attributes:
        code: hash of its syntax tree without docstrings.
        imports: names it imports anywhere, with what it takes from modules ("numpy.linalg.norm").
    """

    code: str
    imports: frozenset[str]


@cache
def _source(text: str) -> _Source:
    tree, imports = ast.parse(text), set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and _described(node):
            node.body = node.body[1:]
    return _Source(hashlib.sha256(ast.dump(tree).encode()).hexdigest(), frozenset(imports))


def _described(node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Tell whether a definition begins with a docstring."""
    first = node.body[0] if node.body else None
    return isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)


def _ignored(path: Path) -> bool:
    return path.suffix == ".pyc" or any(part.startswith(".") for part in path.parts[-2:])


def _name(path: Path, root: Path) -> str:
    return str(path.relative_to(root)) if path.is_relative_to(root) else path.name
