"""Sampling at planning time: numpy says what torch says."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch
from small_training import KINDS, LIMITS

from pipeline.errors import ArtifactError, ProblemError
from pipeline.learning.compnetx import Compnetx, CompnetxNetwork, Model, NetworkParameters
from pipeline.learning.dropout import draw_masks
from pipeline.learning.products import Bytes, Products, Tiles, fastest_products

VOXELS = np.random.default_rng(0).random((40, 40, 40)) < 0.1


def ask(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    current, target = np.random.default_rng(seed).uniform(LIMITS.lower, LIMITS.upper, (2, count, 3))
    return current, target


def by_torch(model: Model, voxels: np.ndarray, current, target, masks, task=None) -> np.ndarray:
    """The same answer from the torch modules in double precision, nothing folded."""
    network, codec = pickle.loads(pickle.dumps(model.network)).double(), model.kinds[0].codec
    with torch.no_grad():
        grids = torch.from_numpy(voxels).double()[None]
        code = network.encode(grids, None if task is None else torch.from_numpy(task)[None])
        inputs = [torch.from_numpy(codec.encode(q)) for q in (current, target)]
        answer = network(code.expand(len(current), -1), *inputs, torch.from_numpy(masks).double())
    return codec.decode(answer.numpy())


@pytest.mark.parametrize("centre", [False, True])
@pytest.mark.parametrize("count", [1, 2, 20])
def test_as_torch(model, count, centre):
    """With the same masks, numpy's folded layers answer what torch's layers do, to single precision."""
    model = replace(model, kinds=(replace(KINDS[0], codec=replace(LIMITS, centre=centre)),))
    network = CompnetxNetwork(model, Products.SINGLE)
    network.encode("scene", VOXELS)
    current, target = ask(count)
    masks = draw_masks(np.random.default_rng(2), count, model.parameters.dropout_units, 0.5)
    found = network.evaluate("scene", current, target, masks)
    assert found.shape == (count, 3)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, by_torch(model, VOXELS, current, target, masks), atol=2e-6)


@pytest.mark.parametrize("products", [Products.TILES, Products.BYTES])
def test_narrow_products(model, products):
    """Batches in bfloat16 or bytes stay near what torch says in double precision; a few rows do not go that way."""
    narrow, plain = CompnetxNetwork(model, products), CompnetxNetwork(model, Products.SINGLE)
    for network in (narrow, plain):
        network.encode("scene", VOXELS)
    apart = []
    for count in (1, 7, 8, 100):
        current, target = ask(count)
        masks = draw_masks(np.random.default_rng(2), count, model.parameters.dropout_units, 0.5)
        found = narrow.evaluate("scene", current, target, masks)
        np.testing.assert_allclose(found, by_torch(model, VOXELS, current, target, masks), atol=0.01)
        apart.append(np.abs(found - plain.evaluate("scene", current, target, masks)).max())
    assert apart[:2] == [0, 0] and min(apart[2:]) > 1e-6
    assert fastest_products() in Products
    copy = pickle.loads(pickle.dumps(narrow))
    np.testing.assert_array_equal(copy.evaluate("scene", current, target, masks), found)


@pytest.mark.parametrize("narrow, atol", [(Tiles, 2**-8), (Bytes, 1 / 127)])
@pytest.mark.parametrize("inputs", ["both signs", "negative", "zero"])
def test_narrow_layers(narrow, atol, inputs):
    """A product errs by the rounding of its factors alone, whatever their sign and scale, zero included."""
    rng = np.random.default_rng(3)
    x, weight = rng.normal(size=(9, 64)), rng.normal(size=(64, 32)) * np.logspace(-3, 2, 32)
    x = {"both signs": x, "negative": -5.0 * np.abs(x), "zero": 0.0 * x}[inputs].astype(np.float32)
    weight[:, 0] = 0.0
    weight = weight.astype(np.float32)
    exact, largest = x.astype(float) @ weight, np.abs(x).max() * np.abs(weight).max(axis=0)
    apart = np.abs(narrow(weight)(x) - exact)
    assert (apart <= 64 * atol * largest).all()
    assert (apart.mean(axis=0) <= 8 * atol * largest).all()  # roundings are as often up as down


def test_task(model):
    """A task representation is folded as the scene is."""
    parameters = NetworkParameters(width=3, grid=13, task_input=10, dropout_layers=3, dropout=0.2)
    torch.manual_seed(1)
    kinds = (replace(KINDS[0], lower=(0.0,) * 10, upper=(1.0,) * 10),)
    model = Model(parameters, kinds, Compnetx(parameters).eval())
    network = CompnetxNetwork(model)
    voxels, task = VOXELS[:13, :13, :13], np.arange(10.0)
    network.encode(("scene", 3), voxels, task)
    current, target = ask(4)
    masks = draw_masks(np.random.default_rng(2), 4, parameters.dropout_units, 0.2)
    found = network.evaluate(("scene", 3), current, target, masks)
    np.testing.assert_allclose(found, by_torch(model, voxels, current, target, masks, task), atol=2e-6)
    with pytest.raises(ArtifactError, match="expects 10 numbers"):
        network.encode("other", voxels)


def test_scene_matters(model):
    """Each key samples for its own scene, that of the grid it was encoded with last."""
    network = CompnetxNetwork(model)
    current, target = ask(5)
    network.encode("a", VOXELS)
    network.encode("b", ~VOXELS)
    a, b = (network.sample(key, current, target, np.random.default_rng(0)) for key in "ab")
    assert np.abs(a - b).max() > 1e-3
    network.encode("a", VOXELS)
    assert np.array_equal(network.sample("a", current, target, np.random.default_rng(0)), a)
    network.encode("a", ~VOXELS)
    assert np.array_equal(network.sample("a", current, target, np.random.default_rng(0)), b)


def test_chance(model):
    """Equal streams give equal samples; rows of a batch, and calls, differ; one target may serve all rows."""
    network = CompnetxNetwork(model)
    network.encode("scene", VOXELS)
    current, target = np.repeat(ask(1)[0], 20, axis=0), np.repeat(ask(1)[1], 20, axis=0)
    one, two = np.random.default_rng(7), np.random.default_rng(7)
    first = network.sample("scene", current, target, one)
    assert np.array_equal(first, network.sample("scene", current, target[0], two))
    assert len(np.unique(first, axis=0)) == 20
    assert not np.array_equal(first, network.sample("scene", current, target, one))


def test_processes(model):
    """A copy sent to another process samples the same, its encoded scenes included."""
    network = CompnetxNetwork(model)
    network.encode("scene", VOXELS)
    copy = pickle.loads(pickle.dumps(network))
    copy.encode("new", VOXELS)
    current, target = ask(3)
    samples = [n.sample(k, current, target, np.random.default_rng(0)) for n, k in ((network, "scene"), (copy, "new"))]
    assert np.array_equal(*samples)


def test_refused(model):
    """An unknown scene and a grid of another size are refused by name."""
    network = CompnetxNetwork(model)
    with pytest.raises(ProblemError, match="not encoded"):
        network.sample("nowhere", *ask(1), np.random.default_rng(0))
    with pytest.raises(ArtifactError, match=r"\(32, 32, 32\)"):
        network.encode("small", VOXELS[:32, :32, :32])
