"""The tooling: the lock, the licence and the citation say what they must."""

import ast
import os
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parent.parent
AGREED = {
    "torch": "2.13.0",
    "ompl": "2.0.1",
    "pin": "4.1.0",
    "coal": "3.0.3",
    "casadi": "3.8.2",
    "example-robot-data": "6.0.0",
}
OWN = {"pipeline", "stages", "tests", "conftest"}


def lock() -> dict[str, str]:
    """Return the version of every distribution in the lock."""
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pins = [line.partition("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, _, version in pins}


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def sources() -> list[Path]:
    return sorted(path for folder in ("pipeline", "stages", "tests") for path in (ROOT / folder).rglob("*.py"))


def imported(nodes: list[ast.AST]) -> set[str]:
    """Return the top-level modules that import statements among `nodes` name."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add((node.module or "").partition(".")[0])
    return names


def provided() -> set[str]:
    """Return the top-level modules that the installed distributions of the lock contain."""
    modules: set[str] = set()
    for name in lock():
        for file in metadata.distribution(name).files or []:
            parts = file.parts
            if "site-packages" in parts:  # cmeel packages carry a site-packages of their own
                parts = parts[parts.index("site-packages") + 1 :]
            if parts:
                modules.add(parts[0].partition(".")[0])
    return modules


def test_lock_pins_everything():
    """Every line of the lock is one distribution at one public version, which every index has."""
    lines = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
    assert [line for line in lines if not re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*", line)] == []
    assert len(lock()) == len(lines)


def test_lock_has_no_cuda():
    """The lock names no CUDA package, so that it installs on a machine without a GPU in minutes, not in gigabytes."""
    assert [name for name in lock() if re.search("nvidia|cuda|cudnn|cupy|triton", name)] == []


@pytest.mark.parametrize("name", AGREED)
def test_agreed_versions(name):
    """The lock and the running environment have the versions that the published reports come from."""
    assert lock()[name] == AGREED[name]
    assert Version(metadata.version(name)).public == AGREED[name]


def test_lock_satisfies_project():
    """Every requirement of pyproject.toml, peers excepted, is met by the lock."""
    pins = lock()
    required = [*project()["dependencies"], *project()["optional-dependencies"]["dev"]]
    unmet = [text for text in required if not _met(Requirement(text), pins)]
    assert unmet == []


def test_peers_are_not_installed():
    """Other planners are an extra that the lock leaves out."""
    peers = {canonicalize_name(Requirement(text).name) for text in project()["optional-dependencies"]["peers"]}
    assert peers == {"roboplan"}
    assert not peers & lock().keys()


def test_imports_are_locked():
    """Everything the code imports comes with a distribution of the lock; peers may be imported inside a function."""
    available = provided() | sys.stdlib_module_names | OWN
    peers = {Requirement(text).name for text in project()["optional-dependencies"]["peers"]}
    missing = []
    for path in sources():
        tree = ast.parse(path.read_text(), str(path))
        siblings = {other.stem for other in path.parent.glob("*.py")}
        absent = (imported(tree.body) | (imported(list(ast.walk(tree))) - peers)) - available
        missing += [f"{path.relative_to(ROOT)}: {name}" for name in sorted(absent - siblings)]
    assert missing == []


def test_dvc_is_quiet():
    """DVC neither reports home nor looks for updates, and hands its lock to git."""
    lines = (ROOT / ".dvc" / "config").read_text().split()
    assert " ".join(lines) == "[core] analytics = false check_update = false autostage = true"


def test_ci_is_executable():
    """CI starts `.ci/run` as a command."""
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_citation():
    """CITATION.cff names the software and the four papers it builds on, and cites no number it cannot know."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["license"] == project()["license"] == "BSD-3-Clause"
    papers = citation["references"]
    assert [paper["authors"][0]["family-names"] for paper in papers] == ["Qureshi", "Qureshi", "Acar", "Crockett"]
    assert len({paper["title"] for paper in papers}) == 4
    assert all("doi" not in paper for paper in papers)


def test_licence():
    """LICENSE is the BSD licence with three clauses."""
    text = " ".join((ROOT / "LICENSE").read_text().split())
    assert text.startswith("BSD 3-Clause License Copyright (c) 2026, The project's authors")
    assert [clause for clause in ("1. Redis", "2. Redis", "3. Neither the name", "4. ") if clause in text] == [
        "1. Redis",
        "2. Redis",
        "3. Neither the name",
    ]
    assert 'PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS"' in text


def _met(requirement: Requirement, pins: dict[str, str]) -> bool:
    version = pins.get(canonicalize_name(requirement.name))
    return version is not None and requirement.specifier.contains(version)
