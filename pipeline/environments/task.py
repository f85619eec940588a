"""What families of tasks have in common."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from pipeline.constraints import TaskSpaceRegion
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.targets import in_region
from pipeline.errors import ConfigError, ProblemError
from pipeline.robots import Obstacle, Placement, UrdfRobot
from pipeline.spec.statement import Carried, Level, OnPlane, Statement
from pipeline.spec.task import TaskSpec, single
from pipeline.tasks import Setup, set_up

DOWN = {"panda": (0.0, 0.0, -1.0)}  # robots that hold a tool downwards: direction of their frame's z axis then
_AXIS = (0.0, 0.0, 1.0)
_SCENES = 20  # tried for a task
# What start and goal keep from obstacles and from the robot itself [m], so that no planner's margin forbids them.
NEAR, NEAR_ITSELF = 0.02, 0.005


Pair = tuple[np.ndarray, np.ndarray]  # start and goal (n,)
Ends = Callable[[Setup, np.random.Generator], Pair | None]  # draws a pair in a scene; None where none is found


class Family(ABC):
    """Makes scenes of one kind, by seed and number, and tasks in them."""

    @abstractmethod
    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """Return what is asked in scene `number`, and what draws starts and goals there; None to try another one."""

    @abstractmethod
    def name(self, number: int) -> str:
        """Return how messages call the task of a number."""

    def tasks(self, seed: int, number: int, count: int = 1) -> list[TaskSpec]:
        """Return the first `count` tasks in scene `number` of a seed; the same every time.

        Raises:
            ProblemError: no scene with a start and a goal is found, or not so many.
        """
        for attempt in range(_SCENES):
            rng = np.random.default_rng([seed, number, attempt])
            made = self.scene(number, rng)
            if made is None:
                continue
            statement, ends = made
            setup = set_up(statement)
            pair = ends(setup, rng)
            if pair is not None:
                pairs = [pair, *self._more(ends, setup, [seed, number, attempt], count - 1)]
                names = [self.name(number), *(f"{self.name(number)} task {i}" for i in range(1, count))]
                return [single(name, statement, *found) for name, found in zip(names, pairs, strict=True)]
        raise ProblemError(f"no start and goal were found for {self.name(number)}, seed {seed}")

    def task(self, seed: int, number: int) -> TaskSpec:
        """Return the first task in scene `number` of a seed. Raises as `tasks` does."""
        return self.tasks(seed, number)[0]

    def _more(self, ends: Ends, setup: Setup, stream: list[int], count: int) -> Iterator[Pair]:
        for i in range(1, count + 1):
            pair = ends(setup, np.random.default_rng([*stream, i]))
            if pair is None:
                raise ProblemError(
                    f"{self.name(stream[1])}, seed {stream[0]}: its scene has no {i + 1} starts and goals"
                )
            yield pair


def two_ends(
    draw: Callable[[], np.ndarray], accept: Callable[[np.ndarray], bool], apart: float, tries: int
) -> Pair | None:
    """Return two accepted configurations (n,) at least `apart` from each other [rad]; None after `tries` draws.

    Args:
        draw: gives configurations on the manifold (m, n).
        accept: says which may be a start or goal.
        apart: see above.
        tries: calls of `draw`.
    """
    first: np.ndarray | None = None
    for _ in range(tries):
        for q in draw():
            if first is not None and np.linalg.norm(q - first) <= apart:
                continue
            if not accept(q):
                continue
            if first is not None:
                return first, q
            first = q
    return None


def held_down(settings: UrdfRobot, tool: Obstacle, height: float, touches: Sequence[str] = ()) -> Statement:
    """Return what is asked of an arm that holds a tool downwards at a fixed height.

    Args:
        settings: of the arm, one of `DOWN`.
        tool: what it holds, in the frame of its hand.
        height: of that frame [m].
        touches: obstacles that the tool may touch.

    Raises:
        ConfigError: another arm.
    """
    if settings.name not in DOWN:
        raise ConfigError(f"tools are held downwards by {', '.join(DOWN)}, not by {settings.name!r}")
    equations = (Level(settings.tool, _AXIS, DOWN[settings.name]), OnPlane(settings.tool, _AXIS, height))
    carried = Carried(tool, settings.tool, touches=dict.fromkeys(touches))
    return Statement(settings, equations, carried=(carried,))


def over(setup: Setup, spot: tuple[float, float, float]) -> InverseKinematics:
    """Return what finds configurations with the robot's tool frame at a place [m], turned as the constraint lets it."""
    free = np.full(4, np.inf)  # height and tilt are the constraint's, the yaw is free
    region = TaskSpaceRegion((0, 0, *-free), (0, 0, *free), Placement(spot))
    return InverseKinematics(setup.robot, setup.constraint, in_region(setup.robot, setup.robot.tool, region))
