"""CoMPNetX's networks (compnetx.txt, appendix B): scene encoder, task encoder, generator.

Configurations go in and come out as numbers (`Codec`). B counts pairs, S scenes with a task each.
"""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import nn

from pipeline.errors import ConfigError, require


@dataclass(frozen=True, kw_only=True)
class Layers:
    """Sizes of CoMPNetX that are chosen; the defaults are those of the sphere (the bracketed ones of appendix B).

    Attributes:
        scene_hidden: units of the scene encoder's hidden layer (128; 256 bartender and kitchen).
        scene_code: size of Z_o (128; 256 bartender and kitchen).
        task_hidden: units of the task encoder's hidden layer (128).
        task_code: size of Z_c (128); counts only with a task encoder.
        hidden: units of the generator's hidden layers.
        dropout: probability of dropping a unit.
        dropout_layers: how many hidden layers, from the first, drop units. Four in the paper, three in the authors'
            code.
    """

    scene_hidden: int = 128
    scene_code: int = 128
    task_hidden: int = 128
    task_code: int = 128
    hidden: tuple[int, ...] = (896, 512, 256, 128, 64)
    dropout: float = 0.5
    dropout_layers: int = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden", tuple(self.hidden))  # a list when it comes from a configuration file
        for name in ("scene_hidden", "scene_code", "task_hidden", "task_code"):
            require(f"network.{name}", getattr(self, name), at_least=1)
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"network.hidden is {self.hidden}; it must name at least one layer of at least one unit")
        require("network.dropout", self.dropout, at_least=0, below=1)
        require("network.dropout_layers", self.dropout_layers, at_least=0, at_most=len(self.hidden))


@dataclass(frozen=True, kw_only=True)
class NetworkParameters(Layers):
    """All sizes of CoMPNetX, with those that follow from what it learns from.

    Attributes:
        width: numbers of a configuration w, see `Codec`; those of the tasks with most.
        grid: cells per side of the voxel grid (40 sphere, 33 bartender, 32 kitchen).
        task_input: size of Z_s; 0 means no task encoder, as for the sphere.
    """

    width: int
    grid: int = 40
    task_input: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        require("network.width", self.width, at_least=1)
        # The smallest grid that leaves a cell after both convolutions and the pooling.
        require("network.grid", self.grid, at_least=11)
        require("network.task_input", self.task_input, at_least=0)

    @property
    def code(self) -> int:
        """Size of the encodings together, [Z_c, Z_o]."""
        return self.scene_code + (self.task_code if self.task_input else 0)

    @property
    def dropout_units(self) -> int:
        """Units that dropout may drop, all layers side by side: the width of a mask."""
        return sum(self.hidden[: self.dropout_layers])

    @property
    def pooled(self) -> int:
        """Side of the feature maps after convolutions (5x5 stride 2, 3x3) and pooling (2x2): 8 for a grid of 40."""
        return ((self.grid - 5) // 2 + 1 - 2) // 2


class SceneEncoder(nn.Module):
    """Encodes voxel grids (S, L, W, H) as Z_o (S, scene_code); the heights H are the channels (section V-B)."""

    def __init__(self, parameters: NetworkParameters) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(parameters.grid, 16, kernel_size=5, stride=2),
            nn.PReLU(),
            nn.Conv2d(16, 8, kernel_size=3),
            nn.PReLU(),
            nn.MaxPool2d(2),
            nn.Flatten(),
            nn.Linear(8 * parameters.pooled**2, parameters.scene_hidden),
            nn.PReLU(),
            nn.Linear(parameters.scene_hidden, parameters.scene_code),
        )

    def forward(self, voxels: torch.Tensor) -> torch.Tensor:
        """Return Z_o (S, scene_code) of grids (S, L, W, H) of 0 and 1, indexed [x, y, z]."""
        # A view, not a copy: it also tells torch that channels lie innermost, which saves a fifth of the time.
        return self.layers(voxels.permute(0, 3, 1, 2))


class Generator(nn.Module):
    """Proposes the next configuration from [Z_c, Z_o, q_current, q_target]; chance enters by the masks alone."""

    def __init__(self, parameters: NetworkParameters) -> None:
        super().__init__()
        sizes = (parameters.code + 2 * parameters.width, *parameters.hidden)
        self.linear = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(sizes))
        self.activation = nn.ModuleList(nn.PReLU() for _ in parameters.hidden)
        self.output = nn.Linear(sizes[-1], parameters.width)
        self._dropped = list(parameters.hidden[: parameters.dropout_layers])

    def forward(self, inputs: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """Return the numbers of configurations (B, w).

        Args:
            inputs: (B, code + 2 w).
            masks: factors of the units of the layers with dropout (B, dropout_units), see `draw_masks`.
        """
        factors = torch.split(masks, self._dropped, dim=1) if self._dropped else ()
        x = inputs
        for i, (linear, activation) in enumerate(zip(self.linear, self.activation, strict=True)):
            x = activation(linear(x))  # (B, hidden[i])
            if i < len(factors):
                x = x * factors[i]
        return self.output(x)


class Compnetx(nn.Module):
    """The generator with its encoders, trained end to end (compnetx.txt, section V-C)."""

    def __init__(self, parameters: NetworkParameters) -> None:
        super().__init__()
        self.scene_encoder = SceneEncoder(parameters)
        self.task_encoder: nn.Module | None = None
        if parameters.task_input:
            # One hidden layer, as in the authors' code; the paper's "two hidden layers" counts the output.
            self.task_encoder = nn.Sequential(
                nn.Linear(parameters.task_input, parameters.task_hidden),
                nn.PReLU(),
                nn.Linear(parameters.task_hidden, parameters.task_code),
            )
        self.generator = Generator(parameters)

    def encode(self, voxels: torch.Tensor, task: torch.Tensor | None = None) -> torch.Tensor:
        """Return the encodings [Z_c, Z_o] (S, code) of grids (S, L, W, H) and task representations (S, task_input)."""
        scene = self.scene_encoder(voxels)
        if self.task_encoder is None:
            return scene
        return torch.cat([self.task_encoder(task), scene], dim=1)

    def forward(
        self, codes: torch.Tensor, current: torch.Tensor, target: torch.Tensor, masks: torch.Tensor
    ) -> torch.Tensor:
        """Return the numbers of the next configurations (B, w), for those of `current` and `target` (equation 6)."""
        return self.generator(torch.cat([codes, current, target], dim=1), masks)
