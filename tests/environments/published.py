"""Environments as the configuration has them, with changes."""

from dataclasses import replace
from typing import Any

from omegaconf import OmegaConf

from pipeline.config import compose, load
from pipeline.environments import ENVIRONMENTS
from pipeline.spec.environment import EnvironmentChoice


def published(name: str, margin: float | None = None, **changes: Any) -> Any:
    """Return the environment of conf/environment/<name>.yaml with another margin [m] and other parameters."""
    plain = OmegaConf.to_container(compose("scenes", [f"environment={name}"]).environment)
    choice = load(plain, EnvironmentChoice)
    choice = replace(choice, parameters={**choice.parameters, **changes})
    return replace(choice, margin=choice.margin if margin is None else margin).environment(ENVIRONMENTS)
