"""Batches from tensors in memory, in an order that follows from seed and epoch alone.

No worker, no copy per item: torch's DataLoader gathers pairs one at a time in Python. A batch names each of its scenes
once, so that a scene is encoded once per batch and not once per pair.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from pipeline.errors import ConfigError
from pipeline.learning.compnetx.networks import NetworkParameters
from pipeline.learning.compnetx.pairs import Pairs
from pipeline.learning.dropout import draw_masks

_ORDER, _MASKS, _FIXED_MASKS = 0, 1, 2  # streams of chance


class Batch(NamedTuple):
    """B pairs from U scenes, as numbers of a network.

    Attributes:
        scenes: their rows (U,), each once.
        row: of each pair, its scene's place in `scenes` (B,).
        current, target, following: (B, w).
        masks: dropout factors (B, dropout_units).
    """

    scenes: torch.Tensor
    row: torch.Tensor
    current: torch.Tensor
    target: torch.Tensor
    following: torch.Tensor
    masks: torch.Tensor


@dataclass(frozen=True)
class TrainingData:
    """Everything a training run sees, in memory.

    Attributes:
        voxels: grids of all scenes (S, L, W, H) of bool.
        tasks: what the network is told of the task in each scene (S, task_input), see `task_vector`.
        used: which numbers of a configuration there are in each scene (S, w) of bool, see `Codec`.
        train, validation: encoded pairs from different scenes, see `split_by_scene`.
    """

    voxels: np.ndarray
    tasks: np.ndarray
    used: np.ndarray
    train: Pairs
    validation: Pairs

    def check(self, network: NetworkParameters) -> None:
        """Refuse data that does not fit the network, or that validates on scenes it trains on.

        Raises:
            ConfigError: the message names both sizes, or the scenes in common.
        """
        side, width = network.grid, network.width
        if self.voxels.ndim != 4 or self.voxels.shape[1:] != (side, side, side):
            raise ConfigError(f"voxels have shape {self.voxels.shape}; the network expects (S, {side}, {side}, {side})")
        for name, count in (("tasks", network.task_input), ("used", width)):
            shape = getattr(self, name).shape
            if shape != (len(self.voxels), count):
                raise ConfigError(f"{name} has shape {shape}; the network expects {(len(self.voxels), count)}")
        for name, pairs in (("training", self.train), ("validation", self.validation)):
            if not len(pairs):
                raise ConfigError(f"there are no {name} pairs")
            if pairs.current.shape[1] != width:
                raise ConfigError(f"{name} pairs have {pairs.current.shape[1]} numbers, the network {width}")
            if pairs.scene.max() >= len(self.voxels):
                raise ConfigError(f"{name} pairs name scene {pairs.scene.max()}; there are {len(self.voxels)} grids")
        shared = np.intersect1d(self.train.scene, self.validation.scene)
        if len(shared):
            raise ConfigError(f"scenes {shared.tolist()} are in training and in validation; split by scene")


class Batches:
    """The batches of one epoch after the other; the last batch of an epoch may be smaller.

    Args:
        pairs: to serve, encoded.
        network: for the width of the masks.
        batch_size: B.
        seed: of all epochs.
        epoch: tells the running epoch when a pass begins; None serves the same batches, in the order of the pairs and
            under the same masks, at every pass.
    """

    def __init__(
        self,
        pairs: Pairs,
        network: NetworkParameters,
        batch_size: int,
        seed: int,
        epoch: Callable[[], int] | None,
    ) -> None:
        self._network, self._size, self._seed, self._epoch = network, batch_size, seed, epoch
        self._scene = torch.from_numpy(pairs.scene)
        self._current, self._target, self._following = (
            torch.from_numpy(X.astype(np.float32)) for X in (pairs.current, pairs.target, pairs.following)
        )

    def __len__(self) -> int:
        return -(-len(self._scene) // self._size)

    def __iter__(self) -> Iterator[Batch]:
        order = torch.arange(len(self._scene))
        if self._epoch is None:
            rng = np.random.default_rng([self._seed, 0, _FIXED_MASKS])
        else:
            epoch = self._epoch()
            rng = np.random.default_rng([self._seed, epoch, _MASKS])
            order = torch.from_numpy(np.random.default_rng([self._seed, epoch, _ORDER]).permutation(len(order)))
        for begin in range(0, len(order), self._size):
            rows = order[begin : begin + self._size]
            masks = draw_masks(rng, len(rows), self._network.dropout_units, self._network.dropout)
            scenes, row = torch.unique(self._scene[rows], return_inverse=True)
            yield Batch(
                scenes, row, self._current[rows], self._target[rows], self._following[rows], torch.from_numpy(masks)
            )
