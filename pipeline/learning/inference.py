"""CoMPNetX at planning time: one small matrix product after the other, in numpy, or in torch's half-width tiles.

A planner asks for one sample (RRTConnect) or a hundred (FMT*) at a time. Median time of a call on one core of a Xeon
(AVX-512, AMX, 2 MB of second-level cache), in microseconds, dropout included:

| K | numpy | torch eager | TorchScript | the same, optimised, masks from numpy | numpy, products in tiles |
|---|---|---|---|---|---|
| 1 | 100 | 243 | 224 | 194 | |
| 8 | 311 | 543 | 493 | 240 | 221 |
| 20 | 435 | 939 | 939 | 390 | 258 |
| 32 | 562 | 1335 | 1262 | 472 | 312 |
| 100 | 1243 | | | | 575 |

So numpy it is for single samples, where most of the time is the way of 2.5 MB of weights through the cache. For batches
the arithmetic counts: a processor with tiles (Intel's AMX) multiplies bfloat16 several times as fast as single
precision, and rounding weights and activations to 8 bits moves a sample of the sphere by 2 mm at most, nothing beside
the spread that dropout gives it; it is projected afterwards. Torch is also asked once per scene, for its encoding
(0.4 ms). Give a process one thread: where two shared their cores with other work, a batch of 20 took 68 ms.
"""

from collections.abc import Hashable
from itertools import pairwise

import numpy as np
import torch

from pipeline.errors import ArtifactError, ProblemError
from pipeline.learning.dropout import draw_masks
from pipeline.learning.model import Model

_BATCH = 8  # from which on tiles are faster


def has_tiles() -> bool:
    """True where the processor multiplies matrices of bfloat16 in tiles."""
    return bool(torch.cpu.get_capabilities().get("amx_bf16", False))


class CompnetxNetwork:
    """Samples configurations for scenes it has encoded. Not shareable between threads; can be sent to processes.

    Everything that is constant is folded beforehand: the normalisation into the first and last layer, and the scene's
    encoding into a bias of the first layer, so that a call starts from the 2 n numbers of `current` and `target`.

    Args:
        model: as trained or loaded.
        tiles: multiply batches in bfloat16; None for where the processor has tiles for it.
    """

    def __init__(self, model: Model, tiles: bool | None = None) -> None:
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
        # (out, in), of the layers between the first and the last: those two are too narrow to gain.
        tiled = self._weights[1:-1] if (has_tiles() if tiles is None else tiles) else []
        self._tiled = [torch.from_numpy(weight.T.copy()).bfloat16() for weight in tiled]
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
        tiled = count >= _BATCH and len(self._tiled) > 0
        if count == 1:  # vectors: a product of a vector and a matrix takes a shorter way than one of two matrices
            x, masks = x[0], masks[0]
        for i, (slope, larger) in enumerate(self._activations):
            if tiled and i:
                x = torch.mm(torch.from_numpy(x).bfloat16(), self._tiled[i - 1].t()).float().numpy()
            else:
                x = x.dot(self._weights[i])  # (K, hidden[i])
            x += self._biases[i] if i else bias
            larger(x, x * slope, out=x)
            if i < len(self._dropped):
                x *= masks[..., self._dropped[i]]
        x = x.dot(self._weights[-1])
        x += self._biases[-1]
        return x.reshape(count, n).astype(float)
