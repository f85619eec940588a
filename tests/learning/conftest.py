"""The sphere's network in full size, untrained, and small data."""

from collections.abc import Callable

import pytest
import torch
from small_training import KINDS, make_data

from pipeline.learning.compnetx import Compnetx, Model, NetworkParameters
from pipeline.learning.compnetx.batches import TrainingData
from pipeline.robots import Robot
from tests.robots.worlds import ball


@pytest.fixture
def data() -> TrainingData:
    return make_data()


@pytest.fixture
def model() -> Model:
    """Every PReLU has a slope of its own, one of them above 1."""
    parameters = NetworkParameters(width=3)
    torch.manual_seed(0)
    network = Compnetx(parameters).eval()
    with torch.no_grad():
        for activation, slope in zip(network.generator.activation, (0.3, -0.2, 1.4, 0.1, 0.0), strict=True):
            activation.weight.fill_(slope)
    return Model(parameters, KINDS, network)


@pytest.fixture
def crane_like() -> Callable[[float, float], Robot]:
    """A ball whose x has the given limits."""
    return lambda low, high: ball((low, -1.5, -1.5), (high, 1.5, 1.5))
