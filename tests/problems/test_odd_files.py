"""What a problem file names, and the file itself, is an ordinary file, or the command ends at once in one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from pipeline.errors import ProblemError
from pipeline.problems import read_problem
from pipeline.problems.build import build

ROOT = Path(__file__).parents[2]
ODD = ["/dev/zero", "fifo", "folder", "socket/none"]


def odd(folder: Path, what: str) -> str:
    """Make something that is no ordinary file; return its path."""
    if what == "fifo":
        os.mkfifo(folder / "fifo")
    elif what == "folder":
        (folder / "folder").mkdir()
    return what if what.startswith("/") else str(folder / what)


@pytest.mark.parametrize("what", ODD)
def test_a_problem_file_is_an_ordinary_file(tmp_path, what):
    """A device, a pipe, a folder or nothing in the place of the problem file is refused by name, without reading it."""
    path = odd(tmp_path, what)
    with pytest.raises(ProblemError, match=f"problem file {path} cannot be read: "):
        read_problem(path)


@pytest.mark.parametrize("what", ODD)
@pytest.mark.parametrize("shape", ["octree", "mesh"])
def test_files_of_obstacles_are_ordinary_files(tmp_path, what, shape):
    """So are files of points and of meshes."""
    content = yaml.safe_load((ROOT / "examples" / "upright_panda.yaml").read_text())
    path = odd(tmp_path, what)
    content["obstacles"] = [{"name": "b", "shape": shape, "size": 0.1, "file": path}]
    content["grasps"] = []
    (tmp_path / "p.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ProblemError, match=f"(points '{path}' cannot be read|there is no mesh '{path}')"):
        build(read_problem(tmp_path / "p.yaml"))


def test_the_command_ends_at_once(tmp_path):
    """The command that plans ends in one line and status 1 when it is given an endless device, and writes nothing."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "stages" / "plan.py"), "problem=/dev/zero", "output=out"], cwd=tmp_path, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert done.stderr.startswith("ProblemError: problem file /dev/zero cannot be read: it is a folder, device, pipe")
    assert list(tmp_path.iterdir()) == []
