"""Dropout masks: right values, right odds, right order."""

import numpy as np
import pytest

from pipeline.learning.dropout import draw_masks


@pytest.mark.parametrize(
    ("probability", "source"), [(0.5, np.random.PCG64), (0.5, np.random.MT19937), (0.2, np.random.PCG64)]
)
def test_inverted_dropout(probability, source):
    """A factor is 0 with the given probability and otherwise keeps the mean at 1; units are independent."""
    masks = draw_masks(np.random.Generator(source(0)), 3000, 37, probability)
    assert masks.shape == (3000, 37)
    assert masks.dtype == np.float32
    assert set(np.unique(masks)) == {np.float32(0), np.float32(1 / (1 - probability))}
    dropped = (masks == 0).astype(float)
    sigma = np.sqrt(probability * (1 - probability) / 3000)
    assert np.abs(dropped.mean(axis=0) - probability).max() < 4.5 * sigma
    between = np.corrcoef(dropped.T) - np.eye(37)
    assert np.abs(between).max() < 5 / np.sqrt(3000)
    along = np.corrcoef(dropped[:-1].T, dropped[1:].T)[:37, 37:]
    assert np.abs(along).max() < 5 / np.sqrt(3000)


def test_stream():
    """Equal streams give equal masks, and the stream moves on."""
    one, two = np.random.default_rng(3), np.random.default_rng(3)
    first = draw_masks(one, 2, 1792, 0.5)
    assert np.array_equal(first, draw_masks(two, 2, 1792, 0.5))
    assert not np.array_equal(first, draw_masks(one, 2, 1792, 0.5))


def test_without_dropout():
    """No units make an empty mask; a probability of 0 keeps everything as it is."""
    assert draw_masks(np.random.default_rng(0), 4, 0, 0.5).shape == (4, 0)
    assert (draw_masks(np.random.default_rng(0), 4, 9, 0.0) == 1).all()
