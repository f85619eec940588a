"""Training: repeatable to the byte, resumable after a kill, and it learns."""

import errno
import logging
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from small_training import KINDS, SMALL, make_data, make_pairs

from pipeline.errors import ArtifactError, ConfigError
from pipeline.learning import engine
from pipeline.learning.compnetx import Compnetx, NetworkParameters, save_model
from pipeline.learning.compnetx.batches import Batches, TrainingData
from pipeline.learning.compnetx.learner import CompnetxLearner
from pipeline.learning.compnetx.recipe import train_network
from pipeline.learning.engine import TrainParameters

ROOT = Path(__file__).parents[2]
PARAMETERS = TrainParameters(epochs=5, batch_size=64, warmup=4.0, seed=3)  # a killed run dies in the warm-up

KILLED = """
import os, signal
from pathlib import Path
from small_training import make_data
from test_training import CompnetxLearner, run

step = CompnetxLearner.training_step

def deadly(self, batch, index):
    if (self.current_epoch, index) == (3, 2):
        os.kill(os.getpid(), signal.SIGKILL)
    return step(self, batch, index)

CompnetxLearner.training_step = deadly
run(make_data(), Path("broken"))
"""


def run(data: TrainingData, scratch: Path, network: NetworkParameters = SMALL, **changes) -> SimpleNamespace:
    """What `Trained` has, and the model."""
    model, trained = train_network(replace(PARAMETERS, **changes), network, KINDS, data, scratch)
    return SimpleNamespace(model=model, **vars(trained))


def stored(trained: SimpleNamespace, path: Path) -> bytes:
    save_model(trained.model, path)
    return path.read_bytes()


def last_weights(scratch: Path) -> dict[str, torch.Tensor]:
    (checkpoint,) = scratch.glob("*/last.ckpt")
    return torch.load(checkpoint, weights_only=True)["state_dict"]


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory) -> tuple[SimpleNamespace, Path]:
    scratch = tmp_path_factory.mktemp("unbroken")
    return run(make_data(), scratch), scratch


