"""Validity of a configuration: joint limits, conditions, self-collision and collision with the obstacles of a scene.

Up to a few dozen obstacles stand in a plain list beside the robot (`BroadPhase`), which is faster than a tree for them.

A crowd of obstacles sits in a coal tree of its own, which is built once. One query of tree against tree costs a
logarithm of their number (1.6 us from Python against 500 blocks), where a list costs a multiple of it. So do those of a
robot that cannot meet itself, for which the list has no advantage. Against a tree many configurations can be asked at
once (`Flock`).

Bodies that may touch stay in the list, with less than no margin. Closed meshes that are not convex, which coal takes
for surfaces, are asked for what is inside them as well (`Enclosures`).
"""

from collections.abc import Sequence
from copy import copy
from typing import Protocol

import numpy as np
import pinocchio as pin

from pipeline.errors import ProblemError
from pipeline.robots.broadphase import BroadPhase
from pipeline.robots.clearance import Distances
from pipeline.robots.contact import Contact, Pair, Touching, kept
from pipeline.robots.crowd import FLOCK, Crowd
from pipeline.robots.enclosure import Enclosures, enclosing_pairs
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle
from pipeline.robots.reasons import TooNear, too_near
from pipeline.robots.scene import Scene
from pipeline.robots.standing import check_standing, contacts_of_standing

_CROWD = 64  # obstacles, from which on they get a tree


class Condition(Protocol):
    """What else a configuration must meet, for example balance."""

    def holds(self, q: np.ndarray) -> bool:
        """True when q (n,) meets it."""
        ...

    def reason(self, q: np.ndarray) -> str:
        """Return why q (n,) does not meet it, with value and bound."""
        ...

    def first_gap(self, states: np.ndarray) -> int | None:
        """Return the first chord of a path (T, n) along which it is not met, margins aside; None when all are."""
        ...


