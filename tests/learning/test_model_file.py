"""The model file: what goes in comes out, and nothing else is let in."""

import os
import pickle
import warnings
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipeline.errors import ArtifactError
from pipeline.learning.compnetx import CompnetxNetwork, load_model, save_model
from pipeline.learning.store import SCHEMA


def edited(path, target, **changes) -> None:
    torch.save({**torch.load(path, weights_only=True), **changes}, target)


def test_round_trip(model, tmp_path):
    """A model read back has the same sizes, kinds of tasks and weights; equal models make equal bytes."""
    path = tmp_path / "deep" / "model.pt"
    save_model(model, path)
    back = load_model(path)
    assert back.parameters == model.parameters
    assert back.kinds == model.kinds
    for name, value in model.network.state_dict().items():
        assert torch.equal(back.network.state_dict()[name], value)
    save_model(back, tmp_path / "again.pt")
    assert path.read_bytes() == (tmp_path / "again.pt").read_bytes()


def test_behaves_the_same(model, tmp_path):
    """A model read back samples what the stored one samples, centring included."""
    kind = model.kinds[0]
    model = replace(model, kinds=(replace(kind, codec=replace(kind.codec, centre=True)),))
    save_model(model, tmp_path / "model.pt")
    voxels, q = np.ones((40, 40, 40), bool), np.array([[0.1, 0.2, 1.0]])
    samples = []
    for one in (model, load_model(tmp_path / "model.pt")):
        network = CompnetxNetwork(one)
        network.encode("scene", voxels)
        samples.append(network.sample("scene", q, q, np.random.default_rng(0)))
    assert np.array_equal(*samples)


