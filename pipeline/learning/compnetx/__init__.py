"""CoMPNetX: networks, training and sampler (compnetx.txt, section V).

Training is imported from `pipeline.learning.compnetx.recipe`, so that planning does not wait for Lightning.
"""

from pipeline.learning.compnetx.inference import CompnetxNetwork
from pipeline.learning.compnetx.model import Model, load_model, save_model, sized, untrained
from pipeline.learning.compnetx.networks import Compnetx, Layers, NetworkParameters
from pipeline.learning.compnetx.sampler import CompnetxParameters, CompnetxSampler

__all__ = [
    "Compnetx",
    "CompnetxNetwork",
    "CompnetxParameters",
    "CompnetxSampler",
    "Layers",
    "Model",
    "NetworkParameters",
    "load_model",
    "save_model",
    "sized",
    "untrained",
]
