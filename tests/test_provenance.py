import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pipeline import provenance
from pipeline.provenance import commit, planning_versions, versions


def git(folder: Path, *arguments: str) -> str:
    who = ("-c", "user.name=test", "-c", "user.email=test@localhost")
    done = subprocess.run(["git", *who, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def home(tmp_path, monkeypatch) -> Path:
    """A folder with a copy of the module, which is asked for its commit from then on."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):  # a hook may have set them
        monkeypatch.delenv(name, raising=False)
    module = tmp_path / "pipeline" / "provenance.py"
    module.parent.mkdir()
    shutil.copy(provenance.__file__, module)
    monkeypatch.setattr(provenance, "_HERE", module)
    monkeypatch.setattr(provenance, "_CODE", (str(module.parent),))
    return tmp_path


def test_the_commit_is_git_s(home):
    """The short hash of the checked-out commit, and a mark where a tracked file differs."""
    git(home, "init", "-q")
    git(home, "add", "pipeline/provenance.py")
    git(home, "commit", "-qm", "one")
    head = git(home, "rev-parse", "HEAD")
    assert re.fullmatch("[0-9a-f]{7,}", commit()) and head.startswith(commit())
    (home / "pipeline" / "new.py").touch()
    assert head.startswith(commit())
    (home / "pipeline" / "provenance.py").write_text("changed = True\n")
    assert head.startswith(commit().removesuffix("-dirty")) and commit().endswith("-dirty")


def test_no_commit_without_a_repository_of_ours(home, monkeypatch):
    """Outside of git, in a repository that does not track the code, and where git is not installed, there is none."""
    assert commit() == ""
    git(home, "init", "-q")
    git(home, "commit", "-qm", "theirs", "--allow-empty")
    assert commit() == ""
    monkeypatch.setenv("PATH", "")
    assert commit() == ""


def test_no_commit_before_the_first(home):
    """A file that is added and not committed yet has no commit."""
    git(home, "init", "-q")
    git(home, "add", "pipeline/provenance.py")
    assert commit() == ""


def test_packages_that_are_not_there_have_no_version():
    """Only what is installed is named; Python always is."""
    assert versions(["no-such-package"]).keys() == {"python"}
    assert {"python", "numpy", "pin"} <= planning_versions().keys()
