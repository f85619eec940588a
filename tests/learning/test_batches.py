"""Batches: every pair once, every scene once, an order of seed and epoch."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_training import LIMITS, SMALL, make_pairs

from pipeline.errors import ConfigError
from pipeline.learning.compnetx.batches import Batches
from pipeline.learning.compnetx.pairs import Pairs


def serve(pairs: Pairs, epoch: int | None, size: int = 64, seed: int = 5) -> list:
    return list(Batches(pairs, SMALL, size, seed, None if epoch is None else lambda: epoch))


def configurations(X: np.ndarray) -> np.ndarray:
    return LIMITS.decode(X.astype(float))


def rows(batches: list) -> np.ndarray:
    """Scene, current, target and following of all pairs, in the order served and in the robot's units."""
    parts = [
        torch.cat([b.scenes[b.row][:, None], *(q * 1.0 for q in (b.current, b.target, b.following))], dim=1)
        for b in batches
    ]
    table = torch.cat(parts).double().numpy()
    for i in (1, 4, 7):
        table[:, i : i + 3] = LIMITS.decode(table[:, i : i + 3])
    return table


def test_every_pair_once():
    """An epoch serves every pair once, with its own scene, in another order than it came."""
    pairs = make_pairs(300, [0, 2, 3], 1)
    batches = serve(pairs, epoch=4)
    assert [len(b.row) for b in batches] == [64, 64, 64, 64, 44]
    assert len(Batches(pairs, SMALL, 64, 5, None)) == 5
    expected = np.concatenate(
        [pairs.scene[:, None], *map(configurations, (pairs.current, pairs.target, pairs.following))], axis=1
    )
    found = rows(batches)
    assert not np.allclose(found, expected, atol=1e-5)
    order, own = np.lexsort(found.T[:2]), np.lexsort(expected.T[:2])
    np.testing.assert_allclose(found[order], expected[own], atol=1e-6)


def test_scenes_once():
    """A batch names each of its scenes once."""
    for batch in serve(make_pairs(300, [0, 2, 3], 1), epoch=0, size=7):
        assert len(torch.unique(batch.scenes)) == len(batch.scenes) <= 3
        assert set(batch.row.tolist()) == set(range(len(batch.scenes)))


def test_order_of_seed_and_epoch():
    """Order and masks follow from seed and epoch, whatever was served before; without an epoch they stay."""
    pairs = make_pairs(100, [0, 1], 1)
    clock = iter([3, 4, 3])
    running = Batches(pairs, SMALL, 64, 5, lambda: next(clock))
    third, fourth, again = list(running), list(running), list(running)
    for one, two in zip(third, again, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, two, strict=True))
    assert not torch.equal(third[0].current, fourth[0].current)
    assert not torch.equal(third[0].masks, fourth[0].masks)
    assert not torch.equal(third[0].current, serve(pairs, 3, seed=6)[0].current)
    assert torch.equal(third[0].masks, serve(pairs, 3)[0].masks)
    still = serve(pairs, None)
    np.testing.assert_allclose(rows(still)[:, 1:4], configurations(pairs.current), atol=1e-6)
    assert torch.equal(still[1].masks, serve(pairs, None)[1].masks)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"voxels": np.zeros((5, 12, 13, 13), bool)}, r"\(5, 12, 13, 13\)"),
        ({"voxels": np.zeros((3, 13, 13, 13), bool)}, r"tasks has shape \(5, 0\); the network expects \(3, 0\)"),
        ({"train": make_pairs(9, [7], 0)}, "name scene 7; there are 5 grids"),
        ({"tasks": np.zeros((5, 2))}, r"tasks has shape \(5, 2\); the network expects \(5, 0\)"),
        ({"validation": make_pairs(9, [2, 4], 0)}, r"scenes \[2\] are in training and in validation"),
        ({"validation": make_pairs(0, [1], 0)}, "no validation pairs"),
    ],
)
def test_refused(data, change, message):
    """Data that does not fit the network, or validates on its training scenes, is refused by name."""
    with pytest.raises(ConfigError, match=message):
        replace(data, **change).check(SMALL)
    with pytest.raises(ConfigError, match=r"used has shape \(5, 3\); the network expects \(5, 4\)"):
        data.check(replace(SMALL, width=4))
