"""Files and folders that are replaced whole: whenever a writer is killed, the old one or the new one is there.

A writer works in a place of its own beside the target, `.<name>.<process>.partial`, and swaps it in under a lock. What
killed writers have left beside a target goes when the next one comes.
"""

import ctypes
import errno
import fcntl
import glob
import logging
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import ArtifactError

log = logging.getLogger(__name__)
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2  # linux/fcntl.h, linux/fs.h
_PARTIAL = re.compile(r"\.([^/]+)\.\d+\.partial")  # names that no message shows
_CONTENT = ".content"  # lists the files of a folder whose entries are being moved
# What renameat2 says where it cannot exchange: an old kernel, some file systems, a folder of a container's image.
_CANNOT = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EXDEV)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that replaces it on success and vanishes on failure.

    Raises:
        ArtifactError: there is something else than a file, or the system does not let us write (no space, read-only).
    """
    path = Path(path)
    with _reported(path):
        _refuse_unless(path, "file")
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear(path)
        temporary = _beside(path, f"{os.getpid()}.partial")
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path` that replaces it on success and vanishes on failure.

    A link to a folder stays one. Two writers do not disturb each other; the one that ends last is seen.

    Raises:
        ArtifactError: there is something else than a folder, or the system does not let us write.
    """
    with _reported(path):
        _refuse_unless(path, "folder")
        with _folder(Path(path).resolve()) as temporary:
            yield temporary


