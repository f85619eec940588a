"""Validity of a configuration: joint limits, conditions, self-collision and collision with the obstacles of a scene.

Up to a few dozen obstacles stand in a plain list beside the robot (`BroadPhase`), which is faster than a tree for them.

A crowd of obstacles sits in a coal tree of its own, which is built once. One query of tree against tree costs a
logarithm of their number (1.6 us from Python against 500 blocks), where a list costs a multiple of it. So do those of a
robot that cannot meet itself, for which the list has no advantage. Against a tree many configurations can be asked at
once (`Flock`).
"""

from collections.abc import Collection, Sequence
from copy import copy
from typing import Protocol

import coal
import numpy as np
import pinocchio as pin

from pipeline.errors import ProblemError, unknown
from pipeline.robots.bodies import body_of
from pipeline.robots.broadphase import BroadPhase
from pipeline.robots.flock import Flock
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle

_CROWD = 64  # obstacles, from which on they get a tree
_FLOCK = 16  # most configurations that one query answers for


class Condition(Protocol):
    """What else a configuration must meet, for example balance."""

    def holds(self, q: np.ndarray) -> bool:
        """True when q (n,) meets it."""
        ...


class Validity:
    """Tells whether configurations of a robot are valid among obstacles. Not shareable between processes.

    Bodies that no joint moves are not held against obstacles: a robot stands on its floor.

    Args:
        robot: the robot.
        obstacles: of the scene; may be empty.
        margin: least distance to obstacles [m].
        self_margin: least distance between bodies of a self-collision pair [m]; None for the same as `margin`.
        touching: pairs (body, obstacle) by name that may touch: a cup and the table it stands on. Of a body in pieces
            all pieces may.
        conditions: what else configurations must meet.

    Raises:
        ProblemError: a margin that is not finite or negative, or a body or obstacle that does not exist.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Sequence[Obstacle],
        margin: float = 0.0,
        self_margin: float | None = None,
        touching: Collection[tuple[str, str]] = (),
        conditions: Sequence[Condition] = (),
    ) -> None:
        for name, value in (("margin", margin), ("self_margin", margin if self_margin is None else self_margin)):
            if not 0 <= value < np.inf:
                raise ProblemError(f"{name} is {value} m; it must be finite and at least 0 m")
        named = {obstacle.name for obstacle in obstacles}
        for body, obstacle in touching:
            if not robot.pieces_of(body):
                there = map(body_of, robot.body_names)
                raise ProblemError(unknown(f"touching names a body that {robot.name!r} lacks:", body, there))
            if obstacle not in named or not obstacle:
                raise ProblemError(unknown("touching names an obstacle that is not there:", obstacle, sorted(named)))
        self.robot = robot
        self.obstacles = tuple(obstacles)
        self.margin, self.self_margin = margin, self_margin
        self.touching = frozenset((piece, name) for body, name in touching for piece in robot.pieces_of(body))
        self.conditions = tuple(conditions)
        self._wider: dict[float, Validity] = {}
        self._flocks: dict[int, Flock] = {}  # by the number of copies
        self.checks = 0  # collision queries so far
        self._model, self._data = robot.model, robot.model.createData()
        apart = {obstacle for _, obstacle in touching}
        crowded = len(obstacles) > _CROWD or not len(robot.geometry.collisionPairs)
        crowd = [o for o in obstacles if o.name not in apart or not o.name] if crowded else []
        in_tree = set(map(id, crowd))
        self._listed = [o for o in obstacles if id(o) not in in_tree]
        self._pairs = self._list(self._listed)
        self._crowded = crowd
        self._crowd = self._tree(crowd, margin) if crowd else None
        self._distances: list[tuple[int, coal.CollisionObject, coal.CollisionObject]] | None = None

    def widened(self, reserve: float) -> "Validity":
        """Return the checker of the same robot and obstacles with `reserve` [m] more margin; made once and kept."""
        if reserve not in self._wider:
            own = self.margin if self.self_margin is None else self.self_margin
            self._wider[reserve] = Validity(
                self.robot, self.obstacles, self.margin + reserve, own + reserve, self.touching, self.conditions
            )
        return self._wider[reserve]

    def vouching(self, radius: float, reserve: float = 0.0) -> "Validity":
        """Return a checker whose verdict "free" at q means `reserve` [m] from contact in a ball around q.

        The ball holds all q' for which no body can have travelled farther than `radius` times the length of its row of
        lever arms (see `pipeline.robots.travel`). Margins and conditions are left out.
        """
        arms, between = self.robot.lever_arms
        reach = np.linalg.norm(arms, axis=1)
        bodies = [i for i, body in enumerate(self.robot.geometry.geometryObjects) if body.parentJoint]
        names = self.robot.body_names
        levers = list(np.linalg.norm(between, axis=1))
        for obstacle in self._listed:
            levers += [reach[i] for i in bodies if (names[i], obstacle.name) not in self.touching]
        other = copy(self)
        other.conditions, other.checks, other._wider, other._distances = (), 0, {}, None
        other._data = self._model.createData()
        if self._pairs is not None:
            other._pairs = self._pairs.widened([reserve + radius * lever for lever in levers])
        if self._crowded:
            other._crowd = other._tree(self._crowded, reserve + radius * float(reach.max()))
        return other

    def in_bounds(self, q: np.ndarray) -> bool:
        """True when every joint of q (n,) is finite and within its limits."""
        return bool(np.all((q >= self.robot.lower) & (q <= self.robot.upper)))

    def free(self, q: np.ndarray) -> bool:
        """True when q (n,) meets the conditions, keeps the margin to all obstacles and does not collide with itself."""
        self.checks += 1
        for condition in self.conditions:
            if not condition.holds(q):
                return False
        if self._crowd is not None and self._strikes(q):
            return False
        return self._pairs is None or not self._pairs.collides(q)

    def free_rows(self, Q: np.ndarray) -> np.ndarray:
        """Tell which rows of Q (m, n) are free (m,); against a tree of obstacles faster than one by one."""
        if self._crowd is None:
            return np.array([self.free(q) for q in Q], bool)
        self.checks += len(Q)
        free = ~np.array(self._struck_rows(Q), bool)
        if self.conditions or self._pairs is not None:
            free[free] = [self._free_beside_crowd(q) for q in Q[free]]
        return free

    def all_free(self, Q: np.ndarray) -> np.ndarray:
        """Tell of sets of configurations (e, m, n) in which all are free (e,); against a tree faster than by row."""
        if self._crowd is None or Q.shape[1] > _FLOCK:
            return np.array([all(self.free(q) for q in rows) for rows in Q], bool)
        self.checks += Q.shape[0] * Q.shape[1]
        free = ~self._flock(Q.shape[1]).meet(Q, self._crowd, self._callback)
        if self.conditions or self._pairs is not None:
            free[free] = [all(self._free_beside_crowd(q) for q in rows) for rows in Q[free]]
        return free

    def prepare(self, *sizes: int) -> None:
        """Make what `all_free` of sets of these sizes otherwise makes when it is asked, in milliseconds."""
        if self._crowd is not None:
            for copies in sizes:
                self._flock(copies)

    def valid(self, q: np.ndarray) -> bool:
        """True when q (n,) is within the limits and free."""
        return self.in_bounds(q) and self.free(q)

    def contacts(self, q: np.ndarray) -> list[tuple[str, str]]:
        """Return the pairs (body, body or obstacle) by name that are nearer than the margin at q (n,): for messages."""
        geometry, found = self.robot.geometry, []
        placed, names = geometry.createData(), self.robot.body_names
        pin.updateGeometryPlacements(self._model, self._data, geometry, placed, q)
        bodies = [
            coal.CollisionObject(body.geometry, M.rotation, M.translation)
            for body, M in zip(geometry.geometryObjects, placed.oMg, strict=True)
        ]
        request = coal.CollisionRequest()
        request.security_margin = self.margin if self.self_margin is None else self.self_margin
        for pair in geometry.collisionPairs:
            if coal.collide(bodies[pair.first], bodies[pair.second], request, coal.CollisionResult()):
                found.append((body_of(names[pair.first]), body_of(names[pair.second])))
        request.security_margin = self.margin
        for number, obstacle in enumerate(self.obstacles):
            there = obstacle.collision_object()
            for body, shape, name in zip(geometry.geometryObjects, bodies, names, strict=True):
                asked = body.parentJoint and (name, obstacle.name) not in self.touching
                if asked and coal.collide(shape, there, request, coal.CollisionResult()):
                    found.append((body_of(name), obstacle.name or f"obstacle {number}"))
        return list(dict.fromkeys(found))  # pieces of one body once

    def reason(self, q: np.ndarray) -> str:
        """Return why q (n,) is not free, for messages."""
        pairs = [f"{one} with {two}" for one, two in self.contacts(q)]
        failing = [getattr(c, "name", "a condition") for c in self.conditions if not c.holds(q)]
        parts = (
            [f"in collision: {', '.join(pairs)}; clearance {self.clearance(q):.4g} m, margin {self.margin:.4g} m"]
            if pairs
            else []
        )
        return "; ".join(parts + [f"not meeting {name}" for name in failing]) or "free"

    def clearance(self, q: np.ndarray) -> float:
        """Return the distance from the robot at q (n,) to the nearest obstacle [m]; negative inside, inf without any.

        Self-collision and pairs that may touch are not part of it. Every body is held against every obstacle, because
        distances from coal's tree are wrong (3.0.3: off by decimetres against a closed form); a hundred times the
        price of a verdict.
        """
        if self._distances is None:
            self._distances = self._all_pairs()
        pin.updateGeometryPlacements(self._model, self._data, self._bodies, self._bodies_data, q)
        nearest, request = np.inf, coal.DistanceRequest()
        for i, body, placed in self._distances:
            placement = self._bodies_data.oMg[i]
            body.setTransform(coal.Transform3s(placement.rotation, placement.translation))
            nearest = min(nearest, coal.distance(body, placed, request, coal.DistanceResult()))
        return float(nearest)

    def _flock(self, copies: int) -> Flock:
        if copies not in self._flocks:
            self._flocks[copies] = Flock(self._model, self._moving, copies)
        return self._flocks[copies]

    def _free_beside_crowd(self, q: np.ndarray) -> bool:
        """Tell whether conditions hold and no pair outside the tree collides at q (n,)."""
        holds = all(condition.holds(q) for condition in self.conditions)
        return holds and (self._pairs is None or not self._pairs.collides(q))

    def _list(self, obstacles: Sequence[Obstacle]) -> BroadPhase | None:
        """Return the pairs of the robot with itself and with these obstacles; None when there is no pair."""
        geometry = self.robot.geometry.copy()
        margins = [self.margin if self.self_margin is None else self.self_margin] * len(geometry.collisionPairs)
        moving = [i for i, body in enumerate(geometry.geometryObjects) if body.parentJoint]
        for number, obstacle in enumerate(obstacles):
            placement = pin.SE3(obstacle.rotation, np.array(obstacle.position))
            name = f"obstacle {number} {obstacle.name}"
            added = geometry.addGeometryObject(pin.GeometryObject(name, 0, placement, obstacle.geometry()))
            for i in moving:
                if (geometry.geometryObjects[i].name, obstacle.name) not in self.touching:
                    geometry.addCollisionPair(pin.CollisionPair(i, added))
                    margins.append(self.margin)
        return BroadPhase(self._model, geometry, margins) if margins else None

    def _tree(self, obstacles: Sequence[Obstacle], margin: float) -> coal.DynamicAABBTreeCollisionManager:
        """Return the tree of these obstacles, and prepare that of the bodies that move."""
        self._moving = pin.GeometryModel()
        for body in self.robot.geometry.geometryObjects:
            if body.parentJoint:
                self._moving.addGeometryObject(body)
        self._moving_data = self._moving.createData()
        # Tree against tree: coal cannot query its naive manager against a tree (it crashes).
        self._moving_manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._moving, self._moving_data
        )
        self._moving_tree = self._moving_manager.getManager()
        self._objects = [obstacle.collision_object() for obstacle in obstacles]
        tree = coal.DynamicAABBTreeCollisionManager()
        for placed in self._objects:
            placed.getAABB().expand(margin)  # coal applies a margin to shapes only, not to the boxes of its trees
        tree.registerObjects(self._objects)  # together: one after the other the tree gets worse
        tree.setup()
        self._callback = coal.CollisionCallBackDefault()
        self._callback.data.request.security_margin = margin
        self._result = self._callback.data.result  # of the last query; reaching it through the callback costs 0.35 us
        return tree

    def _strikes(self, q: np.ndarray) -> bool:
        """Tell whether a body meets the crowd at q (n,)."""
        pin.updateGeometryPlacements(self._model, self._data, self._moving, self._moving_data, q)
        self._moving_manager.update(False)
        self._moving_tree.collide(self._crowd, self._callback)  # forgets what it met before
        return bool(self._result.isCollision())

    def _struck_rows(self, Q: np.ndarray) -> list[bool]:
        """Tell for rows of Q (m, n) whether a body meets the crowd; nothing is looked up twice."""
        place, update, collide = pin.updateGeometryPlacements, self._moving_manager.update, self._moving_tree.collide
        model, data, bodies, placed = self._model, self._data, self._moving, self._moving_data
        crowd, callback, met = self._crowd, self._callback, self._result.isCollision
        found = []
        for q in Q:
            place(model, data, bodies, placed, q)
            update(False)
            collide(crowd, callback)
            found.append(met())
        return found

    def _all_pairs(self) -> list[tuple[int, coal.CollisionObject, coal.CollisionObject]]:
        self._bodies = self.robot.geometry
        self._bodies_data = self._bodies.createData()
        placed = [(obstacle.name, obstacle.collision_object()) for obstacle in self.obstacles]
        return [
            (i, coal.CollisionObject(body.geometry), there)
            for i, body in enumerate(self._bodies.geometryObjects)
            if body.parentJoint
            for name, there in placed
            if (body.name, name) not in self.touching
        ]
