"""The sphere's network in full size, untrained, and small data."""

import pytest
import torch
from small_training import LIMITS, make_data

from pipeline.learning import Model, NetworkParameters, TrainingData
from pipeline.learning.networks import Compnetx


@pytest.fixture
def data() -> TrainingData:
    return make_data()


@pytest.fixture
def model() -> Model:
    """Every PReLU has a slope of its own, one of them above 1."""
    parameters = NetworkParameters(dimension=3)
    torch.manual_seed(0)
    network = Compnetx(parameters).eval()
    with torch.no_grad():
        for activation, slope in zip(network.generator.activation, (0.3, -0.2, 1.4, 0.1, 0.0), strict=True):
            activation.weight.fill_(slope)
    return Model(parameters, LIMITS, network)
