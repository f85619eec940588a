"""Dropout masks drawn by numpy: one stream of chance for training, for validation and for planning.

The generator is stochastic only through its dropout, which stays on when it plans (compnetx.txt, section V-C). So the
masks are an input of the network, not a hidden state of torch: equal streams give equal samples, whichever library
multiplies the matrices. It is also cheaper: torch's own dropout took a sixth of a training step of 256 pairs.
"""

import numpy as np

# The eight bits of every byte as factors: at one half, a random byte decides eight units.
_HALVES = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).astype(np.float32) * 2.0


def draw_masks(rng: np.random.Generator, rows: int, units: int, probability: float) -> np.ndarray:
    """Draw the factors of inverted dropout (rows, units): 0 with `probability`, otherwise 1 / (1 - probability).

    Args:
        rng: the only source of chance.
        rows: samples.
        units: dropped-out units of all layers side by side (`NetworkParameters.dropout_units`).
        probability: of dropping a unit, at least 0 and below 1.
    """
    count = rows * units
    if probability == 0.5:
        # Raw words, because `integers` and `bytes` cost a single sample a tenth of its time; their lower halves,
        # because those of MT19937 have no upper one.
        words = rng.bit_generator.random_raw(-(-count // 32)).astype(np.uint32)
        return np.take(_HALVES, words.view(np.uint8), axis=0).reshape(-1)[:count].reshape(rows, units)
    kept = rng.random((rows, units), dtype=np.float32) >= probability
    return kept * np.float32(1 / (1 - probability))
