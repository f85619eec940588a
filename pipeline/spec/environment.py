"""The choice of an environment, and what stages that plan in its scenes need of it: not the code that makes scenes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pipeline.errors import ConfigError, require, require_name
from pipeline.schema import Choice


class Margins(Protocol):
    """What planning in an environment keeps.

    Attributes:
        name: of the environment.
        margin, self_margin: distance to obstacles and conditions, and between bodies of the robot [m].
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def margin(self) -> float: ...  # noqa: D102

    @property
    def self_margin(self) -> float: ...  # noqa: D102


@dataclass(frozen=True, kw_only=True)
class EnvironmentChoice(Choice):
    """An environment as `conf/environment` has it; see `Margins`."""

    margin: float
    self_margin: float

    def __post_init__(self) -> None:
        require_name("environment.name", self.name)
        for name in ("margin", "self_margin"):
            require(f"environment.{name}", getattr(self, name), at_least=0)

    def environment(self, registry: Mapping[str, Any]) -> Any:
        """Return what makes scenes: the class that `registry` has under `kind`, with parameters, name and margins.

        Raises:
            ConfigError: no such kind, or parameters that do not fit.
        """
        own = {"name": self.name, "margin": self.margin, "self_margin": self.self_margin}
        twice = sorted(set(own) & set(self.parameters))
        if twice:
            raise ConfigError(f"environment.parameters has {', '.join(twice)}, which stand beside it, not in it")
        return replace(self, parameters={**self.parameters, **own}).make(registry, "environment")
