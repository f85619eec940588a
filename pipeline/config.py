"""From a composed Hydra config to plain dataclasses: the door of every stage. Importing it makes the resolvers known.

The library never sees a DictConfig. OmegaConf's own structured configs cannot hold the library's frozen dataclasses as
nested nodes (they are read-only), so the conversion is done here, with messages that name the value and the choices.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.errors import ConfigError
from pipeline.schema import convert

T = TypeVar("T")
ROOT = Path(__file__).resolve().parent.parent


def environments(root: Path = ROOT) -> list[str]:
    """Return the names of all environments, which are the files of conf/environment: `${environments:}`."""
    return sorted(path.stem for path in (root / "conf" / "environment").glob("*.yaml"))


def own_or(group: str, environment: str, other: str) -> str:
    """Return which file of a group an environment has: its own, or `other`.

    In lists of defaults: `${own_or:oracle,${environment},arm}`.
    """
    return environment if (ROOT / "conf" / group / f"{environment}.yaml").is_file() else other


OmegaConf.register_new_resolver("environments", environments, replace=True)
OmegaConf.register_new_resolver("own_or", own_or, replace=True)


def load(config: DictConfig | Mapping[str, Any], schema: type[T]) -> T:
    """Return `config` as an instance of the dataclass `schema`.

    Raises:
        ConfigError: a misspelt or missing key, a value of the wrong type, an unknown choice, an unresolved
            interpolation, or whatever the dataclasses themselves refuse.
    """
    try:
        plain = OmegaConf.to_container(config, resolve=True) if isinstance(config, DictConfig) else dict(config)
    except OmegaConfBaseException as error:
        raise ConfigError(f"the configuration cannot be resolved: {error}") from error
    return convert(plain, schema)


def compose(stage: str, overrides: list[str] | None = None) -> DictConfig:
    """Compose the configuration of a stage as its command line would, for tests and notebooks."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return hydra_compose(stage, overrides=overrides or [])
