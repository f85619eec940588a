"""The engine trains whatever learns: several terms, several optimisers, resumable and repeatable like any other."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from torch import nn

from pipeline.learning.engine import Job, Trained, TrainParameters, train
from pipeline.learning.learner import Learner, warmed_up

PARAMETERS = TrainParameters(epochs=4, batch_size=16, learning_rate=0.05, seed=3)
DATA = np.random.default_rng(0).normal(size=(64, 2)).astype(np.float32)


class Rows:
    """Batches of rows in an order of the epoch."""

    def __init__(self, epoch: Callable[[], int] | None) -> None:
        self.epoch = epoch

    def __len__(self) -> int:
        return 4

    def __iter__(self) -> Iterator[torch.Tensor]:
        order = np.arange(64) if self.epoch is None else np.random.default_rng(self.epoch()).permutation(64)
        yield from torch.from_numpy(DATA[order]).split(16)


class Autoencoder(Learner):
    """Two terms of which the sum is minimised."""

    def __init__(self) -> None:
        super().__init__(nn.Sequential(nn.Linear(2, 1), nn.Linear(1, 2)), PARAMETERS.learning_rate)

    def size(self, batch):
        return len(batch)

    def terms(self, batch):
        code = self.network[0](batch)
        error = (self.network[1](code) - batch).square().sum(dim=1).mean()
        size = code.square().mean()
        return {"loss": error + 0.1 * size, "error": error, "size": size}

    def configure_optimizers(self):
        return warmed_up(torch.optim.Adam(self.parameters(), lr=self.learning_rate), 3)


class Adversaries(Learner):
    """A generator and a critic that take steps by turns, each with its own optimiser."""

    def __init__(self) -> None:
        super().__init__(nn.Linear(1, 2), PARAMETERS.learning_rate)
        self.critic = nn.Linear(2, 1)
        self.automatic_optimization = False

    def size(self, batch):
        return len(batch)

    def made(self, batch):
        return self.network(batch[:, :1])

    def terms(self, batch):
        return {"loss": self.critic(self.made(batch)).square().mean()}

    def training_step(self, batch, index):
        of_generator, of_critic = self.optimizers()
        told = (self.critic(batch) - self.critic(self.made(batch).detach())).square().mean()
        of_critic.zero_grad()
        self.manual_backward(-told.tanh())
        of_critic.step()
        terms = self.terms(batch)
        of_generator.zero_grad()
        self.manual_backward(terms["loss"])
        of_generator.step()
        self.note({**terms, "told_apart": told}, self.size(batch))

    def configure_optimizers(self):
        return [torch.optim.Adam(net.parameters(), lr=self.learning_rate) for net in (self.network, self.critic)]


def run(learner: Callable[[], Learner], scratch: Path, **changes: object) -> Trained:
    def batches(epoch: Callable[[], int]) -> Iterable[torch.Tensor]:
        return Rows(epoch)

    job = Job(learner, batches, Rows(None), [learner.__name__, DATA], Path(__file__))
    return train(TrainParameters(**{**vars(PARAMETERS), **changes}), job, scratch)


def test_any_terms_are_columns(tmp_path):
    """Every term is a column of training and of validation, the mean over all examples, and a metric of the best."""
    trained = run(Autoencoder, tmp_path)
    names = [f"{part}_{name}" for part in ("train", "val") for name in ("loss", "error", "size")]
    assert trained.curves.columns.tolist() == ["epoch", *names]
    curves, best = trained.curves, trained.metrics["best_epoch"]
    assert (curves["val_loss"] - curves["val_error"] - 0.1 * curves["val_size"]).abs().max() < 1e-5
    assert trained.metrics["val_error"] == curves["val_error"][best]
    network = nn.Sequential(nn.Linear(2, 1), nn.Linear(1, 2))
    network.load_state_dict(trained.weights)
    error = (network(torch.from_numpy(DATA)) - torch.from_numpy(DATA)).square().sum(dim=1).mean().item()
    assert error == pytest.approx(trained.metrics["val_error"], rel=1e-5)


@pytest.mark.parametrize("learner", [Autoencoder, Adversaries])
def test_continued(learner, tmp_path, monkeypatch):
    """A run stopped in the middle of an epoch and continued ends with the weights and curves of an unbroken one."""
    whole = run(learner, tmp_path / "whole")
    step = learner.training_step

    def stopping(self, batch, index):
        if (self.current_epoch, index) == (2, 1):
            raise InterruptedError
        return step(self, batch, index)

    monkeypatch.setattr(learner, "training_step", stopping)
    with pytest.raises(InterruptedError):
        run(learner, tmp_path / "broken")
    monkeypatch.setattr(learner, "training_step", step)
    continued = run(learner, tmp_path / "broken")
    assert set(continued.weights) == set(whole.weights)
    assert all(torch.equal(continued.weights[name], value) for name, value in whole.weights.items())
    pd.testing.assert_frame_equal(continued.curves, whole.curves, check_exact=True)


def test_what_a_learner_notes_is_kept(tmp_path):
    """Adversaries that take their own steps have columns of what they noted; only the network's weights are given."""
    trained = run(Adversaries, tmp_path)
    assert trained.curves.columns.tolist() == ["epoch", "train_loss", "train_told_apart", "val_loss"]
    assert set(trained.weights) == {"weight", "bias"}