@contextmanager
def atomic_entries(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder whose entries replace those of the same name in `folder`; others there stay.

    Every file is the old or the new one at any moment. What a writer that was killed in between has not moved, the next
    one moves.

    Raises:
        ArtifactError: see `atomic_folder`.
    """
    with _reported(folder):
        _refuse_unless(folder, "folder")
        staged = Path(folder).resolve() / ".entries"
        staged.parent.mkdir(parents=True, exist_ok=True)
        with _locked(staged):
            _spread(staged)
        with _folder(staged) as temporary:
            yield temporary
            files = sorted(str(path.relative_to(temporary)) for path in temporary.rglob("*") if not path.is_dir())
            (temporary / _CONTENT).write_text("\0".join(files))
        with _locked(staged):
            _spread(staged)


def recover(path: Path) -> None:
    """Finish what a writer of the folder `path` began that was killed where folders cannot be exchanged in one step."""
    path = Path(path)
    if _finished(path).exists():
        with suppress(OSError), _locked(path):  # who may not write here reads what there is
            _settle(path)


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Make `folder` and keep it to this process until the block ends; wait while another one has it.

    A stage may outlive the command that started it (only `dvc` was killed, say): a second one would repeat its work
    beside it. The lock dies with the process.

    Raises:
        ArtifactError: the folder cannot be made.
    """
    folder = Path(folder)
    with _reported(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        lock = _acquire(folder)
    try:
        with _reported(folder):
            folder.mkdir(exist_ok=True)
        yield
    finally:
        _release(folder, lock)


def check_file(path: Path) -> None:
    """Refuse, before work starts, a file that cannot be written or replaced.

    Raises:
        ArtifactError: see `atomic_file`.
    """
    _check(Path(path), "file")


def check_folder(path: Path) -> None:
    """Refuse, before work starts, a folder that cannot be written or replaced.

    Raises:
        ArtifactError: see `atomic_folder`.
    """
    _check(Path(path), "folder")


@contextmanager
def _folder(path: Path) -> Iterator[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _beside(path, f"{os.getpid()}.partial")
    with _locked(path):
        _settle(path)
        _clear(path)
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
    try:
        yield temporary
        with _locked(path):
            _swap(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)  # by now the old folder, where they were exchanged


def _check(path: Path, wanted: str) -> None:
    """Make and remove something in the nearest folder above `path` that exists."""
    try:
        _refuse_unless(path, wanted)
        nearest = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
        with tempfile.TemporaryDirectory(dir=nearest, prefix="."):
            pass
    except OSError as error:
        raise ArtifactError(f"{path} cannot be written: {error.strerror}") from error


def _refuse_unless(path: Path, wanted: str) -> None:
    path = Path(path)
    found = "folder" if path.is_dir() else "file" if path.is_file() else "device, pipe or socket"
    if path.exists() and found != wanted:
        raise ArtifactError(f"{path} is a {found}; it must be a {wanted}, or not there yet")


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Turn what the system says against writing into an error that names the file."""
    try:
        yield
    except OSError as error:
        # By the number, where there is one: pyarrow and zipfile have words of their own.
        what = os.strerror(error.errno) if error.errno else " ".join(str(error).split())
        wanted, found = (_PARTIAL.sub(r"\1", str(name)) for name in (path, error.filename or path))
        raise ArtifactError(f"{wanted} cannot be written: {what}{f' ({found})' if found != wanted else ''}") from error


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(f".{path.name.removeprefix('.')}.{ending}")


def _finished(path: Path) -> Path:
    """Return where a new folder waits, whole, until the old one has gone; what is there is to be moved in."""
    return _beside(path, "finished")


def _clear(path: Path) -> None:
    """Remove what processes that no longer run have left beside `path`."""
    for left in path.parent.glob(f"{glob.escape(_beside(path, '').name)}*.partial"):
        if _runs(left.name.split(".")[-2]):
            continue
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def _swap(temporary: Path, path: Path) -> None:
    """Put the folder `temporary` in the place of `path`. Under the lock."""
    if not path.exists():
        os.rename(temporary, path)
    elif not _exchange(temporary, path):
        os.rename(temporary, _finished(path))
        _settle(path)


def _settle(path: Path) -> None:
    """Move a folder that waits beside `path` in its place. Under the lock; may be killed and repeated at any point."""
    waiting = _finished(path)
    if not waiting.exists():
        return
    if path.exists():
        old = _beside(path, f"old.{os.getpid()}.partial")
        shutil.rmtree(old, ignore_errors=True)
        try:
            os.rename(path, old)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
            shutil.rmtree(path)  # folders of a container's image cannot be renamed, but their content can be removed
        shutil.rmtree(old, ignore_errors=True)
    os.rename(waiting, path)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names in a single step of the system; return False where it has none."""
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "renameat2"):
        return False
    if libc.renameat2(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _CANNOT:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _spread(staged: Path) -> None:
    """Move the files of a whole folder into the folder around it, and remove what their folders held before.

    Under the lock; may be killed and repeated at any point.
    """
    content = staged / _CONTENT
    if content.is_file():
        files = [Path(name) for name in content.read_text().split("\0") if name]
        for file in files:
            if (staged / file).exists():  # else it was moved before a kill
                (staged.parent / file).parent.mkdir(parents=True, exist_ok=True)
                os.replace(staged / file, staged.parent / file)
        for entry in {file.parts[0] for file in files if len(file.parts) > 1}:
            for left in sorted((staged.parent / entry).rglob("*"), reverse=True):  # a folder after what is in it
                if left.is_dir() and not left.is_symlink():
                    with suppress(OSError):  # not empty
                        left.rmdir()
                elif left.relative_to(staged.parent) not in files:
                    left.unlink()
    shutil.rmtree(staged, ignore_errors=True)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    lock = _acquire(path)
    try:
        yield
    finally:
        _release(path, lock)


def _acquire(path: Path) -> int:
    """Lock `path`, waiting for whoever has it; return the descriptor of the lock's file."""
    place = _beside(path, "lock")
    while True:
        lock = os.open(place, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = os.read(lock, 20).decode() or "unknown"
                log.warning("waiting for process %s, which is at work in %s", holder, path)
                fcntl.flock(lock, fcntl.LOCK_EX)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(lock), os.stat(place)):  # else the holder has removed it, or a third came
                    os.ftruncate(lock, 0)
                    os.write(lock, str(os.getpid()).encode())
                    return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)


def _release(path: Path, lock: int) -> None:
    """Remove the lock's file, then unlock: whoever waits for it finds another file, or none, and takes that."""
    _beside(path, "lock").unlink(missing_ok=True)
    os.close(lock)


def _runs(process: str) -> bool:
    """Tell whether a process of this number runs."""
    try:
        os.kill(int(process), 0)
    except (ValueError, ProcessLookupError):
        return False
    except PermissionError:  # it runs, as somebody else's
        pass
    return True
