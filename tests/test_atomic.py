"""Files and folders are replaced whole: killed at any step, raced for or out of space, the old or the new one stays."""

import errno
import json
import logging
import os
import resource
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from pipeline import atomic
from pipeline.atomic import (
    atomic_entries,
    atomic_file,
    atomic_folder,
    check_file,
    check_folder,
    exclusive,
    recover,
)
from pipeline.errors import ArtifactError

WRITERS = {"file": atomic_file, "folder": atomic_folder, "entries": atomic_entries}


def content(path: Path) -> dict[str, str]:
    """Return relative path -> text of every file below a folder."""
    return {str(p.relative_to(path)): p.read_text() for p in sorted(path.rglob("*")) if p.is_file()}


def write(kind: str, path: Path, *files: tuple[str, str]) -> None:
    """Write one text to a file, or several files into a folder."""
    with WRITERS[kind](path) as temporary:
        for name, text in files:
            target = temporary if kind == "file" else temporary / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text)


def interrupted(kind: str, path: Path) -> None:
    with WRITERS[kind](path) as temporary:
        (temporary if kind == "file" else temporary / "a").write_text("half")
        raise KeyboardInterrupt


# For every k: fork, and kill the child just before the k-th change of files or folders that it asks for. Then
# say what is there, what a reader finds, and what there is after another writer came and failed.
KILLED = """
import json, os, signal, sys
from pathlib import Path
from pipeline import atomic
kind, top, exchanges = sys.argv[1], Path(sys.argv[2]), sys.argv[3] == "exchange"
if not exchanges:
    atomic._exchange = lambda one, other: False
writer = getattr(atomic, f"atomic_{kind}")

def write(text):
    with writer(target) as temporary:
        if kind == "file":
            return temporary.write_text(text)
        for name in ("page", "pictures/one", f"pictures/{text}"):
            (temporary / name).parent.mkdir(exist_ok=True)
            (temporary / name).write_text(text)

def found():
    if kind == "file":
        return target.read_text() if target.is_file() else None
    return {str(p.relative_to(target)): p.read_text() for p in target.rglob("*") if p.is_file()
            and not p.relative_to(target).parts[0].startswith(".")}

def fail():
    try:
        with writer(target):
            raise RuntimeError
    except RuntimeError:
        pass

step, ended = 0, None
while ended != 0:
    step += 1
    folder = top / str(step)
    target = folder / "target"
    write("old")
    if kind == "entries":
        (target / "beside").write_text("beside")
    child = os.fork()
    if child == 0:
        left = step
        def count(event, arguments):
            global left
            if event == "open" or event.startswith("os.") and event not in ("os.listdir", "os.scandir"):
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
        sys.addaudithook(count)
        write("new")
        os._exit(0)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    states = [found()]
    atomic.recover(target)
    states.append(found())
    fail()
    states.append(found())
    print(json.dumps([states, sorted(p.name for p in folder.iterdir())]))
"""


@pytest.mark.parametrize("how", ["exchange", "renames"])
@pytest.mark.parametrize("kind", WRITERS)
def test_killed_at_any_step_the_old_or_the_new_is_there(tmp_path, kind, how):
    """Killed between any two changes a writer leaves the old or the new; a next one, though it fails, keeps and cleans.

    Where folders cannot be exchanged in one step, a kill may leave none for a moment, until someone reads or writes. Of
    entries, each file is the old or the new one, and after the next writer all are of the same run.
    """
    done = subprocess.run(
        [sys.executable, "-c", KILLED, kind, str(tmp_path), how], capture_output=True, text=True, check=True
    )
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    old, new = ("old", "new") if kind == "file" else (_written("old", kind), _written("new", kind))
    assert len(outcomes) > 3 and outcomes[0][0][0] == old and outcomes[-1][0] == [new, new, new]
    for (first, read, after), names in outcomes:
        assert after in (old, new)
        assert names == ["target"]
        if kind == "entries":
            assert first == read
            assert first["page"] in ("old", "new") and first["pictures/one"] in ("old", "new")
            assert first["beside"] == "beside" and {"old", "new"} >= set(first.values()) - {"beside"}
        else:
            assert read == after
            assert first == read or how == "renames"
    assert all(whole in [after for (_, _, after), _ in outcomes] for whole in (old, new))
    if how == "renames" and kind == "folder":
        assert any(first != read for (first, read, _), _ in outcomes)  # the moment that is recovered from was met


def _written(text: str, kind: str) -> dict[str, str]:
    files = {"page": text, "pictures/one": text, f"pictures/{text}": text}
    return files | ({"beside": "beside"} if kind == "entries" else {})


RACER = """
import sys
from pathlib import Path
from pipeline.atomic import atomic_folder
name = sys.argv[2]
for i in range(int(sys.argv[3])):
    with atomic_folder(Path(sys.argv[1])) as out:
        for file in "abc":
            (out / file).write_text(f"{name}-{i}")
"""


