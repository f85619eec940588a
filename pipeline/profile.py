"""The scale of a run: one section per stage that scales."""

from dataclasses import dataclass, fields

from pipeline.errors import require
from pipeline.spec.scene import Split


@dataclass(frozen=True)
class ScenesScale:
    """Numbers of scenes per split and of problems per scene."""

    train: int
    validation: int
    test: int
    pairs: int
    test_pairs: int
    band_pairs: int

    def __post_init__(self) -> None:
        _positive("scenes", self)

    @property
    def counts(self) -> dict[Split, int]:
        """Scenes per split."""
        return {Split.TRAIN: self.train, Split.VALIDATION: self.validation, Split.TEST: self.test}


@dataclass(frozen=True)
class TrainScale:
    """Epochs."""

    epochs: int

    def __post_init__(self) -> None:
        _positive("train", self)


@dataclass(frozen=True)
class BenchmarkScale:
    """How much is measured: problems per scene of scenario 1 and of scenario 2, recordings per row of the tables."""

    problems_per_scene: int
    band_problems: int
    recordings: int

    def __post_init__(self) -> None:
        _positive("benchmark", self)


@dataclass(frozen=True)
class ChoicesScale:
    """Problems of each validation scene for the table of choices."""

    problems_per_scene: int

    def __post_init__(self) -> None:
        _positive("choices", self)


@dataclass(frozen=True)
class Profile:
    """See `conf/profile/`."""

    name: str
    scenes: ScenesScale
    train: TrainScale
    benchmark: BenchmarkScale
    choices: ChoicesScale


def _positive(section: str, scale: object) -> None:
    for f in fields(scale):  # type: ignore[arg-type]  # every caller is a dataclass
        require(f"profile.{section}.{f.name}", getattr(scale, f.name), above=0)
