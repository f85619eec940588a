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
from enum import Enum
from itertools import pairwise

import numpy as np
import torch

from pipeline.errors import ArtifactError, ProblemError
from pipeline.learning.dropout import draw_masks
from pipeline.learning.model import Model

_BATCH = 8  # from which on narrower products are faster
_WIDE = 1 << 17  # weights, from which on a layer gains by bytes


class Products(Enum):
    """How batches are multiplied."""

    SINGLE = "single precision"
    TILES = "bfloat16 tiles"
    BYTES = "bytes"


def fastest_products() -> Products:
    """Return what is fastest on this processor."""
    has = torch.cpu.get_capabilities()
    if has.get("amx_bf16", False):
        return Products.TILES
    vnni = has.get("avx512_vnni", False) or has.get("avx_vnni", False)
    return Products.BYTES if vnni and hasattr(torch.ops.onednn, "qlinear_pointwise") else Products.SINGLE


class _Tiles:
    """A layer's weights (in, out) in bfloat16."""

    def __init__(self, weight: np.ndarray) -> None:
        self._weight = torch.from_numpy(weight.T.copy()).bfloat16()

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the product of x (K, in) with the weights (K, out)."""
        return np.asarray(torch.mm(torch.from_numpy(x).bfloat16(), self._weight.t()).float())


class _Bytes:
    """A layer's weights (in, out) in bytes: one scale per output, and one for the inputs of a call."""

    def __init__(self, weight: np.ndarray) -> None:
        scales = np.maximum(np.abs(weight).max(axis=0), np.finfo(np.float32).tiny) / np.float32(127)
        self._weight = np.rint(weight / scales).astype(np.int8)
        self._scales = torch.from_numpy(scales)
        self._zeros = torch.zeros(len(scales), dtype=torch.int32)
        self._packed: torch.Tensor | None = None

    def __getstate__(self) -> dict[str, object]:
        """Leave out what torch cannot send to another process."""
        return self.__dict__ | {"_packed": None}

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the product of x (K, in) with the weights (K, out); x is overwritten."""
        if self._packed is None:
            self._packed = torch.ops.onednn.qlinear_prepack(torch.from_numpy(self._weight.T.copy()), None)
        scale = np.float32(max(float(x.max()), -float(x.min())) / 127) or np.float32(1)
        x /= scale
        x += np.float32(128.5)  # the half rounds what follows
        # Scale and zero are the same in all calls: torch makes ready for others each time, which costs 80 us.
        found = torch.ops.onednn.qlinear_pointwise(
            torch.from_numpy(x.astype(np.uint8)),
            *(1.0, 128),
            *(self._packed, self._scales, self._zeros, None),
            *(1.0, 0, torch.float32),
            *("none", [], ""),
        ).numpy()
        found *= scale
        return np.asarray(found)


class CompnetxNetwork:
    """Samples configurations for scenes it has encoded. Not shareable between threads; can be sent to processes.

    Everything that is constant is folded beforehand: the normalisation into the first and last layer, and the scene's
    encoding into a bias of the first layer, so that a call starts from the 2 n numbers of `current` and `target`.

    Args:
        model: as trained or loaded.
        products: how batches are multiplied; None for what is fastest on this processor.
    """

    def __init__(self, model: Model, products: Products | None = None) -> None:
        self.parameters = model.parameters
        self._model = model
        generator, code, n = model.network.generator, model.parameters.code, model.parameters.dimension
        layers = [*generator.linear, generator.output]
        weights = [layer.weight.detach().double().numpy().T for layer in layers]  # (in, out)
        biases = [layer.bias.detach().double().numpy() for layer in layers]
        scale, offset = np.tile(model.normalisation.scale, 2), np.tile(model.normalisation.offset, 2)
        self._code_weight = weights[0][:code]  # (code, hidden[0])
        weights[0] = weights[0][code:] / scale[:, None]  # (2 n, hidden[0])
        self._first_bias = biases[0] - offset @ weights[0]
        weights[-1] = weights[-1] * scale[:n]
        biases[-1] = biases[-1] * scale[:n] + offset[:n]
        self._weights = [np.ascontiguousarray(weight, np.float32) for weight in weights]
        products = products or fastest_products()
        self._narrow: dict[int, _Tiles | _Bytes] = {}  # by layer; the first and the last are too small to gain
        for i, weight in list(enumerate(self._weights))[1:-1]:
            if products is Products.TILES:
                self._narrow[i] = _Tiles(weight)
            elif products is Products.BYTES and weight.size >= _WIDE:
                self._narrow[i] = _Bytes(weight)
        self._biases = [bias.astype(np.float32) for bias in biases]
        slopes = [np.float32(activation.get_parameter("weight").item()) for activation in generator.activation]
        # PReLU is the larger of x and a x for slopes up to 1, the smaller one beyond.
        self._activations = [(a, np.maximum if a <= 1 else np.minimum) for a in slopes]
        ends = np.cumsum((0, *model.parameters.hidden[: model.parameters.dropout_layers])).tolist()
        self._dropped = [slice(begin, end) for begin, end in pairwise(ends)]
        self._scenes: dict[Hashable, np.ndarray] = {}

    def encode(self, scene: Hashable, voxels: np.ndarray, task: np.ndarray | None = None) -> None:
        """Encode a scene once; a key that is known already costs nothing.

        Args:
            scene: key to sample by; with a task encoder it stands for scene and task together.
            voxels: grid (L, W, H) of bool, indexed [x, y, z].
            task: Z_s (task_input,); None without a task encoder.

        Raises:
            ArtifactError: the grid or the task representation does not fit the network.
        """
        if scene in self._scenes:
            return
        side, size = self.parameters.grid, self.parameters.task_input
        if voxels.shape != (side, side, side):
            raise ArtifactError(f"voxels of scene {scene!r} are {voxels.shape}; the network expects {(side,) * 3}")
        if (0 if task is None else len(task)) != size:
            raise ArtifactError(f"task of scene {scene!r} is {task}; the network expects {size} numbers")
        with torch.inference_mode():
            described = None if task is None else torch.as_tensor(task, dtype=torch.float32)[None]
            code = self._model.network.encode(torch.as_tensor(voxels).float()[None], described)[0]  # (code,)
        self._scenes[scene] = (self._first_bias + code.double().numpy() @ self._code_weight).astype(np.float32)

    def sample(self, scene: Hashable, current: np.ndarray, target: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return K proposals (K, n) [rad or m], near the manifold but not on it, and not held within the limits.

        Args:
            scene: key of a scene that was encoded.
            current: configurations to go on from (K, n) [rad or m].
            target: configurations to go to (K, n) [rad or m]; a single one (n,) serves all.
            rng: draws the dropout masks, the only chance in it: an equal stream gives equal samples.

        Raises:
            ProblemError: the scene was not encoded.
        """
        parameters = self.parameters
        masks = draw_masks(rng, len(current), parameters.dropout_units, parameters.dropout)
        return self.evaluate(scene, current, target, masks)

    def evaluate(self, scene: Hashable, current: np.ndarray, target: np.ndarray, masks: np.ndarray) -> np.ndarray:
        """Return what the network answers (K, n) under given dropout masks (K, dropout_units)."""
        bias = self._scenes.get(scene)
        if bias is None:
            raise ProblemError(f"scene {scene!r} was not encoded; encoded are {list(self._scenes)[:5]}")
        count, n = current.shape
        x = np.empty((count, 2 * n), np.float32)
        x[:, :n], x[:, n:] = current, target
        narrow = self._narrow if count >= _BATCH else {}
        if count == 1:  # vectors: a product of a vector and a matrix takes a shorter way than one of two matrices
            x, masks = x[0], masks[0]
        for i, (slope, larger) in enumerate(self._activations):
            x = narrow[i](x) if i in narrow else x.dot(self._weights[i])  # (K, hidden[i])
            x += self._biases[i] if i else bias
            larger(x, x * slope, out=x)
            if i < len(self._dropped):
                x *= masks[..., self._dropped[i]]
        x = x.dot(self._weights[-1])
        x += self._biases[-1]
        return x.reshape(count, n).astype(float)