def test_writers_race_and_readers_see_whole_folders(tmp_path):
    """While three processes replace one folder at once, it is always there, and its files are of one writer's turn."""
    folder = tmp_path / "folder"
    write("folder", folder, *((name, "first") for name in "abc"))
    racers = [subprocess.Popen([sys.executable, "-c", RACER, str(folder), str(i), "60"]) for i in range(3)]
    seen = set()
    while any(racer.poll() is None for racer in racers):
        view = os.open(folder, os.O_RDONLY)  # a reader that has the folder open, as one that is in it
        texts = set()
        for name in "abc":
            with suppress(FileNotFoundError):  # of an older folder, which is being removed
                file = os.open(name, os.O_RDONLY, dir_fd=view)
                texts.add(os.read(file, 20))
                os.close(file)
        os.close(view)
        assert len(texts) <= 1
        seen |= texts
    assert [racer.wait() for racer in racers] == [0, 0, 0]
    assert len(seen) > 3
    assert len(set(content(folder).values())) == 1 and [p.name for p in tmp_path.iterdir()] == ["folder"]


def test_a_waiting_new_folder_is_never_mistaken(tmp_path, monkeypatch):
    """Where folders can be neither exchanged nor renamed, as in a container's image, they are replaced all the same."""
    rename = os.rename

    def refuse(source, target):
        if Path(source) == tmp_path / "folder":
            raise OSError(errno.EXDEV, "Invalid cross-device link")
        rename(source, target)

    monkeypatch.setattr(atomic, "_exchange", lambda one, other: False)
    monkeypatch.setattr(os, "rename", refuse)
    for text in ("old", "new"):
        write("folder", tmp_path / "folder", ("a", text), (text, text))
    assert content(tmp_path / "folder") == {"a": "new", "new": "new"}
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


def test_recovery_asks_for_no_rights(tmp_path, monkeypatch):
    """Who may not write beside a folder still reads what is there."""
    write("folder", tmp_path / "folder", ("a", "old"))
    (tmp_path / ".folder.finished").mkdir()
    monkeypatch.setattr(os, "open", lambda *_: (_ for _ in ()).throw(PermissionError(errno.EACCES, "no")))
    recover(tmp_path / "folder")
    monkeypatch.undo()
    assert content(tmp_path / "folder") == {"a": "old"}


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("older", [False, True])
def test_failed_write_leaves_no_trace(kind, older, tmp_path):
    """When writing is broken off nothing of it stays, and what was there before stays as it was."""
    path = tmp_path / "target"
    if older:
        write(kind, path, ("a", "kept"))
    with pytest.raises(KeyboardInterrupt):
        interrupted(kind, path)
    if kind == "file":
        assert not older or path.read_text() == "kept"
    else:
        assert content(path) == ({"a": "kept"} if older else {}) if path.exists() else not older
    assert [p.name for p in tmp_path.iterdir()] in ([], ["target"])


def test_nothing_is_seen_before_it_is_whole(tmp_path):
    """While a file is written its name holds the older content, and who has that open goes on reading it."""
    (tmp_path / "file").write_text("old")
    with open(tmp_path / "file") as reader:
        with atomic_file(tmp_path / "file") as temporary:
            temporary.write_text("new")
            assert (tmp_path / "file").read_text() == "old"
            assert temporary.parent == tmp_path  # on the same file system, so that renaming it is atomic
        assert reader.read() == "old"
    assert (tmp_path / "file").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_folder_replaces_the_older_one_or_vanishes(tmp_path):
    """A folder is replaced as a whole; a link to one stays a link."""
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    for name in ("first", "second"):
        write("folder", tmp_path / ("link" if name == "second" else "folder"), (name, name))
        assert content(tmp_path / "folder") == {name: name}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "link"] and (tmp_path / "link").is_symlink()


def test_entries_replace_those_of_their_names(tmp_path):
    """Entries replace those of the same name, with all that these hold; what has other names stays untouched."""
    pages = tmp_path / "pages"
    write("entries", pages, ("a.md", "1"), ("a/x.png", "1"), ("a/deep/y.png", "1"), ("a/gone/z.png", "1"))
    (pages / "other.md").write_text("mine")
    (pages / "b").mkdir()
    (pages / "b" / "x.png").write_text("mine")
    write("entries", pages, ("a.md", "2"), ("a/x.png", "2"), ("a/deep/new.png", "2"))
    assert content(pages) == {
        "a.md": "2", "a/x.png": "2", "a/deep/new.png": "2", "other.md": "mine", "b/x.png": "mine",
    }  # fmt: skip
    assert sorted(p.name for p in (pages / "a").iterdir()) == ["deep", "x.png"]
    assert sorted(p.name for p in pages.iterdir()) == ["a", "a.md", "b", "other.md"]


