"""Open files, written whole: a reader never sees half a file, and a foreign file is refused by name.

Every table, array file and JSON document carries a schema name and a version. Bytes depend on the content only.
"""

import fcntl
import glob
import hashlib
import json
import logging
import os
import shutil
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import ArtifactError

log = logging.getLogger(__name__)
VERSION = 1  # one version for all schemas; raised when any of them changes incompatibly


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that replaces it on success and vanishes on failure."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path` that replaces it on success and vanishes on failure.

    What processes that were killed have left there goes too.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):
        if not _runs(left.name.split(".")[-2]):
            shutil.rmtree(left, ignore_errors=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        yield temporary
        if path.exists():
            shutil.rmtree(path)
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def atomic_entries(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder whose entries replace those of the same name in `folder`; others there stay."""
    folder = Path(folder)
    with atomic_folder(folder / ".entries") as temporary:
        yield temporary
    for entry in sorted((folder / ".entries").iterdir()):
        target = folder / entry.name
        if target.is_dir():
            shutil.rmtree(target)
        os.replace(entry, target)
    (folder / ".entries").rmdir()


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Make `folder` and keep it to this process until the block ends; wait while another one has it.

    A stage may outlive the command that started it (only `dvc` was killed, say): a second one would repeat its work
    beside it. The lock dies with the process.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder.with_name(f".{folder.name}.lock"), "a+") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.seek(0)
            log.warning("waiting for process %s, which is at work in %s", stream.read() or "unknown", folder)
            fcntl.flock(stream, fcntl.LOCK_EX)
        stream.truncate(0)
        stream.write(str(os.getpid()))
        stream.flush()
        yield


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
    _require(path)
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
    _require(path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:  # numpy and zipfile raise half a dozen kinds here; all mean the same to a reader
        raise ArtifactError(f"{path} is not a readable npz file (truncated or foreign): {error}") from error
    _check(path, schema, str(arrays.pop("schema", "")), str(arrays.pop("version", "")))
    _complete(path, names, arrays)
    return arrays


def write_json(content: Mapping[str, Any], path: Path, schema: str | None = None) -> None:
    """Write a JSON document; with `schema`, its name and the version come first."""
    head = {} if schema is None else {"schema": schema, "version": VERSION}
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps({**head, **content}, indent=2) + "\n")


def read_json(path: Path, schema: str | None = None) -> dict[str, Any]:
    """Read a JSON document, and with `schema` check its name and version.

    Raises:
        ArtifactError: the file is missing, truncated, or holds another schema or version.
    """
    _require(path)
    try:
        content = json.loads(Path(path).read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ArtifactError(f"{path} is not readable JSON (truncated or foreign): {error}") from error
    if not isinstance(content, dict):
        raise ArtifactError(f"{path} holds a JSON {type(content).__name__}, expected an object")
    if schema is not None:
        _check(path, schema, str(content.pop("schema", "")), str(content.pop("version", "")))
    return content


def digest(*parts: Any) -> str:
    """Return a short hash of files (Path) and JSON-able values, the key of resumable work."""
    state = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path):
            _require(part)
            state.update(part.read_bytes())
        else:
            state.update(json.dumps(part, sort_keys=True, default=str).encode())
        state.update(b"\0")  # (1, 23) is not (12, 3)
    return state.hexdigest()[:16]


def _complete(path: Path, wanted: Collection[str], found: Collection[str]) -> None:
    missing = [name for name in wanted if name not in found]
    if missing:
        raise ArtifactError(f"{path} lacks {', '.join(missing)}; it has {', '.join(found)}")


def _runs(process: str) -> bool:
    """Tell whether a process of this number runs."""
    try:
        os.kill(int(process), 0)
    except (ValueError, ProcessLookupError):
        return False
    except PermissionError:  # it runs, as somebody else's
        pass
    return True


def _require(path: Path) -> None:
    if not Path(path).is_file():
        raise ArtifactError(f"{path} does not exist: run the stage that writes it (`dvc repro`)")


def _check(path: Path, expected: str, schema: str, version: str) -> None:
    if schema != expected:
        raise ArtifactError(f"{path} holds schema {schema or 'none'!r}, expected {expected!r}")
    if version != str(VERSION):
        raise ArtifactError(
            f"{path} has version {version or 'none'!r} of schema {expected!r}, this code reads {VERSION}"
        )


def code_digest() -> str:
    """Return a short hash of the sources of this package that are loaded: part of the key of resumable work."""
    names = sorted(name for name in sys.modules if name.split(".")[0] == "pipeline")
    files = [getattr(sys.modules[name], "__file__", None) for name in names]
    return digest(*(Path(file) for file in files if file))
