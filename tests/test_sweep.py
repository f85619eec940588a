"""A sweep keeps one row per job and ends in one table."""

import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn
from hydra.types import RunMode
from omegaconf import OmegaConf, open_dict

from pipeline.config import ROOT
from pipeline.errors import ArtifactError
from pipeline.files import read_json, write_json
from pipeline.machine import processor
from pipeline.provenance import commit
from pipeline.sweep import ROW, OwnFolders, SweepTable, keep_row

OVERRIDES = [
    "profile=standard",
    "method.planner.parameters.samples=200",
    "model.parameters.layers.hidden=[8,8]",
    "~training.threads",
]


def end(folder) -> None:
    """End a sweep into `folder` as Hydra does."""
    SweepTable().on_multirun_end(OmegaConf.create({"hydra": {"sweep": {"dir": str(folder)}}}))


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.fixture
def job(tmp_path, monkeypatch):
    """A running job 3 of a sweep of `stages/tune.py` into tmp_path, or a single run of it."""
    monkeypatch.chdir(tmp_path)

    def begin(mode: RunMode) -> None:
        with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
            config = compose("tune", OVERRIDES, return_hydra_config=True)
        with open_dict(config):
            config.hydra.mode = mode
            config.hydra.job.num = 3
            config.hydra.sweep.dir = str(tmp_path / "multirun")
        monkeypatch.setattr(HydraConfig.instance(), "cfg", None)
        HydraConfig.instance().set_config(config)

    return begin


def test_rows_become_one_table_in_the_order_of_the_jobs(tmp_path, capsys):
    """Rows stand in the order of the job numbers, 10 after 2, in a table for people and one for programs."""
    for number in (10, 2, 0, 1):
        write_json(
            {"samples": str(100 * number), "time median [ms]": 1 / 3 + number, "n": 20}, tmp_path / f"{number}" / ROW
        )
    end(tmp_path)
    table = pd.read_csv(tmp_path / "table.csv")
    assert list(table.columns) == ["samples", "time median [ms]", "n"]
    assert table["samples"].tolist() == [0, 100, 200, 1000]
    assert table["time median [ms]"].tolist() == [1 / 3, 1 + 1 / 3, 2 + 1 / 3, 10 + 1 / 3]
    head, _, *rows = (tmp_path / "table.md").read_text().splitlines()
    assert cells(head) == ["samples", "time median [ms]", "n"]
    assert [cells(row) for row in rows] == [
        ["0", "0.3333", "20"],
        ["100", "1.333", "20"],
        ["200", "2.333", "20"],
        ["1000", "10.33", "20"],
    ]
    assert (tmp_path / "table.md").read_text().rstrip() in capsys.readouterr().out


def test_failed_jobs_have_no_row(tmp_path):
    """Jobs that left no row are left out, as are files beside them; what a row lacks stays empty."""
    write_json({"samples": "1", "n": 3}, tmp_path / "0" / ROW)
    (tmp_path / "1").mkdir()
    (tmp_path / "1" / "tune.log").write_text("Traceback")
    write_json({"samples": "3", "length": 2.5}, tmp_path / "2" / ROW)
    (tmp_path / "multirun.yaml").write_text("x: 1")
    end(tmp_path)
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["samples"].tolist() == [1, 3]
    assert table["n"].isna().tolist() == [False, True]
    assert table["length"].isna().tolist() == [True, False]


