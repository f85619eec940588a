"""Products of matrices of a trained network, narrower than single precision where that is faster.

A processor with tiles (Intel's AMX) multiplies bfloat16 several times as fast as single precision; one without tiles
but with byte products (VNNI) multiplies those faster; without tiles bfloat16 is slower than single precision.
"""

from enum import Enum

import numpy as np
import torch


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


class Tiles:
    """A layer's weights (in, out) in bfloat16."""

    def __init__(self, weight: np.ndarray) -> None:
        self._weight = torch.from_numpy(weight.T.copy()).bfloat16()

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the product of x (K, in) with the weights (K, out)."""
        return np.asarray(torch.mm(torch.from_numpy(x).bfloat16(), self._weight.t()).float())


class Bytes:
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
