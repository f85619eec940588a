"""Files are written whole or not at all; what is truncated, foreign or of another version is refused by name."""

import errno
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.atomic import atomic_folder
from pipeline.errors import ArtifactError
from pipeline.files import (
    VERSION,
    read_arrays,
    read_json,
    read_table,
    read_text,
    write_arrays,
    write_json,
    write_table,
)

FRAME = pd.DataFrame({"scene": [0, 1], "cost": [0.1, np.pi], "name": ["a", "ß"], "q": [[0.1, 1 / 3], [2.0, -0.0]]})
ARRAYS = {"voxels": np.arange(24).reshape(2, 3, 4) % 3 == 0, "path": np.random.default_rng(0).normal(size=(5, 3))}
CONTENT = {"b": [1, 0.1, None], "a": {"nested": "ü"}}
KINDS = {
    "parquet": (write_table, read_table, FRAME),
    "npz": (write_arrays, read_arrays, ARRAYS),
    "json": (write_json, read_json, CONTENT),
}


def refusal(path, *said: str):
    """A context in which an ArtifactError must name the file and say every one of `said`."""
    return pytest.raises(ArtifactError, match=re.escape(str(path)) + "".join(f".*{re.escape(word)}" for word in said))


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param, *KINDS[request.param]


def test_table_round_trip(tmp_path):
    """A table comes back with its columns, numbers, text and lists of numbers equal to the last bit."""
    write_table(FRAME, tmp_path / "new" / "folder" / "t.parquet", "trials")
    found = read_table(tmp_path / "new" / "folder" / "t.parquet", "trials")
    assert list(found.columns) == list(FRAME.columns)
    for column in ("scene", "cost", "name"):
        assert found[column].tolist() == FRAME[column].tolist()
    assert [np.asarray(q).tobytes() for q in found["q"]] == [np.asarray(q).tobytes() for q in FRAME["q"]]


