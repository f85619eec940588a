"""CoMPNetX at planning time: one small matrix product after the other, in numpy, or narrower where that is faster.

A planner asks for one sample (RRTConnect) or twenty (FMT*) at a time. Median time of a call on one core of a Xeon
(AVX-512, AMX, 2 MB of second-level cache), in microseconds, dropout included:

| K | numpy | torch eager | TorchScript | the same, optimised, masks from numpy | numpy, products in tiles |
|---|---|---|---|---|---|
| 1 | 100 | 243 | 224 | 194 | |
| 8 | 311 | 543 | 493 | 240 | 221 |
| 20 | 435 | 939 | 939 | 390 | 258 |
| 32 | 562 | 1335 | 1262 | 472 | 312 |
| 100 | 1243 | | | | 575 |

So numpy it is for single samples, where most of the time is the way of 2.5 MB of weights through the cache. For batches
the arithmetic counts. A processor with tiles (Intel's AMX) multiplies bfloat16 several times as fast as single
precision; rounding weights and activations to 8 bits moves a sample of the sphere by 2 mm at most. One without tiles
but with byte products (VNNI) multiplies those faster: 725 instead of 1219 us for K = 100, 306 instead of 562 for 32,
154 instead of 312 for 8, and a sample moves by 4 mm (median; 25 mm at most). That is little beside the spread of 70 to
110 mm that dropout gives it, and it is projected afterwards. Without tiles bfloat16 is slower than single precision.
Torch is also asked once per scene, for its encoding (0.4 ms). Give a process one thread: where two shared their cores
with other work, a batch of 20 took 68 ms.
"""

from collections.abc import Hashable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch

from pipeline.errors import ArtifactError, ProblemError
from pipeline.learning.codec import Codec
from pipeline.learning.compnetx.model import Model
from pipeline.learning.dropout import draw_masks
from pipeline.learning.products import Bytes, Products, Tiles, fastest_products

_BATCH = 8  # from which on narrower products are faster
_WIDE = 1 << 17  # weights, from which on a layer gains by bytes


class _Ends(NamedTuple):
    """The outer layers as they are for one kind of tasks, from and to numbers that are not scaled.

    Attributes:
        codec: of its configurations, of s numbers.
        first: weights (2 s, hidden[0]) of current and target configurations.
        bias: of the first layer (hidden[0],), without the encoding of scene and task.
        last: weights (hidden[-1], s).
        shift: bias of the last layer (s,).
    """

    codec: Codec
    first: np.ndarray
    bias: np.ndarray
    last: np.ndarray
    shift: np.ndarray


class _Encoded(NamedTuple):
    """A scene and task the network can be asked about.

    Attributes:
        ends: of its kind.
        bias: of the first layer, with the encoding (hidden[0],).
        voxels: that were encoded.
    """

    ends: _Ends
    bias: np.ndarray
    voxels: np.ndarray


