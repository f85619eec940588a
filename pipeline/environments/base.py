"""What every stage needs of an environment."""

from typing import Protocol

import pandas as pd

from pipeline.spec.scene import Scene, Split


class Environment(Protocol):
    """Makes scenes and the tasks in them; one module per environment.

    Attributes:
        name: of the environment.
        margin, self_margin: that planning keeps to obstacles and between bodies of the robot [m].
    """

    name: str
    margin: float
    self_margin: float

    def scenes(self, counts: dict[Split, int]) -> list[Scene]:
        """Return the scenes, with `counts` of them per split where a scenario makes several; those given, all."""

    def tasks(self, scene: Scene, count: int) -> pd.DataFrame:
        """Return `count` tasks of a scene as rows of the table of tasks (`spec.scene.COLUMNS`); those given, all.

        The first ones are the same for every count.
        """
