"""The model file: what goes in comes out, and nothing else is let in."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipeline.errors import ArtifactError
from pipeline.learning import CompnetxNetwork, load_model, save_model
from pipeline.learning.model import SCHEMA


def edited(path, target, **changes) -> None:
    torch.save({**torch.load(path, weights_only=True), **changes}, target)


def test_round_trip(model, tmp_path):
    """A model read back has the same sizes, normalisation and weights; equal models make equal bytes."""
    path = tmp_path / "deep" / "model.pt"
    save_model(model, path)
    back = load_model(path)
    assert back.parameters == model.parameters
    assert back.normalisation == model.normalisation
    for name, value in model.network.state_dict().items():
        assert torch.equal(back.network.state_dict()[name], value)
    save_model(back, tmp_path / "again.pt")
    assert path.read_bytes() == (tmp_path / "again.pt").read_bytes()


def test_behaves_the_same(model, tmp_path):
    """A model read back samples what the stored one samples, centring included."""
    model = replace(model, normalisation=replace(model.normalisation, centre=True))
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
    with pytest.raises(ArtifactError, match="dvc repro"):
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
    edited(path, other, network={"dimension": 3})
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
    edited(path, other, normalisation={"lower": [0.0, 0.0], "upper": [1.0, 1.0], "centre": False})
    with pytest.raises(ArtifactError, match="does not fit"):
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