def test_arrays_round_trip(tmp_path):
    """Arrays come back with their names, types, shapes and bits, and without the two that say what they are."""
    write_arrays(ARRAYS, tmp_path / "a.npz", "voxels")
    found = read_arrays(tmp_path / "a.npz", "voxels")
    assert sorted(found) == sorted(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_json_round_trip(tmp_path):
    """A document comes back equal, in its order, with the schema first in the file and no longer in the content."""
    write_json(CONTENT, tmp_path / "m.json", "metrics")
    assert list(json.loads((tmp_path / "m.json").read_text())) == ["schema", "version", "b", "a"]
    assert list(read_json(tmp_path / "m.json", "metrics").items()) == list(CONTENT.items())
    write_json(CONTENT, tmp_path / "bare.json")
    assert json.loads((tmp_path / "bare.json").read_text()) == read_json(tmp_path / "bare.json") == CONTENT


def test_same_content_gives_same_bytes(kind, tmp_path):
    """Writing equal content twice, under other names and over an older file, gives equal bytes."""
    _, write, _, content = kind
    (tmp_path / "two").write_text("older")
    write(content, tmp_path / "one", "schema")
    write(content, tmp_path / "two", "schema")
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    write(content, tmp_path / "three", "other")
    assert (tmp_path / "one").read_bytes() != (tmp_path / "three").read_bytes()


def test_truncation_is_found_at_every_length(kind, tmp_path):
    """A file cut off anywhere is refused by name and never read as less."""
    suffix, write, read, content = kind
    path = tmp_path / f"cut.{suffix}"
    write(content, path, "schema")
    whole = path.read_bytes()
    for length in (
        *range(0, len(whole) - 2, 13),
        len(whole) - 2,
    ):  # without its last character JSON lacks a newline only
        path.write_bytes(whole[:length])
        with refusal(path, "not", "readable", "truncated or foreign"):
            read(path, "schema")


def test_foreign_bytes_are_refused(kind, tmp_path):
    """A file of another kind under the name is refused by name, its schema unread."""
    suffix, _, read, _ = kind
    path = tmp_path / f"foreign.{suffix}"
    for written in (b"\x89PNG\r\n\x1a\n" + bytes(100), "scene;cost\n0;ü".encode("latin-1"), b"\x80\x04N."):
        path.write_bytes(written)
        with refusal(path, "not", "readable", "truncated or foreign"):
            read(path, "schema")


def test_one_array_file_is_not_an_archive(tmp_path):
    """A plain npy file and an archive of pickled objects are refused as arrays."""
    np.save(tmp_path / "plain.npy", np.arange(3))
    np.savez(tmp_path / "pickled.npz", schema=np.array("s"), version=np.array(VERSION), x=np.array([{}], dtype=object))
    for name in ("plain.npy", "pickled.npz"):
        with refusal(tmp_path / name, "not a readable npz"):
            read_arrays(tmp_path / name, "s")


def test_json_that_is_no_object_is_refused(tmp_path):
    """A JSON list is refused with what it is and what was expected, with a schema asked for or not."""
    (tmp_path / "list.json").write_text("[1, 2]")
    for schema in (None, "metrics"):
        with refusal(tmp_path / "list.json", "JSON list", "expected an object"):
            read_json(tmp_path / "list.json", schema)


def test_other_schema_is_refused(kind, tmp_path):
    """A file of another schema is refused with its own and the expected schema."""
    _, write, read, content = kind
    write(content, tmp_path / "file", "problems")
    with refusal(tmp_path / "file", "'problems'", "expected 'scenes'"):
        read(tmp_path / "file", "scenes")


def test_file_without_schema_is_refused(tmp_path):
    """Files that other programs wrote, sound but without a schema, are refused as holding none."""
    pq.write_table(pa.table({"x": [1]}), tmp_path / "t.parquet")
    np.savez(tmp_path / "a.npz", x=np.arange(3))
    (tmp_path / "j.json").write_text('{"x": 1}')
    for read, name in ((read_table, "t.parquet"), (read_arrays, "a.npz"), (read_json, "j.json")):
        with refusal(tmp_path / name, "schema 'none'", "expected 'scenes'"):
            read(tmp_path / name, "scenes")


@pytest.mark.parametrize("version", [VERSION + 1, "", "1.0"])
def test_other_version_is_refused(version, tmp_path):
    """A file of the right schema in another version is refused with its version and the one that is read."""
    table = pa.table({"x": [1]}).replace_schema_metadata({"schema": "s", "version": str(version)})
    pq.write_table(table, tmp_path / "t.parquet")
    np.savez(tmp_path / "a.npz", schema=np.array("s"), version=np.array(version), x=np.arange(3))
    (tmp_path / "j.json").write_text(json.dumps({"schema": "s", "version": version}))
    for read, name in ((read_table, "t.parquet"), (read_arrays, "a.npz"), (read_json, "j.json")):
        with refusal(tmp_path / name, f"version {str(version) or 'none'!r}", "'s'", f"reads {VERSION}"):
            read(tmp_path / name, "s")


def test_missing_file_says_what_to_run(kind, tmp_path):
    """A file or folder that is not there as a file is refused with its name and the command that makes it."""
    read = kind[2]
    for path in (tmp_path / "absent", tmp_path):
        with refusal(path, "does not exist", "make repro"):
            read(path, "schema")


@pytest.mark.parametrize("older", [None, "kept"])
def test_failed_write_leaves_no_trace(older, tmp_path):
    """When writing fails half way nothing of it stays, and an older file stays as it was."""
    path = tmp_path / "file"
    if older:
        path.write_text(older)
    attempts = (
        lambda: write_json({"fine": 1, "not JSON": {1, 2}}, path),
        lambda: write_arrays({"fine": np.arange(3), "no array": (i for i in range(3))}, path, "s"),
        lambda: write_table(pd.DataFrame({"x": [1, "mixed"]}), path, "s"),
    )
    for attempt in attempts:
        with pytest.raises((TypeError, pa.ArrowInvalid, pa.ArrowTypeError)):
            attempt()
        assert [p.name for p in tmp_path.iterdir()] == (["file"] if older else [])
        assert not older or path.read_text() == older


def test_missing_columns_and_arrays_are_named(tmp_path):
    """A table or array file that lacks what its reader needs is refused with what is missing and what there is."""
    write_table(FRAME, tmp_path / "a.parquet", "scenes")
    assert list(read_table(tmp_path / "a.parquet", "scenes", ["cost", "q"])) == list(FRAME)
    with pytest.raises(ArtifactError, match=r"a\.parquet lacks size, split; it has scene, cost, name, q"):
        read_table(tmp_path / "a.parquet", "scenes", ["size", "cost", "split"])
    write_arrays(ARRAYS, tmp_path / "a.npz", "voxels")
    with pytest.raises(ArtifactError, match=r"a\.npz lacks scene; it has voxels, path"):
        read_arrays(tmp_path / "a.npz", "voxels", ["voxels", "scene"])


class Odd(float):
    """A number of a class of its own, as numpy's are."""


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, np.float64("nan"), np.float64("-inf"), Odd("inf")])
def test_json_has_null_for_what_is_not_finite(number, tmp_path):
    """What is written is JSON by the letter, wherever a number that JSON has no word for stands; others keep bits."""
    inside = {"a": number, "b": [1 / 3, [number], {"c": (number, np.float64(0.1))}], "d": 5e-324}
    write_json(inside, tmp_path / "m.json", "metrics")
    text = (tmp_path / "m.json").read_text()

    def refuse(word):
        raise AssertionError(word)

    json.loads(text, parse_constant=refuse)
    assert read_json(tmp_path / "m.json", "metrics") == {
        "a": None,
        "b": [1 / 3, [None], {"c": [None, 0.1]}],
        "d": 5e-324,
    }


