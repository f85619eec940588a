"""Training that was ended or found its folder damaged: what it says, what it leaves, and how it goes on."""

import logging
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from small_training import make_data
from test_training import KILLED, PARAMETERS, ROOT, folders, process, run, stored

from pipeline.learning import learner
from pipeline.learning.compnetx.learner import CompnetxLearner
from pipeline.learning.learner import Lines

# The stage as the command line runs it, on small data instead of the files of earlier stages.
STAGE = KILLED.replace(
    'run(make_data(), Path("broken"))',
    f"""
import runpy, sys
import pipeline.learning.recipe
pipeline.learning.recipe.train_recipe = lambda *_: (made := run(make_data(), Path("broken"))) and (made.model, made)
sys.argv = ["train.py"]
runpy.run_path({str(ROOT / "stages" / "train.py")!r}, run_name="__main__")
""",
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    """Return the model of an unbroken run."""
    scratch = tmp_path_factory.mktemp("whole")
    return stored(run(make_data(), scratch), scratch / "model.pt")


def no_curves(folder: Path) -> None:
    (folder / "curves.csv").unlink()


def no_best(folder: Path) -> None:
    (folder / "best.ckpt").unlink()


def foreign_last(folder: Path) -> None:
    torch.save([1], folder / "last.ckpt")


def foreign_best(folder: Path) -> None:
    torch.save([1], folder / "best.ckpt")


def last_without_optimiser(folder: Path) -> None:
    (folder / "last.ckpt").write_bytes((folder / "best.ckpt").read_bytes())


@pytest.mark.parametrize("damage", [no_curves, no_best, foreign_last, foreign_best, last_without_optimiser])
def test_inconsistent_folder_is_begun_again(data, whole, tmp_path, caplog, damage):
    """A folder that lacks a file, or holds torch's but no checkpoint, is begun again with one warning and equal end."""
    run(data, tmp_path)
    (folder,) = folders(tmp_path)
    curves = (folder / "curves.csv").read_bytes()
    damage(folder)
    with caplog.at_level(logging.WARNING):
        again = run(data, tmp_path)
    assert len([record for record in caplog.records if "begins again" in record.message]) == 1
    assert again.steps_per_second is not None
    assert stored(again, tmp_path / "model.pt") == whole
    assert (folder / "curves.csv").read_bytes() == curves


def test_nothing_of_a_damaged_run_stays(data, tmp_path, monkeypatch):
    """Before training begins again, all three files of the damaged run are gone."""
    run(data, tmp_path, epochs=1)
    (folder,) = folders(tmp_path)
    (folder / "last.ckpt").write_bytes(b"foreign")
    found = []

    def stop(self, batch, index):
        found.extend(path.name for path in folder.iterdir())
        raise InterruptedError

    monkeypatch.setattr(CompnetxLearner, "training_step", stop)
    with pytest.raises(InterruptedError):
        run(data, tmp_path, epochs=1)
    assert found == []


def test_stage_ended_by_sigterm(data, whole, tmp_path):
    """SIGTERM ends the stage with status 143 and one line on stderr, publishes nothing, and a repeat goes on there."""
    ended = process(STAGE.replace("SIGKILL", "SIGTERM"), tmp_path)
    assert ended.returncode == 143, ended.stderr
    (line,) = [line for line in ended.stderr.splitlines() if "SIGTERM" in line]
    assert (
        line == f"train: ended by SIGTERM after 3 of {PARAMETERS.epochs} epochs; repeating the command continues there"
    )
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "artifacts").exists()
    assert stored(run(data, tmp_path / "broken"), tmp_path / "model.pt") == whole


def test_stage_ended_by_ctrl_c(data, whole, tmp_path):
    """Ctrl-C ends the stage with status 130 and one line on stderr, publishes nothing, and a repeat goes on there."""
    ended = process(STAGE.replace("SIGKILL", "SIGINT"), tmp_path)
    assert (ended.returncode, ended.stderr) == (130, "interrupted; nothing is half-written\n")
    assert not (tmp_path / "artifacts").exists()
    (folder,) = folders(tmp_path / "broken")
    assert len((folder / "curves.csv").read_text().splitlines()) == 4
    assert stored(run(data, tmp_path / "broken"), tmp_path / "model.pt") == whole


def test_lines_keep_their_distance(monkeypatch, caplog):
    """Epochs of 5 s give a line every fourth epoch, the first that ends more than 15 s after the last line."""
    now = 100.0
    monkeypatch.setattr(learner, "time", SimpleNamespace(monotonic=lambda: now))
    caplog.set_level(logging.INFO)
    lines = Lines()
    for epoch in range(10):
        now += 5.0
        trainer = SimpleNamespace(current_epoch=epoch, max_epochs=30, callback_metrics={"val_loss": 0.5 / (epoch + 1)})
        lines.on_train_epoch_end(trainer, None)
    assert [record.message for record in caplog.records] == [
        "train: epoch 4 of 30, validation loss 0.1250 after 20 s",
        "train: epoch 8 of 30, validation loss 0.0625 after 40 s",
    ]
