"""The scale of a run: one section per stage that scales."""

from dataclasses import dataclass, field, fields

from pipeline.errors import require, require_name
from pipeline.spec.scene import Scene, Split


@dataclass(frozen=True)
class ScenesScale:
    """Numbers of scenes per split and of problems per scene.

    Attributes:
        train, validation, test: scenes of a split.
        pairs, test_pairs: problems of a scene, those of test scenes apart.
        others: problems of a scene of certain scenarios.
    """

    train: int
    validation: int
    test: int
    pairs: int
    test_pairs: int
    others: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _positive("scenes", self)

    @property
    def counts(self) -> dict[Split, int]:
        """Scenes per split."""
        return {Split.TRAIN: self.train, Split.VALIDATION: self.validation, Split.TEST: self.test}

    def problems(self, scene: Scene) -> int:
        """Return how many problems a scene has."""
        return self.others.get(scene.scenario, self.test_pairs if scene.split is Split.TEST else self.pairs)


@dataclass(frozen=True)
class TrainScale:
    """Epochs."""

    epochs: int

    def __post_init__(self) -> None:
        _positive("train", self)


@dataclass(frozen=True)
class BenchmarkScale:
    """How much is measured.

    Attributes:
        problems_per_scene: of each test scene.
        recordings: per row of the tables.
        others: problems of each test scene of certain scenarios.
    """

    problems_per_scene: int
    recordings: int
    others: dict[str, int] = field(default_factory=dict)

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

    def __post_init__(self) -> None:
        require_name("profile.name", self.name)


def _positive(section: str, scale: object) -> None:
    for f in fields(scale):  # type: ignore[arg-type]  # every caller is a dataclass
        value = getattr(scale, f.name)
        for name, number in value.items() if f.name == "others" else ((None, value),):
            require(".".join(filter(None, ("profile", section, f.name, name))), number, above=0)
