"""Open files, written whole: a reader never sees half a file, and a foreign file is refused by name.

Every table, array file and JSON document carries a schema name and a version. Bytes depend on the content only.
"""

import errno
import json
import math
import os
import stat
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.atomic import atomic_file, recover
from pipeline.errors import ArtifactError

VERSION = 1  # one version for all schemas; raised when any of them changes incompatibly


def write_table(frame: pd.DataFrame, path: Path, schema: str) -> None:
    """Write `frame` as parquet with its schema name and version in the file's metadata."""
    table = pa.Table.from_pandas(frame, preserve_index=False)
    table = table.replace_schema_metadata({b"schema": schema.encode(), b"version": str(VERSION).encode()})
    with atomic_file(path) as temporary:
        pq.write_table(table, temporary)


def read_table(path: Path, schema: str, columns: Collection[str] = ()) -> pd.DataFrame:
    """Read a parquet table of the named schema that has at least these columns.

    Raises:
        ArtifactError: the file is missing, truncated, holds another schema or version, or lacks columns.
    """
    require_file(path)
    try:
        table = pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise ArtifactError(f"{path} is not a readable parquet file (truncated or foreign): {error}") from error
    metadata = table.schema.metadata or {}
    _check(path, schema, metadata.get(b"schema", b"").decode(), metadata.get(b"version", b"").decode())
    _complete(path, columns, table.column_names)
    return table.to_pandas()


def write_arrays(arrays: Mapping[str, np.ndarray], path: Path, schema: str) -> None:
    """Write named arrays as one compressed npz with its schema name and version inside."""
    taken = sorted({"schema", "version"} & set(arrays))
    if taken:
        raise ArtifactError(f"{path}: arrays may not be called {taken}, these names are the header's")
    with atomic_file(path) as temporary, open(temporary, "wb") as stream:
        content: dict[str, Any] = {"schema": np.array(schema), "version": np.array(VERSION), **arrays}
        np.savez_compressed(stream, **content)


def read_arrays(path: Path, schema: str, names: Collection[str] = ()) -> dict[str, np.ndarray]:
    """Read the arrays of an npz file of the named schema that has at least these.

    Raises:
        ArtifactError: the file is missing, truncated, holds another schema or version, or lacks arrays.
    """
    require_file(path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:  # numpy and zipfile raise half a dozen kinds here; all mean the same to a reader
        raise ArtifactError(f"{path} is not a readable npz file (truncated or foreign): {error}") from error
    _check(path, schema, str(arrays.pop("schema", "")), str(arrays.pop("version", "")))
    _complete(path, names, arrays)
    return arrays


def write_json(content: Mapping[str, Any], path: Path, schema: str | None = None) -> None:
    """Write a JSON document; with `schema`, its name and the version come first.

    JSON has no word for what is not finite: NaN and infinities become null.
    """
    head = {} if schema is None else {"schema": schema, "version": VERSION}
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(finite({**head, **content}), indent=2, allow_nan=False) + "\n")


def read_json(path: Path, schema: str | None = None) -> dict[str, Any]:
    """Read a JSON document, and with `schema` check its name and version.

    Raises:
        ArtifactError: the file is missing, truncated, or holds another schema or version.
    """
    require_file(path)
    try:
        content = json.loads(Path(path).read_text(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError, OSError) as error:  # ValueError: of the syntax, the encoding, numbers too long
        raise ArtifactError(f"{path} is not readable JSON (truncated or foreign): {error}") from error
    if not isinstance(content, dict):
        raise ArtifactError(f"{path} holds a JSON {type(content).__name__}, expected an object")
    if schema is not None:
        _check(path, schema, str(content.pop("schema", "")), str(content.pop("version", "")))
    return content


def require_file(path: Path) -> None:
    """Refuse a path that is no ordinary file: a device or a pipe could be read without end.

    Raises:
        ArtifactError: there is no such file.
    """
    path = Path(path)
    if not path.is_file():
        recover(path.parent)
    if not path.is_file():
        raise ArtifactError(f"{path} does not exist: run the stage that writes it (`make repro`, its PROFILE)")


def read_text(path: Path) -> str:
    """Return the text (UTF-8) of an ordinary file: of a device or a pipe there might be no end.

    Raises:
        OSError: no such file, no ordinary one, or the system does not let us read it.
    """
    check_ordinary(path)
    return Path(path).read_text(encoding="utf-8")


def check_ordinary(path: Path) -> None:
    """Refuse what is no ordinary file, before it is opened.

    Raises:
        OSError: no such file, or a folder, device, pipe or socket.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, "it is a folder, device, pipe or socket", str(path))


# A file's path, when it was changed [ns] and its size tell whether it is still the one that was read.
Stamp = tuple[str, int, int]


def stamps(files: Iterable[str | Path]) -> tuple[Stamp, ...]:
    """Return what tells whether files were changed since; one that is missing has size -1."""
    return tuple(map(_stamp, map(str, files)))


def unchanged(before: Iterable[Stamp]) -> bool:
    """Tell whether files are as they were when these stamps were taken."""
    return all(_stamp(stamp[0]) == stamp for stamp in before)


def _stamp(file: str) -> Stamp:
    try:
        about = os.stat(file)
    except OSError:
        return file, 0, -1
    return file, about.st_mtime_ns, about.st_size


def finite(value: Any) -> Any:
    """Return data for JSON, with None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word} is no JSON")


def _complete(path: Path, wanted: Collection[str], found: Collection[str]) -> None:
    missing = [name for name in wanted if name not in found]
    if missing:
        raise ArtifactError(f"{path} lacks {', '.join(missing)}; it has {', '.join(found)}")


def _check(path: Path, expected: str, schema: str, version: str) -> None:
    if schema != expected:
        raise ArtifactError(f"{path} holds schema {schema or 'none'!r}, expected {expected!r}")
    if version != str(VERSION):
        raise ArtifactError(
            f"{path} has version {version or 'none'!r} of schema {expected!r}, this code reads {VERSION}"
        )