def process(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own, in a folder."""
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(Path(__file__).parent)])},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def folders(path: Path) -> list[Path]:
    """Folders in a folder."""
    return [entry for entry in path.iterdir() if entry.is_dir()]


def test_killed_and_continued(data, unbroken, tmp_path):
    """A run killed in the middle of an epoch and continued ends with the bytes and the curves of an unbroken one."""
    killed = process(KILLED, tmp_path)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    (folder,) = folders(tmp_path / "broken")
    assert len(pd.read_csv(folder / "curves.csv")) == 3
    continued, (whole, scratch) = run(data, tmp_path / "broken"), unbroken
    assert folders(tmp_path / "broken") == [folder]
    assert stored(continued, tmp_path / "a.pt") == stored(whole, tmp_path / "b.pt")
    pd.testing.assert_frame_equal(continued.curves, whole.curves, check_exact=True)
    assert (folder / "curves.csv").read_bytes() == (scratch / folder.name / "curves.csv").read_bytes()
    assert continued.metrics == whole.metrics
    one, two = last_weights(tmp_path / "broken"), last_weights(scratch)
    assert all(torch.equal(one[name], two[name]) for name in two)


@pytest.mark.parametrize("name", ["last.ckpt", "best.ckpt"])
@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"foreign"])
def test_unreadable_checkpoint_is_begun_again(data, unbroken, tmp_path, caplog, name, damage):
    """A run whose checkpoint is cut off, empty or foreign begins again, says so, and ends with the same bytes."""
    run(data, tmp_path, epochs=PARAMETERS.epochs)
    (path,) = tmp_path.glob(f"*/{name}")
    path.write_bytes(damage(path.read_bytes()))
    with caplog.at_level(logging.WARNING):
        again = run(data, tmp_path)
    assert stored(again, tmp_path / "a.pt") == stored(unbroken[0], tmp_path / "b.pt")
    assert f"{name} cannot be read" in caplog.text and "begins again" in caplog.text


def test_killed_while_a_checkpoint_is_written(data, unbroken, tmp_path, monkeypatch):
    """When writing a checkpoint fails half-way, the one before it is still whole and training goes on from it."""
    save, written = Path.write_bytes, []

    def failing(path, content):
        written.append(path)
        if len(written) == 6:
            save(path, b"half")
            raise OSError(errno.ENOSPC, "No space left on device")
        return save(path, content)

    monkeypatch.setattr(Path, "write_bytes", failing)
    with pytest.raises(ArtifactError, match=r"\.ckpt cannot be written: No space left on device"):
        run(data, tmp_path)
    monkeypatch.setattr(Path, "write_bytes", save)
    (folder,) = folders(tmp_path)
    for path in folder.glob("*.ckpt"):
        torch.load(path, weights_only=True)
    assert not list(folder.glob("*.partial"))
    assert stored(run(data, tmp_path), tmp_path / "a.pt") == stored(unbroken[0], tmp_path / "b.pt")


def test_sigterm_is_no_success(data, tmp_path):
    """SIGTERM ends a training with status 143 and a line that says how far it came."""
    ended = process(KILLED.replace("SIGKILL", "SIGTERM"), tmp_path)
    assert ended.returncode == 143, ended.stderr
    assert f"ended by SIGTERM after 3 of {PARAMETERS.epochs} epochs" in ended.stderr


def test_lines_tell_where_training_stands(data, tmp_path, caplog):
    """Without a terminal the log says which epoch is done, the last one in any case."""
    with caplog.at_level(logging.INFO):
        trained = run(data, tmp_path, epochs=2)
    (line,) = (record.message for record in caplog.records if record.message.startswith("train: "))
    assert line.startswith(f"train: epoch 2 of 2, validation loss {trained.curves['val_loss'].iloc[-1]:.4f} after ")


def test_repeatable(data, unbroken, tmp_path):
    """Equal seeds give equal bytes, whatever chance torch had used before; another seed gives another model."""
    torch.rand(7)
    before = torch.random.get_rng_state(), torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    again = run(data, tmp_path / "again")
    whole = stored(unbroken[0], tmp_path / "a.pt")
    assert stored(again, tmp_path / "b.pt") == whole
    assert stored(run(data, tmp_path / "other", seed=4), tmp_path / "c.pt") != whole
    assert torch.equal(before[0], torch.random.get_rng_state())
    assert before[1:] == (torch.get_num_threads(), torch.are_deterministic_algorithms_enabled())


def test_finished(data, unbroken, tmp_path):
    """A finished run, asked for again, answers the same without a step."""
    whole, scratch = unbroken
    again = run(data, scratch)
    assert again.steps_per_second is None
    assert whole.steps_per_second > 0
    assert stored(again, tmp_path / "a.pt") == stored(whole, tmp_path / "b.pt")
    pd.testing.assert_frame_equal(again.curves, whole.curves, check_exact=True)


def test_other_code_trains_anew(data, unbroken, tmp_path, monkeypatch):
    """A finished run of other code, or with other packages, is no answer: training begins again beside it."""
    shutil.copytree(unbroken[1], tmp_path / "scratch")
    monkeypatch.setattr(engine, "code_digest", lambda *_: "another")
    assert run(data, tmp_path / "scratch", epochs=PARAMETERS.epochs).steps_per_second > 0
    assert len(folders(tmp_path / "scratch")) == 2


def test_best(data, unbroken):
    """The model is that of the lowest validation loss, and the curve's number can be computed anew from it."""
    trained = unbroken[0]
    curves = trained.curves
    assert curves.columns.tolist() == ["epoch", "train_loss", "val_loss"]
    assert curves["epoch"].tolist() == [0, 1, 2, 3, 4]
    metrics = trained.metrics
    assert metrics["val_loss"] == curves["val_loss"].min() == curves["val_loss"][metrics["best_epoch"]]
    assert (metrics["train_pairs"], metrics["validation_pairs"]) == (300, 70)
    assert (metrics["train_scenes"], metrics["validation_scenes"]) == (3, 2)
    network, pairs = trained.model.network, data.validation
    torch.manual_seed(0)
    rounds, losses = 400, []
    codes = network.encode(torch.from_numpy(data.voxels).float())[torch.from_numpy(pairs.scene)]
    inputs = [torch.from_numpy(X) for X in (pairs.current, pairs.target)]
    for _ in range(rounds):
        masks = (torch.rand(len(pairs), SMALL.dropout_units) < 0.5) * 2.0
        with torch.no_grad():
            error = network(codes, *inputs, masks).numpy() - pairs.following
        losses.append(float((error**2).sum(axis=1).mean()))
    assert np.mean(losses) == pytest.approx(metrics["val_loss"], abs=5 * np.std(losses))


def test_gradient_of_a_batch(data):
    """Encoding each scene once and gathering gives the loss and gradients of encoding every pair's scene for itself."""
    torch.manual_seed(0)
    network = Compnetx(SMALL)
    voxels = torch.from_numpy(data.voxels).float()
    module = CompnetxLearner(network, data, 0.01)
    batch = next(iter(Batches(data.train, SMALL, 64, 0, lambda: 0)))
    loss = module.training_step(batch, 0)
    found = torch.autograd.grad(loss, network.parameters())
    codes = network.encode(voxels[batch.scenes[batch.row]])
    answer = network(codes, batch.current, batch.target, batch.masks)
    plain = ((answer - batch.following) ** 2).sum() / len(batch.row)
    assert loss.item() == pytest.approx(plain.item(), rel=1e-5)
    for one, two in zip(found, torch.autograd.grad(plain, network.parameters()), strict=True):
        torch.testing.assert_close(one, two, rtol=1e-3, atol=1e-6)


def test_learns(data, tmp_path):
    """Without dropout, the small network learns a smooth map to a tenth of what answering the mean would cost."""
    data = replace(data, train=make_pairs(4000, [0, 2, 3], 1), validation=make_pairs(300, [1, 4], 2))
    trained = run(data, tmp_path, replace(SMALL, dropout=0.0), epochs=8, warmup=0.0)
    answers = data.validation.following
    assert trained.metrics["val_loss"] < 0.1 * answers.var(axis=0).sum()


def test_warm_up(data):
    """The learning rate rises by equal steps to the one asked for and stays; without a warm-up it is that at once."""
    module = CompnetxLearner(Compnetx(SMALL), data, 0.01, warmup=4)
    found = module.configure_optimizers()
    optimizer, rise = found["optimizer"], found["lr_scheduler"]
    assert rise["interval"] == "step"
    rates = []
    for _ in range(6):
        rates.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        rise["scheduler"].step()
    np.testing.assert_allclose(rates, [0.0025, 0.005, 0.0075, 0.01, 0.01, 0.01])
    plain = CompnetxLearner(Compnetx(SMALL), data, 0.01).configure_optimizers()
    assert plain.param_groups[0]["lr"] == 0.01


def test_moved_folder(data, tmp_path):
    """A best.ckpt that is not of the best epoch, as after an edit by hand, is refused and not published."""
    trained = run(data, tmp_path, epochs=2)
    (best,) = tmp_path.glob("*/best.ckpt")
    content = torch.load(best, weights_only=True)
    torch.save({**content, "epoch": content["epoch"] + 1}, best)
    with pytest.raises(ArtifactError, match=f"the best was {trained.metrics['best_epoch']}"):
        run(data, tmp_path, epochs=2)


def test_diverged(data, tmp_path):
    """A training that diverges says so, with the learning rate to lower."""
    train_pairs = replace(data.train, following=data.train.following * np.float32(1e30))
    with pytest.raises(ConfigError, match=r"diverged.*now 0\.01"):
        run(replace(data, train=train_pairs), tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epochs": 0}, "epochs is 0"),
        ({"batch_size": 0}, "batch_size is 0"),
        ({"learning_rate": 0.0}, r"learning_rate is 0\.0"),
        ({"warmup": -1.0}, r"warmup is -1\.0"),
        ({"threads": 0}, "threads is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_refused(change, message):
    """A value that cannot be trained with is refused with the value in the message."""
    with pytest.raises(ConfigError, match=message):
        replace(PARAMETERS, **change)


def test_planning_waits_for_no_lightning():
    """Importing what planning needs does not import Lightning (three seconds)."""
    code = "import sys, pipeline.learning.choices; sys.exit('lightning' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
