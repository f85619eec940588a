"""The order of rooms in docs/architecture.md is what the code keeps, and the verifier shares nothing with planning."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.config import ROOT

PIPELINE = ROOT / "pipeline"
# What the verifier takes of planning's rooms: how settings and tasks are written, files found, meshes made simpler.
PLAIN = {
    "pipeline.robots.urdf": {"UrdfRobot"},
    "pipeline.robots.obstacles": {"Obstacle", "Shape"},
    "pipeline.robots.placement": {"IDENTITY", "Placement"},
    "pipeline.robots.description": {"Movable", "resolve"},
    "pipeline.files": {"Stamp", "stamps", "unchanged"},
    # What a mesh becomes is part of what is asked; that each encloses its mesh is a test of the verifier.
    "pipeline.robots.bodies": {"Geometry", "hull", "primitive"},
    "pipeline.robots.kept": {"kept_pieces"},
}


def rooms() -> list[str]:
    """The rooms as the page lists them, the lowest first; modules of the door and cellar are one room, ''."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    listed = page.split("## Rooms of `pipeline/`")[1].split("```")[1]
    return ["", *re.findall(r"^(\w+)/", listed, re.MULTILINE)]


def imports(path: Path) -> Iterator[tuple[str, str]]:
    """Modules of ours that a file imports, and the name it takes; wherever in the file it does."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("pipeline"):
            yield from ((str(node.module), alias.name) for alias in node.names)
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.startswith("pipeline"))


def room_of(module: str) -> str:
    """The room of a module; '' of those that stand outside of rooms."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and (PIPELINE / parts[1]).is_dir() else ""


def test_every_room_is_listed():
    """The page lists every folder of the pipeline, each once."""
    folders = {path.parent.name for path in PIPELINE.glob("*/__init__.py")}
    assert sorted(rooms()) == sorted({"", *folders})


@pytest.mark.parametrize("room", rooms()[1:])
def test_lower_rooms_never_import_higher_ones(room):
    """What a room imports is in itself or in a room below it,"""
    order = rooms()
    above = set(order[order.index(room) + 1 :])
    wrong = [
        (path.name, module)
        for path in (PIPELINE / room).rglob("*.py")
        for module, _ in imports(path)
        if room_of(module) in above
    ]
    assert wrong == []


def test_verifier_shares_nothing_with_planning():
    """The verifier imports plain data and what makes a mesh simpler, and neither CasADi nor pinocchio."""
    for path in (PIPELINE / "verification").glob("*.py"):
        for module, name in imports(path):
            if room_of(module) not in ("verification", "spec") and module != "pipeline.errors":
                assert name in PLAIN.get(module, set()), (path.name, module, name)
        tree = ast.parse(path.read_text())
        others = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        others |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not {name.split(".")[0] for name in others} & {"casadi", "pinocchio"}, path.name