def test_missing(tmp_path):
    """A missing model says which stage writes it."""
    with pytest.raises(ArtifactError, match="make repro"):
        load_model(tmp_path / "model.pt")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_truncated(model, tmp_path, share):
    """Half a file is refused, whatever half."""
    path = tmp_path / "model.pt"
    save_model(model, path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(ArtifactError, match="truncated or foreign"):
        load_model(path)


def test_foreign(model, tmp_path):
    """Other files, other schemas, other versions and other sizes are refused by name."""
    path, other = tmp_path / "model.pt", tmp_path / "other.pt"
    save_model(model, path)
    other.write_text("not a model")
    with pytest.raises(ArtifactError, match="truncated or foreign"):
        load_model(other)
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("a", "b")
    with pytest.raises(ArtifactError, match="truncated or foreign"):
        load_model(other)
    torch.save({"weights": 1}, other)
    with pytest.raises(ArtifactError, match=f"schema 'none', expected '{SCHEMA}'"):
        load_model(other)
    torch.save(torch.zeros(3), other)
    with pytest.raises(ArtifactError, match="schema 'none'"):
        load_model(other)
    edited(path, other, version=99)
    with pytest.raises(ArtifactError, match="version 99"):
        load_model(other)
    edited(path, other, network={"width": 3})
    with pytest.raises(ArtifactError, match="does not fit"):
        load_model(other)
    stored = torch.load(path, weights_only=True)
    edited(path, other, network={**stored["network"], "scene_code": 64})
    with pytest.raises(ArtifactError, match="does not fit"):
        load_model(other)
    name, weight = list(stored["weights"].items())[3]
    for value in (float("nan"), float("-inf")):
        edited(path, other, weights={**stored["weights"], name: torch.full_like(weight, value)})
        with pytest.raises(ArtifactError, match=f"other.pt: weights '{name}' are not all finite"):
            load_model(other)
    (kind,) = stored["kinds"]
    two = {"lower": [0.0, 0.0], "upper": [1.0, 1.0], "turning": [False, False], "centre": False}
    said, word = {"lower": [1.0], "upper": [0.0]}, {**kind["codec"], "centre": "no"}
    changes = (said, {"codec": word}, {"codec": two}, {"codec": {}}, {"joints": ["x"]}, {"joints": 3})
    for wrong in (*({**kind, **change} for change in changes), {"rows": []}):
        edited(path, other, kinds=[wrong])
        with pytest.raises(ArtifactError, match="does not fit"):
            load_model(other)
    edited(path, other, kind="another")
    with pytest.raises(ArtifactError, match=r"kind 'another'.*reads 'compnetx'"):
        load_model(other)
    for wrong in (3, {1: weight}):
        edited(path, other, weights=wrong)
        with pytest.raises(ArtifactError, match="no weights"):
            load_model(other)
    for wrong in (weight.double(), weight.to_sparse(), torch.zeros(1).expand(weight.shape), 3.0, weight.to("meta")):
        edited(path, other, weights={**stored["weights"], name: wrong})
        with pytest.raises(ArtifactError, match=r"no plain tensor|does not fit|truncated or foreign"):
            load_model(other)
    for key in ("schema", "version", "kind"):
        edited(path, other, **{key: torch.ones(2)})
        with pytest.raises(ArtifactError, match=key):
            load_model(other)


class Trojan:
    """Unpickled, it would run code."""

    def __reduce__(self):
        return print, ("code from a file",)


def test_no_code(tmp_path, capsys):
    """A file that would run code when read is refused unread."""
    torch.save({"schema": SCHEMA, "version": 1, "network": Trojan()}, tmp_path / "model.pt")
    with pytest.raises(ArtifactError, match="truncated or foreign"):
        load_model(tmp_path / "model.pt")
    assert "code from a file" not in capsys.readouterr().out


def pickled(path) -> None:
    path.write_bytes(pickle.dumps({"schema": SCHEMA, "network": Trojan()}))


def pickled_by_torch(path) -> None:
    torch.save({"schema": SCHEMA, "network": Trojan()}, path)


def pickled_by_torch_of_old(path) -> None:
    torch.save({"schema": SCHEMA, "network": Trojan()}, path, _use_new_zipfile_serialization=False)


def a_whole_module(path) -> None:
    torch.save(torch.nn.Linear(2, 2), path)


class Doubled(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return 2 * x


def a_program(path) -> None:
    with warnings.catch_warnings(action="ignore"):
        torch.jit.script(Doubled()).save(str(path))


def cut(path) -> None:
    torch.save({"schema": SCHEMA, "weights": torch.zeros(1000)}, path)
    path.write_bytes(path.read_bytes()[:2000])


def text(path) -> None:
    path.write_text("not a model")


@pytest.mark.parametrize(
    "write", [pickled, pickled_by_torch, pickled_by_torch_of_old, a_whole_module, a_program, cut, text]
)
def test_the_refusal_is_ours(write, tmp_path, capfd, recwarn):
    """Whatever the file is, the error is one line of ours: nothing of torch's advice to load it unsafely is passed on.

    No code of the file runs, and torch prints and warns of nothing.
    """
    write(tmp_path / "model.pt")
    said = r"\A[^\n]*model\.pt is not a readable model \(truncated or foreign\)[^\n]*\Z"
    with pytest.raises(ArtifactError, match=said) as caught:
        load_model(tmp_path / "model.pt")
    for word in ("weights_only", "PyTorch", "trust", "Re-running", "arbitrary", "\x1b"):
        assert word not in str(caught.value)
    assert capfd.readouterr() == ("", "") and not recwarn.list


@pytest.mark.parametrize("what", ["/dev/zero", "fifo"])
def test_what_is_no_ordinary_file_is_not_read(what, tmp_path):
    """A device or a pipe in the place of a model is refused at once: reading it might never end."""
    if what == "fifo":
        os.mkfifo(tmp_path / "model.pt")
    else:
        (tmp_path / "model.pt").symlink_to(what)
    with pytest.raises(ArtifactError, match=r"model\.pt does not exist"):
        load_model(tmp_path / "model.pt")
