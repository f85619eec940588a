"""What the README shows is what a newcomer gets."""

import re
from pathlib import Path

import pytest

from pipeline.planning import solve
from pipeline.problems import read_problem

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    """Return the code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_its_problem_is_solved(tmp_path):
    """The problem file that it shows is one, and has a verified path."""
    (text,) = blocks("yaml")
    (tmp_path / "cup.yaml").write_text(text)
    assert solve(read_problem(tmp_path / "cup.yaml")).status == "solved"


@pytest.mark.parametrize("number", range(2))
def test_its_python_runs(number, monkeypatch, capsys):
    """Every Python block runs as it stands and prints what was solved."""
    monkeypatch.chdir(ROOT)
    snippets = blocks("python")
    assert len(snippets) == 2
    exec(compile(snippets[number], f"README {number}", "exec"), {})
    assert "solved" in capsys.readouterr().out.lower()


def test_its_files_are_there():
    """Links and pictures lead to files of the project."""
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README):
        assert (ROOT / target).exists(), target