class Validity:
    """Tells whether configurations of a robot are valid among obstacles. Not shareable between processes.

    Closed meshes are solid, open ones surfaces (`surfaces`). Bodies that may touch may be in each other by 2 mm, or a
    tenth of the thinner one's least extent where that is less, unless another depth is given. Bodies that no joint
    moves are held against obstacles once, here: those of the root link may touch what they stand on to the same depth.

    Args:
        robot: the robot; which of its bodies may touch each other is in `robot.touching`.
        obstacles: of the scene; may be empty.
        margin: least distance to obstacles [m].
        self_margin: least distance between bodies of a self-collision pair [m]; None for the same as `margin`.
        touching: pairs (body, obstacle) by name that may touch, a cup and the table it stands on, and, as a mapping,
            how deep [m]: above 0 and at most half of the thinner one's least extent, None for the usual depth. Of a
            body in pieces all pieces may. Where there is a margin, up to a quarter of the depth is kept in its place.
        conditions: what else configurations must meet.

    Raises:
        ProblemError: a margin that is not finite or negative, a body or obstacle that does not exist, a pair that may
            touch of which no depth is known, a depth out of bounds, a body larger than 20 m, or an obstacle that stands
            in a body that no joint moves.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Sequence[Obstacle],
        margin: float = 0.0,
        self_margin: float | None = None,
        touching: Touching = (),
        conditions: Sequence[Condition] = (),
    ) -> None:
        for name, value in (("margin", margin), ("self_margin", margin if self_margin is None else self_margin)):
            if not 0 <= value < np.inf:
                raise ProblemError(f"{name} is {value} m; it must be finite and at least 0 m")
        self.robot, self.obstacles = robot, tuple(obstacles)
        self.margin, self.self_margin = margin, self_margin
        self.conditions = tuple(conditions)
        self.checks = 0  # collision queries so far
        self._base = margin, margin if self_margin is None else self_margin  # to obstacles, between bodies [m]
        self._reserve = 0.0  # that all pairs keep besides [m]
        self._wider: dict[float, Validity] = {}
        self._scene = Scene(robot, obstacles, touching)
        self.touching = self._scene.touching
        self._distances = Distances(self._scene)
        check_standing(self._distances)
        enclosing = enclosing_pairs(self._scene)
        self._enclosures = Enclosures(self._scene, enclosing) if enclosing else None
        apart = {number for _, number in self._scene.touching_numbers}
        crowded = len(obstacles) > _CROWD or not len(robot.geometry.collisionPairs)
        self._listed = [i for i in range(len(obstacles)) if i in apart or not crowded]
        crowd = sorted(set(range(len(obstacles))) - set(self._listed))
        self._pairs = self._list()
        self._crowd = Crowd(self._scene, crowd, margin) if crowd else None

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of bodies and obstacles that are meshes with open edges: surfaces, in which nothing can be."""
        return self._scene.surfaces

    def pairs(self) -> list[Pair]:
        """Return all pairs that are held against each other at every configuration, with the depth allowed."""
        return list(self._scene.pairs())

    def widened(self, reserve: float) -> "Validity":
        """Return the checker of the same robot and obstacles with `reserve` [m] more margin; made once and kept."""
        if reserve not in self._wider:
            more = self._reserve + reserve
            other = self._with(self._margins(more), self._base[0] + more)
            other._reserve, other.margin, other.self_margin = more, self._base[0] + more, self._base[1] + more
            self._wider[reserve] = other
        return self._wider[reserve]

    def reserving(self, bodies: np.ndarray, pairs: np.ndarray) -> "Validity":
        """Return a checker of contact with reserves in place of margins; without conditions.

        Pairs that may touch keep the reserve from being as deep as they may.

        Args:
            bodies: that each body keeps from obstacles (B,) [m].
            pairs: that the bodies of each self-collision pair keep from each other (P,) [m].
        """
        moving = self._scene.moving
        listed = np.array([bodies[i] - self._scene.depth(i, number) for number in self._listed for i in moving])
        margins = np.concatenate([pairs - self._scene.pair_depths, listed])
        other = self._with(margins, float(np.max(bodies[moving], initial=0.0)))
        other.conditions = ()
        return other

    def in_bounds(self, q: np.ndarray) -> bool:
        """True when every joint of q (n,) is finite and within its limits."""
        inside = bool(np.all((q >= self.robot.lower) & (q <= self.robot.upper)))
        return inside and (self.robot.turns is None or bool(np.isfinite(q).all()))

    def free(self, q: np.ndarray) -> bool:
        """True when q (n,) meets the conditions, keeps the margin to all obstacles and does not collide with itself."""
        self.checks += 1
        for condition in self.conditions:
            if not condition.holds(q):
                return False
        if self._crowd is not None and self._crowd.strikes(q):
            return False
        if self._pairs is not None and self._pairs.collides(q):
            return False
        return self._enclosures is None or not self._enclosures.any(q)

    def free_rows(self, Q: np.ndarray) -> np.ndarray:
        """Tell which rows of Q (m, n) are free (m,); against a tree of obstacles faster than one by one."""
        if self._crowd is None:
            return np.array([self.free(q) for q in Q], bool)
        self.checks += len(Q)
        free = ~self._crowd.struck_rows(Q)
        if self._asks_more:
            free[free] = [self._free_beside_crowd(q) for q in Q[free]]
        return free

    def all_free(self, Q: np.ndarray) -> np.ndarray:
        """Tell of sets of configurations (e, m, n) in which all are free (e,); against a tree faster than by row."""
        if self._crowd is None or Q.shape[1] > FLOCK:
            return np.array([all(self.free(q) for q in rows) for rows in Q], bool)
        self.checks += Q.shape[0] * Q.shape[1]
        free = ~self._crowd.struck_sets(Q)
        if self._asks_more:
            free[free] = [all(self._free_beside_crowd(q) for q in rows) for rows in Q[free]]
        return free

    def prepare(self, *sizes: int) -> None:
        """Make what `all_free` of sets of these sizes otherwise makes when it is asked, in milliseconds."""
        if self._crowd is not None:
            for copies in sizes:
                self._crowd.flock(copies)

    def valid(self, q: np.ndarray) -> bool:
        """True when q (n,) is within the limits and free."""
        return self.in_bounds(q) and self.free(q)

    def contacts(self, q: np.ndarray) -> list[tuple[str, str]]:
        """Return the pairs (body, body or obstacle) by name that are nearer than they may be at q (n,)."""
        return list(dict.fromkeys((pair.first, pair.second) for pair in self._too_near(q)))  # pieces of one body once

    def reason(self, q: np.ndarray) -> str:
        """Return why q (n,) is not free, for messages: each pair with its own distance."""
        pairs = ", ".join(map(str, self._too_near(q)))
        parts = [f"in collision: {pairs}"] if pairs else []
        return "; ".join(parts + [c.reason(q) for c in self.conditions if not c.holds(q)]) or "free"

    def clearance(self, q: np.ndarray) -> float:
        """Return the distance from the robot at q (n,) to the nearest obstacle [m]; negative inside, inf without any.

        Self-collision, pairs that may touch and bodies that no joint moves are not part of it.
        """
        return self.least_clearance(q[None])

    def least_clearance(self, Q: np.ndarray) -> float:
        """Return the least `clearance` of configurations Q (m, n) [m]; at once much faster than one by one."""
        return self._distances.least(self._scene.moving, Q)

    def deepest_contact(self, Q: np.ndarray) -> Contact | None:
        """Return the deepest contact of pairs that may touch over configurations Q (m, n); None where none touches.

        What the bodies of the root link stand on is one of them.
        """
        found = [contact for contact, _ in contacts_of_standing(self._distances)]
        return max(found + self._distances.contacts(Q), key=lambda contact: contact.depth, default=None)

    @property
    def _asks_more(self) -> bool:
        """Whether there is more to ask than the crowd."""
        return bool(self.conditions) or self._pairs is not None or self._enclosures is not None

    def _too_near(self, q: np.ndarray) -> list[TooNear]:
        return too_near(self._distances, q, *self._base, self._reserve)

    def _free_beside_crowd(self, q: np.ndarray) -> bool:
        """Tell whether conditions hold, no pair outside the tree collides and nothing is inside a mesh at q (n,)."""
        if not all(condition.holds(q) for condition in self.conditions):
            return False
        if self._pairs is not None and self._pairs.collides(q):
            return False
        return self._enclosures is None or not self._enclosures.any(q)

    def _with(self, margins: np.ndarray, margin: float) -> "Validity":
        """Return the checker of the same scene with other margins of the pairs in the list, and to the crowd [m]."""
        other = copy(self)
        other.checks, other._wider = 0, {}
        if self._pairs is not None:
            other._pairs = self._pairs.widened(margins.tolist())
        if self._crowd is not None:
            other._crowd = self._crowd.widened(margin)
        return other

    def _margins(self, reserve: float = 0.0) -> np.ndarray:
        """Return the margins of the pairs in the list, in its order [m]: of the robot's own pairs first."""
        scene = self._scene
        depths = np.array([scene.depth(i, number) for number in self._listed for i in scene.moving], float)
        margin, own = self._base
        return np.concatenate([kept(own, scene.pair_depths, reserve), kept(margin, depths, reserve)])

    def _list(self) -> BroadPhase | None:
        """Return the pairs of the robot with itself and with the listed obstacles; None when there is no pair."""
        geometry, bodies = self._scene.geometry(self._listed), len(self._scene.bodies)
        for pair in self.robot.geometry.collisionPairs:
            geometry.addCollisionPair(pair)
        for place in range(len(self._listed)):
            for i in self._scene.moving:
                geometry.addCollisionPair(pin.CollisionPair(i, bodies + place))
        margins = self._margins()
        return BroadPhase(self.robot.model, geometry, margins.tolist()) if len(margins) else None
