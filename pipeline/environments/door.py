"""Doors that an arm pulls open by their handle: a chain of two regions, hinge and handle (after compnetx.txt)."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.targets import with_values
from pipeline.environments.furniture import box, random_object
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair
from pipeline.robots import Obstacle, Placement, UrdfRobot
from pipeline.spec.statement import Carried, ChainSpec, Region, Statement
from pipeline.tasks import Setup

_TRIES = 50  # of inverse kinematics for the start, and for the goal
_WIDEST = 1.3  # a door opens this far [rad]
_SLACK = 0.05  # a shut door gives way [rad]: it is not on the limit of its hinge
_STEPS = 6  # in which it is opened to find a goal
_FROM_LIMITS = 0.02  # a way that begins on a joint limit bends beyond it [rad]
_TILT = 0.5  # of the hand on the handle [rad]
_HANDLE = 0.06  # in front of the panel [m]
_CLEAR = 0.22  # objects keep this from the way of the handle [m]: a hand must pass


class DoorOpening(Family):
    """Tasks of an arm at the origin, with its workspace in front: one door each, hinged left or right, and clutter.

    Start and goal belong together: an arm gets from one to the other by opening the door step by step, were there no
    obstacles. With them a way between need not exist.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        self.settings = settings

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        del number
        side = 1.0 if rng.random() < 0.5 else -1.0
        hinge = np.array([rng.uniform(0.62, 0.8), side * rng.uniform(0.25, 0.4), rng.uniform(0.36, 0.55)])
        handle, opened = rng.uniform(0.3, 0.42), rng.uniform(0.6, 1.1)
        swing = (-_WIDEST, _SLACK) if side > 0 else (-_SLACK, _WIDEST)
        at_hinge, at_handle = Placement(tuple(hinge.tolist())), Placement((-_HANDLE, -side * handle, 0.0))
        ahead = Placement((0.0, 0.0, 0.0), rpy=(0.0, np.pi / 2, 0.0))  # the hand points at the panel
        regions = (
            Region((0, 0, 0, 0, 0, swing[0]), (0, 0, 0, 0, 0, swing[1]), at_hinge),
            Region((0, 0, 0, 0, -_TILT, 0), (0, 0, 0, 0, _TILT, 0), at_handle, ahead),
        )
        panel = box("panel", (0.0, -side * (handle + 0.12) / 2, 0.0), (0.02, handle + 0.1, 0.6))
        statement = Statement(
            self.settings,
            (),
            obstacles=tuple(_clutter(rng, hinge, side, handle)),
            carried=(Carried(panel, "door_0", touches={"frame": None}),),
            chain=ChainSpec(regions, self.settings.tool, "door"),
        )
        return statement, partial(_ends, -side * opened)

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"door {self.settings.name} {number}"


def _ends(opened: float, setup: Setup, rng: np.random.Generator) -> Pair | None:
    """Return a configuration with the door shut, and where the arm gets from there by opening it [rad]."""
    robot, validity = setup.robot, setup.validity(NEAR, NEAR_ITSELF)
    yaw = setup.held.arm.dimension  # The hinge's angle is the first variable after those of the arm.
    shut, *wider = (
        InverseKinematics(robot, setup.constraint, with_values([(yaw, share * opened)]))
        for share in np.linspace(0.0, 1.0, _STEPS + 1)
    )

    def fits(q: np.ndarray) -> bool:
        return min((q - robot.lower).min(), (robot.upper - q).min()) > _FROM_LIMITS and validity.free(q)

    for start in filter(fits, shut.solutions(rng, _TRIES)):
        goal = _pulled(wider, start)
        if goal is not None and fits(goal):
            return start, goal
    return None


def _pulled(steps: Sequence[InverseKinematics], q: np.ndarray) -> np.ndarray | None:
    """Return where the arm gets from q (n,) by opening the door step by step; None where it cannot."""
    for step in steps:
        found = step.solve(q)
        if found is None:
            return None
        q = found
    return q


def _clutter(rng: np.random.Generator, hinge: np.ndarray, side: float, handle: float) -> Iterator[Obstacle]:
    """The door frame, and 6 to 14 objects on the ground where neither panel nor hand pass."""
    post = (hinge[0] + 0.05, hinge[1] + 0.07 * side, hinge[2])
    yield box("frame", post, (0.1, 0.1, 2 * hinge[2]))
    angles = np.linspace(0.0, -side * _WIDEST, 30)
    arms = np.stack([-_HANDLE * np.ones(30), -side * handle * np.ones(30)])  # from the hinge to the handle, shut
    turned = np.stack([
        np.cos(angles) * arms[0] - np.sin(angles) * arms[1],
        np.sin(angles) * arms[0] + np.cos(angles) * arms[1],
    ])  # fmt: skip
    way = hinge[:2, None] + turned  # (2, 30)
    shares = np.linspace(0.0, 1.3, 8)
    swept = np.concatenate([hinge[:2, None] + share * turned for share in shares], axis=1)
    count, found = int(rng.integers(6, 15)), 0
    while found < count:
        distance, bearing = rng.uniform(0.3, 0.95), rng.uniform(-1.6, 1.6)
        spot = distance * np.array([np.cos(bearing), np.sin(bearing)])
        heights = (0.1, 0.7)
        if np.linalg.norm(way.T - spot, axis=1).min() < _CLEAR or np.linalg.norm(swept.T - spot, axis=1).min() < 0.12:
            continue
        yield random_object(rng, f"object {found}", (*spot, 0.0), heights)
        found += 1
