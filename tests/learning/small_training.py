"""A small network and small data, so that a training run takes a second."""

import numpy as np

from pipeline.learning import NetworkParameters, Normalisation, Pairs, TrainingData

SMALL = NetworkParameters(
    dimension=3, grid=13, scene_hidden=9, scene_code=7, hidden=(24, 16, 8), dropout=0.5, dropout_layers=2
)
LIMITS = Normalisation((-1.0, -2.0, 0.5), (1.0, 3.0, 1.5))


def make_pairs(count: int, scenes: list[int], seed: int) -> Pairs:
    rng = np.random.default_rng(seed)
    current, target = rng.uniform(LIMITS.lower, LIMITS.upper, (2, count, 3)).astype(np.float32)
    return Pairs(rng.choice(scenes, count), current, target, current + np.float32(0.1) * (target - current))


def make_data() -> TrainingData:
    voxels = np.random.default_rng(0).random((5, 13, 13, 13)) < 0.2
    return TrainingData(voxels, make_pairs(300, [0, 2, 3], 1), make_pairs(70, [1, 4], 2))
