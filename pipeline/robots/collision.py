"""Validity of a configuration: joint limits, self-collision and collision with the obstacles of a scene.

The robot's geometry sits in pinocchio's broad-phase manager, which runs the kinematics and moves the bounding boxes;
the obstacles sit in a coal tree that is built once. One query of tree against tree costs a logarithm of the number of
obstacles (1.6 us from Python against 500 blocks), where a manager over all pairs costs a multiple of it.
"""

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin

from pipeline.errors import ProblemError
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle


class Validity:
    """Tells whether configurations of a robot are valid among obstacles. Not shareable between processes.

    Args:
        robot: the robot.
        obstacles: of the scene; may be empty.
        margin: least distance to obstacles and, for self-collision pairs, between bodies [m].
    """

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle], margin: float = 0.0) -> None:
        if not 0 <= margin < np.inf:
            raise ProblemError(f"margin is {margin} m; it must be finite and at least 0 m")
        self.robot = robot
        self.obstacles = tuple(obstacles)
        self.margin = margin
        self._wider: dict[float, Validity] = {}
        self.checks = 0  # collision queries so far
        self._model, self._geometry = robot.model, robot.geometry
        self._data = self._model.createData()
        self._geometry_data = self._geometry.createData()
        for request in self._geometry_data.collisionRequests:
            request.security_margin = margin
        # Tree against tree: coal cannot query its naive manager against a tree (it crashes).
        self._robot_manager = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._geometry, self._geometry_data
        )
        self._robot_tree = self._robot_manager.getManager()
        self._objects = [obstacle.collision_object() for obstacle in obstacles]
        self._tree = coal.DynamicAABBTreeCollisionManager()
        for placed in self._objects:
            placed.getAABB().expand(margin)  # coal applies a margin to shapes only, not to the boxes of its trees
            self._tree.registerObject(placed)
        self._tree.setup()
        self._callback = coal.CollisionCallBackDefault()
        self._callback.data.request.security_margin = margin
        self._result = self._callback.data.result  # of the last query; reaching it through the callback costs 0.35 us
        self._struck = False  # whether that query met an obstacle, so that the callback must forget it first
        self._bodies = [coal.CollisionObject(shape.geometry) for shape in self._geometry.geometryObjects]
        self._request = coal.DistanceRequest()
        self._self_pairs = len(self._geometry.collisionPairs) > 0

    def widened(self, reserve: float) -> "Validity":
        """Return the checker of the same robot and obstacles with `reserve` [m] more margin; made once and kept."""
        if reserve not in self._wider:
            self._wider[reserve] = Validity(self.robot, self.obstacles, self.margin + reserve)
        return self._wider[reserve]

    def in_bounds(self, q: np.ndarray) -> bool:
        """True when every joint of q (n,) is finite and within its limits."""
        return bool(np.all((q >= self.robot.lower) & (q <= self.robot.upper)))

    def collision_free(self, q: np.ndarray) -> bool:
        """True when q (n,) keeps the margin to all obstacles and collides with no body of its own."""
        self.checks += 1
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, q)
        self._robot_manager.update(False)
        if self._struck:
            self._callback.init()
        self._robot_tree.collide(self._tree, self._callback)
        self._struck = self._result.isCollision()
        if self._struck:
            return False
        return not (self._self_pairs and pin.computeCollisions(self._robot_manager, True))

    def valid(self, q: np.ndarray) -> bool:
        """True when q (n,) is within the limits and collision free."""
        return self.in_bounds(q) and self.collision_free(q)

    def clearance(self, q: np.ndarray) -> float:
        """Return the distance from the robot at q (n,) to the nearest obstacle [m]; negative inside, inf without any.

        Self-collision is not part of it. Every body is held against every obstacle, because distances from coal's tree
        are wrong (3.0.3: off by decimetres against a closed form); a hundred times the price of a verdict.
        """
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, q)
        nearest = np.inf
        for body, placement in zip(self._bodies, self._geometry_data.oMg, strict=True):
            body.setTransform(coal.Transform3s(placement.rotation, placement.translation))
            for placed in self._objects:
                nearest = min(nearest, coal.distance(body, placed, self._request, coal.DistanceResult()))
        return float(nearest)
