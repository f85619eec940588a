"""A small network and small data, so that a training run takes a second."""

import numpy as np

from pipeline.learning.codec import Codec
from pipeline.learning.compnetx import NetworkParameters
from pipeline.learning.compnetx.batches import TrainingData
from pipeline.learning.compnetx.pairs import Pairs
from pipeline.learning.task_kinds import TaskKind

SMALL = NetworkParameters(
    width=3, grid=13, scene_hidden=9, scene_code=7, hidden=(24, 16, 8), dropout=0.5, dropout_layers=2
)
LIMITS = Codec((-1.0, -2.0, 0.5), (1.0, 3.0, 1.5))
KINDS = (TaskKind(("x", "y", "z"), ("row",), "", LIMITS),)


def make_pairs(count: int, scenes: list[int], seed: int) -> Pairs:
    rng = np.random.default_rng(seed)
    current, target = rng.uniform(LIMITS.lower, LIMITS.upper, (2, count, 3)).astype(np.float32)
    following = current + np.float32(0.1) * (target - current)
    return Pairs(rng.choice(scenes, count), current, target, following).encoded(LIMITS, 3)


def make_data() -> TrainingData:
    voxels = np.random.default_rng(0).random((5, 13, 13, 13)) < 0.2
    tasks, used = np.zeros((5, 0)), np.ones((5, 3), bool)
    return TrainingData(voxels, tasks, used, make_pairs(300, [0, 2, 3], 1), make_pairs(70, [1, 4], 2))