@pytest.mark.parametrize(
    "text", ['{"a": NaN}', '{"a": [-Infinity]}', f'{{"a": {"9" * 5000}}}', "[" * 100_000, '{"a":' * 100_000]
)
def test_json_that_no_other_program_reads_is_refused(text, tmp_path):
    """Words that are no JSON, numbers of thousands of digits and endless nesting are refused by name."""
    (tmp_path / "odd.json").write_text(text)
    with refusal(tmp_path / "odd.json", "not readable JSON"):
        read_json(tmp_path / "odd.json")


@pytest.mark.parametrize("what", ["/dev/zero", "/dev/null", "fifo"])
def test_what_is_no_ordinary_file_is_not_read(kind, what, tmp_path):
    """A device or a pipe in the place of a file is refused at once: reading it might never end."""
    read, path = kind[2], tmp_path / "file"
    if what == "fifo":
        os.mkfifo(path)
    else:
        path.symlink_to(what)
    with refusal(path, "does not exist", "make repro"):
        read(path, "schema")


def test_a_file_nobody_may_read_is_refused(kind, tmp_path, monkeypatch):
    """What the system says against reading a file is said with the file's name."""
    _, write, read, content = kind
    write(content, tmp_path / "file", "schema")

    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refuse)
    monkeypatch.setattr(pq, "read_table", refuse)
    monkeypatch.setattr(np, "load", refuse)
    with refusal(tmp_path / "file", "not", "readable", "Permission denied"):
        read(tmp_path / "file", "schema")


def test_readers_find_the_folder_that_a_killed_writer_has_finished(tmp_path):
    """Where a kill came between taking the old folder away and putting the new one there, a reader puts it there."""
    with atomic_folder(tmp_path / ".out.finished") as out:
        write_json(CONTENT, out / "m.json")
    assert read_json(tmp_path / "out" / "m.json") == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("what", ["/dev/zero", "fifo", "folder", "absent"])
def test_text_is_read_of_ordinary_files_only(what, tmp_path):
    """Text comes back as UTF-8; a device, pipe, folder or nothing in its place is an error of the system, unopened."""
    (tmp_path / "text").write_bytes("ü".encode())
    assert read_text(tmp_path / "text") == "ü"
    if what == "fifo":
        os.mkfifo(tmp_path / "fifo")
    elif what == "folder":
        (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=r"it is a folder, device, pipe or socket|No such file"):
        read_text(tmp_path / what)