def test_no_rows_make_no_table(tmp_path, capsys):
    """A sweep without a single row leaves no table and prints none."""
    (tmp_path / "0").mkdir()
    end(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["0"]
    assert capsys.readouterr().out == ""


def test_damaged_row_is_refused_by_name(tmp_path):
    """A row that is cut off is refused with its file, and no table is written."""
    (tmp_path / "0").mkdir()
    (tmp_path / "0" / ROW).write_text('{"n": 3')
    with pytest.raises(ArtifactError, match=str(tmp_path / "0" / ROW)):
        end(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_job_of_a_sweep_keeps_its_row(tmp_path, job):
    """A sweep's job writes what it was asked for and what came of it into the folder of its number."""
    job(RunMode.MULTIRUN)
    keep_row({"n": 20, "solved [%]": 95.0})
    assert [path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()] == [
        (tmp_path / "multirun" / "3" / ROW).relative_to(tmp_path)
    ]
    row = read_json(tmp_path / "multirun" / "3" / ROW)
    assert row.pop("commit") == (commit() or "unknown") and row.pop("cpu") == processor()
    assert list(row.items()) == [
        ("profile", "standard"),
        ("method.planner.parameters.samples", "200"),
        ("model.parameters.layers.hidden", "[8,8]"),
        ("~training.threads", ""),
        ("n", 20),
        ("solved [%]", 95.0),
    ]
    end(tmp_path / "multirun")
    assert pd.read_csv(tmp_path / "multirun" / "table.csv")["solved [%]"].tolist() == [95.0]


def test_single_run_keeps_no_row(tmp_path, job):
    """A run that is no sweep writes nothing."""
    job(RunMode.RUN)
    keep_row({"n": 20})
    assert list(tmp_path.iterdir()) == []


STAGES = sorted(path.stem for path in (ROOT / "stages").glob("*.py") if path.stem != "dag")  # which takes no settings


@pytest.mark.parametrize("stage", STAGES)
def test_every_sweep_is_looked_at(stage):
    """Hydra calls the table at the end of a sweep of `stages/tune.py`, and every script's sweeps are checked before."""
    callback = {"table": "SweepTable"} if stage == "tune" else {"folders": "OwnFolders"}
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        config = compose(stage, return_hydra_config=True)
    expected = {key: {"_target_": f"pipeline.sweep.{name}"} for key, name in callback.items()}
    assert OmegaConf.to_container(config.hydra.callbacks) == expected
    for made in (SweepTable(), OwnFolders()):
        assert made.on_job_end(OmegaConf.create(), JobReturn()) is None


@pytest.mark.parametrize(
    ("stage", "overrides", "jobs"),
    [
        ("plan", ["output=out/x", "+changes.seed=1,2"], (0, 1)),
        ("plan", ["output=out/x,out/y,out/../out/x"], (0, 2)),
        ("plan", ["problem=a.yaml,b.yaml", "output=out/x,out/y"], (0, 2)),
        ("plan", ["output=out/${hydra:job.num}", "+changes.seed=1,2"], None),
        ("plan", ["output=out/x,out/y"], None),
        ("scenes", ["environment.parameters.seed=1,2"], (0, 1)),
        ("scenes", ["profile=quick,standard"], None),
        ("scenes", ["profile=quick,standard", "environment.parameters.seed=1,2"], (0, 1)),
        ("train", ["training.seed=choice(1,2)", "profile.name=a,b"], (0, 2)),
        ("report", ["profile=quick,standard"], (0, 1)),
        ("report", ["profile=quick,standard", "output=out/${profile.name}"], None),
        ("bench", ["contest.seed=1,2"], None),  # prints only
        ("bench", ["contest.seed=1,2", "output=page.md"], (0, 1)),
        ("tune", ["training.seed=1,2"], None),
        ("tune", ["training.seed=1,2", "hydra.sweep.subdir=x"], (0, 1)),
        ("scenes", ["workers=1"], None),
    ],
)
def test_no_two_jobs_write_the_same_place(stage, overrides, jobs, monkeypatch, tmp_path, capsys):
    """A sweep of which two jobs would write one folder or page ends before the first, naming both; others begin."""
    begun = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(HydraConfig.instance(), "cfg", None)
    GlobalHydra.instance().clear()
    hydra = Hydra.create_main_hydra2("test", create_config_search_path(str(ROOT / "conf")))
    try:
        if jobs is None:
            hydra.multirun(stage, begun.append, overrides)
            assert begun
            return
        with pytest.raises(SystemExit, match="1"):
            hydra.multirun(stage, begun.append, overrides)
    finally:
        GlobalHydra.instance().clear()
    said = capsys.readouterr().err
    assert said.startswith(f"ConfigError: jobs {jobs[0]} and {jobs[1]} of this sweep would write the same place (")
    assert said.count("\n") == 1 and begun == [] and list(tmp_path.iterdir()) == []
