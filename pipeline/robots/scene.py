"""A robot's bodies and a scene's obstacles as collision checks take them: shapes, places, and who may touch whom."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError, unknown
from pipeline.robots.bodies import body_of
from pipeline.robots.contact import Pair, Touching, allowed_depth, depths_asked
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle
from pipeline.robots.shapes import LARGEST, BodyShape


class Scene:
    """What collision checkers of one robot among the same obstacles share.

    Args:
        robot: the robot.
        obstacles: in the world.
        touching: pairs (body, obstacle) by name that may touch, and how deep [m]; None for the usual depth.

    Raises:
        ProblemError: a body or obstacle that does not exist, a shape that cannot be, a body larger than LARGEST, or a
            pair that cannot be told how deep it touches (see `allowed_depth`).
    """

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle], touching: Touching) -> None:
        self.robot, self.obstacles = robot, tuple(obstacles)
        self.bodies = list(robot.geometry.geometryObjects)
        self.body_names = robot.body_names
        self.moving = [i for i, body in enumerate(self.bodies) if body.parentJoint]
        self.fixed = [i for i, body in enumerate(self.bodies) if not body.parentJoint]
        self.body_shapes: tuple[BodyShape, ...] = robot.shapes
        for name, shape in zip(self.body_names, self.body_shapes, strict=True):
            extent = float(2 * shape.box[1].max())
            if extent > LARGEST:
                raise ProblemError(
                    f"body {name!r} of {robot.name!r} is {extent:.4g} m large; at most {LARGEST:g} m: a mesh in "
                    "millimetres needs scale 0.001 in the URDF"
                )
        self.obstacle_shapes = [obstacle.body_shape() for obstacle in self.obstacles]
        self._check_octrees()
        self.names = tuple(obstacle.name or f"obstacle {number}" for number, obstacle in enumerate(self.obstacles))
        self.positions = np.array([obstacle.position for obstacle in self.obstacles], float).reshape(-1, 3)
        quaternions = [obstacle.quaternion for obstacle in self.obstacles]
        self.rotations = Rotation.from_quat(quaternions).as_matrix() if quaternions else np.empty((0, 3, 3))
        self.touching_numbers = self._touching(touching)  # by the numbers of body and obstacle
        self.touching = {  # by their names
            (self.body_names[body], self.names[obstacle]): depth
            for (body, obstacle), depth in self.touching_numbers.items()
        }
        self.pair_depths = self._pair_depths()  # of the robot's self-collision pairs (P,) [m]

    def _check_octrees(self) -> None:
        """Refuse octrees against octrees, which coal takes to be in contact wherever they are (3.0.3)."""
        carried = [name for name, shape in zip(self.body_names, self.body_shapes, strict=True) if shape.octree]
        there = [o.name for o, shape in zip(self.obstacles, self.obstacle_shapes, strict=True) if shape.octree]
        if len(carried) > 1 or (carried and there):
            other = (carried[1:] + there)[0]
            raise ProblemError(
                f"{carried[0]!r} and {other!r} are both octrees, which cannot be held against each other: give what is "
                "carried as a mesh, boxes or cylinders"
            )

    def _touching(self, touching: Touching) -> dict[tuple[int, int], float]:
        """Return the pairs of body and obstacle that may touch and how deep [m]; obstacles may share a name."""
        found, there = {}, [obstacle.name for obstacle in self.obstacles]
        for (body, obstacle), depth in depths_asked(touching).items():
            pieces = self.robot.pieces_of(body)
            if not pieces:
                what = f"touching names a body that {self.robot.name!r} lacks:"
                raise ProblemError(unknown(what, body, map(body_of, self.body_names)))
            if obstacle not in there or not obstacle:
                raise ProblemError(unknown("touching names an obstacle that is not there:", obstacle, sorted(there)))
            firsts = [self.body_names.index(piece) for piece in pieces]
            numbers = [i for i, name in enumerate(there) if name == obstacle]
            for first, number in product(firsts, numbers):
                shapes = self.body_shapes[first], self.obstacle_shapes[number]
                found[first, number] = allowed_depth((body, obstacle), shapes, depth)
        return found

    def _pair_depths(self) -> np.ndarray:
        asked, found = self.robot.touching, []
        for pair in self.robot.geometry.collisionPairs:
            names = self.body_names[pair.first], self.body_names[pair.second]
            key = names if names in asked else names[::-1]
            shapes = self.body_shapes[pair.first], self.body_shapes[pair.second]
            found.append(allowed_depth(names, shapes, asked[key]) if key in asked else 0.0)
        return np.array(found, float)

    def depth(self, body: int, obstacle: int) -> float:
        """Return how deep a body may be in an obstacle [m]; 0 where it may not touch it."""
        return self.touching_numbers.get((body, obstacle), 0.0)

    def pairs(self) -> Iterator[Pair]:
        """Yield the pairs that are held against each other at every configuration: those in which a body moves."""
        names = self.body_names
        for pair, depth in zip(self.robot.geometry.collisionPairs, self.pair_depths.tolist(), strict=True):
            yield Pair(names[pair.first], names[pair.second], depth, pair.first, pair.second, obstacle=False)
        for number, name in enumerate(self.names):
            for i in self.moving:
                yield Pair(names[i], name, self.depth(i, number), i, number, obstacle=True)

    @cached_property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the bodies and obstacles that are open meshes: surfaces, in which nothing can be."""
        named = zip((*self.body_names, *self.names), (*self.body_shapes, *self.obstacle_shapes), strict=True)
        return tuple(name for name, shape in named if shape.open)

    def geometry(self, obstacles: Sequence[int] = ()) -> pin.GeometryModel:
        """Return the robot's bodies and then these obstacles, by their numbers, as pinocchio's; without pairs."""
        made = pin.GeometryModel()
        for body, shape in zip(self.bodies, self.body_shapes, strict=True):
            made.addGeometryObject(pin.GeometryObject(body.name, body.parentJoint, body.placement, shape.shape))
        for number in obstacles:
            placement = pin.SE3(self.rotations[number], self.positions[number])
            made.addGeometryObject(
                pin.GeometryObject(
                    f"obstacle {number} {self.names[number]}", 0, placement, self.obstacle_shapes[number].shape
                )
            )
        return made