class CompnetxNetwork:
    """Samples configurations for scenes it has encoded. Not shareable between threads; can be sent to processes.

    Everything that is constant is folded beforehand: the scaling of configurations into the first and last layer, and
    the encoding of scene and task into a bias of the first layer, so that a call starts from the numbers of `current`
    and `target`.

    Args:
        model: as trained or loaded.
        products: how batches are multiplied; None for what is fastest on this processor.
    """

    def __init__(self, model: Model, products: Products | None = None) -> None:
        self.model, self.parameters = model, model.parameters
        generator, code, width = model.network.generator, model.parameters.code, model.parameters.width
        layers = [*generator.linear, generator.output]
        weights = [layer.weight.detach().double().numpy().T for layer in layers]  # (in, out)
        biases = [layer.bias.detach().double().numpy() for layer in layers]
        self._code_weight = weights[0][:code]  # (code, hidden[0])
        self._ends = [_ends(kind.codec, code, width, weights, biases) for kind in model.kinds]
        self._weights = [np.ascontiguousarray(weight, np.float32) for weight in weights[1:-1]]
        self._biases = [bias.astype(np.float32) for bias in biases[1:-1]]
        products = products or fastest_products()
        self._narrow: dict[int, Tiles | Bytes] = {}  # by inner layer; the first and the last are too small to gain
        for i, weight in enumerate(self._weights):
            if products is Products.TILES:
                self._narrow[i] = Tiles(weight)
            elif products is Products.BYTES and weight.size >= _WIDE:
                self._narrow[i] = Bytes(weight)
        slopes = [np.float32(activation.get_parameter("weight").item()) for activation in generator.activation]
        # PReLU is the larger of x and a x for slopes up to 1, the smaller one beyond.
        self._activations = [(a, np.maximum if a <= 1 else np.minimum) for a in slopes]
        ends = np.cumsum((0, *model.parameters.hidden[: model.parameters.dropout_layers])).tolist()
        self._dropped = [slice(begin, end) for begin, end in pairwise(ends)]
        self._scenes: dict[Hashable, _Encoded] = {}

    def knows(self, key: Hashable, voxels: np.ndarray) -> bool:
        """Tell whether a key was encoded with this very grid."""
        return key in self._scenes and self._scenes[key].voxels is voxels

    def encode(self, key: Hashable, voxels: np.ndarray, task: np.ndarray | None = None, kind: int = 0) -> None:
        """Encode a scene and task once; a key that is known already, with the same grid, costs nothing.

        Args:
            key: to sample by.
            voxels: grid (L, W, H) of bool, indexed [x, y, z].
            task: Z_s (task_input,), see `task_vector`; None without a task encoder.
            kind: of the task, by its number among the model's.

        Raises:
            ArtifactError: the grid or the task does not fit the network.
        """
        if self.knows(key, voxels):
            return
        side, size = self.parameters.grid, self.parameters.task_input
        if voxels.shape != (side, side, side):
            raise ArtifactError(f"voxels of a scene are {voxels.shape}; the network expects {(side,) * 3}")
        if (0 if task is None else len(task)) != size:
            raise ArtifactError(f"a task is {task}; the network expects {size} numbers")
        with torch.inference_mode():
            described = None if task is None or not size else torch.as_tensor(task, dtype=torch.float32)[None]
            code = self.model.network.encode(torch.as_tensor(voxels).float()[None], described)[0]  # (code,)
        ends = self._ends[kind]
        bias = (ends.bias + code.double().numpy() @ self._code_weight).astype(np.float32)
        self._scenes[key] = _Encoded(ends, bias, voxels)

    def sample(self, key: Hashable, current: np.ndarray, target: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return K proposals (K, n) [rad or m], near the manifold but not on it, and not held within the limits.

        Args:
            key: of a scene and task that were encoded.
            current: configurations to go on from (K, n) [rad or m].
            target: configurations to go to (K, n) [rad or m]; a single one (n,) serves all.
            rng: draws the dropout masks, the only chance in it: an equal stream gives equal samples.

        Raises:
            ProblemError: the key was not encoded.
        """
        parameters = self.parameters
        masks = draw_masks(rng, len(current), parameters.dropout_units, parameters.dropout)
        return self.evaluate(key, current, target, masks)

    def evaluate(self, key: Hashable, current: np.ndarray, target: np.ndarray, masks: np.ndarray) -> np.ndarray:
        """Return what the network answers (K, n) under given dropout masks (K, dropout_units)."""
        encoded = self._scenes.get(key)
        if encoded is None:
            raise ProblemError("the network is asked about a scene that it has not encoded")
        ends, codec, count = encoded.ends, encoded.ends.codec, len(current)
        x = np.empty((count, 2 * codec.size), np.float32)
        x[:, : codec.size], x[:, codec.size :] = codec.expand(current), codec.expand(target)
        narrow = self._narrow if count >= _BATCH else {}
        if count == 1:  # vectors: a product of a vector and a matrix takes a shorter way than one of two matrices
            x, masks = x[0], masks[0]
        for i, (slope, larger) in enumerate(self._activations):
            if i == 0:
                x = x.dot(ends.first)
                x += encoded.bias
            else:
                x = narrow[i - 1](x) if i - 1 in narrow else x.dot(self._weights[i - 1])  # (K, hidden[i])
                x += self._biases[i - 1]
            larger(x, x * slope, out=x)
            if i < len(self._dropped):
                x *= masks[..., self._dropped[i]]
        x = x.dot(ends.last)
        x += ends.shift
        return codec.contract(x.reshape(count, codec.size).astype(float))


def _ends(codec: Codec, code: int, width: int, weights: list[np.ndarray], biases: list[np.ndarray]) -> _Ends:
    """Fold a codec's scaling into the outer layers of a network, given by all weights (in, out) and biases."""
    size = codec.size
    scale, offset = np.tile(codec.scale, 2), np.tile(codec.offset, 2)
    rows = code + np.concatenate([np.arange(size), width + np.arange(size)])
    first = weights[0][rows] / scale[:, None]
    return _Ends(
        codec,
        np.ascontiguousarray(first, np.float32),
        biases[0] - offset @ first,
        np.ascontiguousarray(weights[-1][:, :size] * codec.scale, np.float32),
        (biases[-1][:size] * codec.scale + codec.offset).astype(np.float32),
    )
