"""CoMPNetX's networks have the sizes of appendix B."""

from dataclasses import replace

import pytest
import torch
from omegaconf import OmegaConf
from torch import nn

from pipeline.errors import ConfigError
from pipeline.learning.compnetx import Compnetx, NetworkParameters

SPHERE = NetworkParameters(width=3)
MANIPULATION = NetworkParameters(width=13, grid=33, scene_hidden=256, scene_code=256, task_input=270)


def weights(module: nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def test_sphere_weights():
    """Counted by hand from appendix B, the sphere's bracketed sizes."""
    network = Compnetx(SPHERE)
    convolutions = (16 * 40 * 5 * 5 + 16) + 1 + (8 * 16 * 3 * 3 + 8) + 1  # each PReLU has one slope
    features = 8 * 8 * 8  # 40 -> 18 -> 16 -> pooled 8, eight maps
    encoder = convolutions + (features * 128 + 128) + 1 + (128 * 128 + 128)
    generator = 0
    for inputs, outputs in ((128 + 3 + 3, 896), (896, 512), (512, 256), (256, 128), (128, 64)):
        generator += inputs * outputs + outputs + 1
    generator += 64 * 3 + 3
    assert weights(network.scene_encoder) == encoder == 99_355
    assert weights(network.generator) == generator == 752_904
    assert network.task_encoder is None


@pytest.mark.parametrize(("grid", "pooled"), [(40, 8), (33, 6), (32, 6), (11, 1)])
def test_grids(grid, pooled):
    """Every grid of the paper, and the smallest possible one, passes the encoder; its maps have the predicted side."""
    network = Compnetx(replace(SPHERE, grid=grid))
    maps = network.scene_encoder.layers[:5](torch.zeros(2, grid, grid, grid))
    assert maps.shape == (2, 8, pooled, pooled)
    assert network.encode(torch.zeros(2, grid, grid, grid)).shape == (2, 128)


def test_manipulation_input():
    """With a task encoder the generator's input is 128 + 256 + 13 + 13 = 410, ordered [Z_c, Z_o, q_0, q_T]."""
    network = Compnetx(MANIPULATION)
    assert network.generator.linear[0].in_features == 410
    voxels, task = torch.rand(2, 33, 33, 33), torch.rand(2, 270)
    codes = network.encode(voxels, task)
    assert torch.equal(codes[:, :128], network.task_encoder(task))
    assert torch.equal(codes[:, 128:], network.scene_encoder(voxels))
    seen = []
    network.generator.linear[0].register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    current, target = torch.rand(2, 13), torch.rand(2, 13)
    out = network(codes, current, target, torch.ones(2, MANIPULATION.dropout_units))
    assert out.shape == (2, 13)
    assert torch.equal(seen[0], torch.cat([codes, current, target], dim=1))


def test_heights_are_channels():
    """The first convolution slides over x and y; its channels are the heights z (section V-B)."""
    network = Compnetx(SPHERE)
    voxels = torch.zeros(1, 40, 40, 40)
    voxels[0, 20, 10, 5] = 1  # x, y, z
    first = network.scene_encoder.layers[0]
    response = first(voxels.permute(0, 3, 1, 2)) - first.bias[:, None, None]
    # output (i, j) sees x in 2 i .. 2 i + 4 and y in 2 j .. 2 j + 4
    assert torch.allclose(response[0, :, 10, 5], first.weight[:, 5, 0, 0], atol=1e-6)
    assert torch.allclose(response[0, :, 8, 3], first.weight[:, 5, 4, 4], atol=1e-6)
    assert response[0, :, 7, 5].abs().max() < 1e-6
    through = network.scene_encoder.layers[1:](response + first.bias[:, None, None])
    assert torch.allclose(network.encode(voxels), through, atol=1e-6)


@pytest.mark.parametrize("layers", [0, 3, 4])
def test_dropout_layers(layers):
    """Masks reach the first `dropout_layers` hidden layers, after their PReLU, in eval mode too."""
    parameters = replace(SPHERE, dropout_layers=layers)
    assert parameters.dropout_units == sum((896, 512, 256, 128)[:layers])
    network = Compnetx(parameters).eval()
    inputs = torch.rand(4, 134)
    torch.manual_seed(0)
    masks = (torch.rand(4, parameters.dropout_units) < 0.5) * 2.0
    x, begin = inputs, 0
    for i, width in enumerate((896, 512, 256, 128, 64)):
        x = network.generator.linear[i](x)
        x = torch.where(x > 0, x, 0.25 * x)
        if i < layers:
            x = x * masks[:, begin : begin + width]
            begin += width
    expected = network.generator.output(x)
    assert torch.allclose(network.generator(inputs, masks), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "width is 0"),
        ({"grid": 10}, "grid is 10"),
        ({"dropout": 1.0}, r"dropout is 1\.0"),
        ({"dropout_layers": 6}, "dropout_layers is 6"),
        ({"hidden": ()}, "hidden"),
        ({"hidden": (896, 0)}, "hidden"),
        ({"task_input": -1}, "task_input is -1"),
    ],
)
def test_refused(change, message):
    """A size that makes no network is refused with the value in the message."""
    with pytest.raises(ConfigError, match=message):
        replace(SPHERE, **change)


def test_from_configuration():
    """Sizes merged from a configuration file equal those written in Python."""
    merged = OmegaConf.merge(OmegaConf.structured(NetworkParameters), {"width": 3, "dropout_layers": 3})
    assert OmegaConf.to_object(merged) == replace(SPHERE, dropout_layers=3)