BEGUN = """
import sys, time
from pathlib import Path
from pipeline import atomic
with getattr(atomic, f"atomic_{sys.argv[1]}")(Path(sys.argv[2])) as out:
    (out if sys.argv[1] == "file" else out / "a").write_text("half")
    print("in", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_killed_processes_left_goes(tmp_path, kind):
    """What a killed process has half written is gone after the next write; one that is at work keeps its own."""
    command = [sys.executable, "-c", BEGUN, kind, str(tmp_path / "out")]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    for process in processes:
        assert process.stdout.readline() == b"in\n"
    killed, working = processes
    killed.kill()
    killed.wait(30)
    assert len(list(tmp_path.glob(".out.*.partial"))) == 2
    write(kind, tmp_path / "out", ("a", "whole"))
    assert sorted(path.name for path in tmp_path.iterdir()) == [f".out.{working.pid}.partial", "out"]
    working.kill()
    working.wait(30)


HOLDER = """
import sys, time
from pathlib import Path
from pipeline.atomic import exclusive
with exclusive(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.readline()
print("out", flush=True)
"""


def test_a_folder_is_worked_in_by_one_process_at_a_time(tmp_path, caplog):
    """A second process waits, saying for which one, until the first has left or was killed; no lock is left behind."""
    folder = tmp_path / "deep" / "work"
    for leave in (lambda process: process.communicate("\n", timeout=30), lambda process: process.kill()):
        process = subprocess.Popen(
            [sys.executable, "-c", HOLDER, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert process.stdout.readline() == "in\n"
        entered = threading.Event()

        def enter(entered=entered):
            with exclusive(folder):
                entered.set()

        caplog.clear()
        with caplog.at_level(logging.WARNING):
            other = threading.Thread(target=enter)
            other.start()
            assert not entered.wait(0.3)
            leave(process)
            other.join(30)
        assert entered.is_set()
        assert f"waiting for process {process.pid}" in caplog.text and str(folder) in caplog.text
        process.wait(30)
        assert [p.name for p in folder.parent.iterdir()] == ["work"]


def test_many_take_turns(tmp_path):
    """Of many that want a folder at once never two have it, though each removes the lock's file when it leaves."""
    inside, most = [], []

    def enter():
        for _ in range(20):
            with exclusive(tmp_path / "work"):
                inside.append(None)
                most.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=enter) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert most == [1] * 160 and [p.name for p in tmp_path.iterdir()] == ["work"]


FULL = """
import sys
from pathlib import Path
from pipeline import atomic
from pipeline.errors import ArtifactError
try:
    with getattr(atomic, f"atomic_{sys.argv[1]}")(Path(sys.argv[2])) as out:
        with open(out if sys.argv[1] == "file" else out / "a", "wb") as stream:
            for _ in range(100):
                stream.write(bytes(10_000))
except ArtifactError as error:
    print(error)
"""


@pytest.mark.parametrize("kind", WRITERS)
def test_no_space_is_said_and_leaves_the_old(tmp_path, kind):
    """Where the system takes no more bytes, the error names the file and the reason, and the old content stays."""
    path = tmp_path / "target"
    write(kind, path, ("a", "old"))
    done = subprocess.run(
        [sys.executable, "-c", FULL, kind, str(path)], capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )  # fmt: skip
    assert done.stderr == "" and done.stdout == f"{path} cannot be written: File too large\n"
    assert (path if kind == "file" else path / "a").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["target"]


@pytest.mark.parametrize("kind", WRITERS)
def test_an_error_of_another_file_names_that_too(tmp_path, kind):
    """An error about another file than the one that is written names both; what is no error of the system passes."""
    said = rf"{tmp_path}/x cannot be written: No such file .*\({tmp_path}/source\)"
    with pytest.raises(ArtifactError, match=said), WRITERS[kind](tmp_path / "x"):
        (tmp_path / "source").read_text()
    with pytest.raises(ZeroDivisionError), WRITERS[kind](tmp_path / "x"):
        raise ZeroDivisionError
    assert not list(tmp_path.glob("*/*")) and not (tmp_path / "x").is_file()


@pytest.mark.parametrize("what", ["fifo", "socket", "device", "folder", "file", "below a file"])
def test_nothing_else_is_replaced(tmp_path, what):
    """A device, pipe or socket, and a folder in the place of a file or a file in that of a folder, stay what they are.

    The checks before the work refuse the same.
    """
    path, served = tmp_path / "x", None
    if what == "fifo":
        os.mkfifo(path)
    elif what == "socket":
        served = socket.socket(socket.AF_UNIX)
        served.bind(str(path))
    elif what == "device":
        path.symlink_to("/dev/zero")
    elif what == "folder":
        path.mkdir()
    else:
        path.write_text("mine")
    target = path / "y" if what == "below a file" else path
    before = path.stat()
    refused = {"file": ["folder", "entries"], "folder": ["file"]}.get(what, list(WRITERS))
    for kind in refused:
        with pytest.raises(ArtifactError, match=rf"{target} (is a|cannot be written)"):
            write(kind, target, ("a", "new"))
        with pytest.raises(ArtifactError, match=rf"{target} (is a|cannot be written)"):
            (check_file if kind == "file" else check_folder)(target)
    assert path.stat() == before and [p.name for p in tmp_path.iterdir()] == ["x"]
    if served:
        served.close()


def test_what_can_be_written_passes_the_checks(tmp_path):
    """A file or folder that is there, or not yet, several folders deep, passes, and the checks leave nothing behind."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file", tmp_path / "new" / "deep" / "file"):
        check_file(path)
    for path in (tmp_path / "folder", tmp_path / "new" / "deep" / "folder"):
        check_folder(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]
