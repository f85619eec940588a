"""roboplan (PyPI) on upright transport and trays; needs `pip install 'constrained-motion-planning[peers]'`.

It reads the same URDF and SRDF as ours, meshes as they are in the files, and has the same limits, pairs of bodies,
obstacles, start, goal and tolerance; bodies that no joint moves are not held against obstacles, obstacles not against
each other. What it has otherwise is in `DIFFERENCES`, for pages.
"""

import time
from collections.abc import Collection
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import ConfigError
from pipeline.evaluation.routes import Case, Route
from pipeline.manifolds import Counters, dense, joined
from pipeline.planners import PlanResult, PlanStatus, Termination
from pipeline.robots import Geometry, Robot, Shape, UrdfRobot
from pipeline.robots.description import SHARE, resolve
from pipeline.spec.statement import Equation, Joined, Level
from pipeline.tasks import Task

GEOMETRY = Geometry.MESHES  # what it plans with
DIFFERENCES = (
    "It has the meshes of the files as they are, which to it are surfaces with nothing inside; ours are what the "
    "settings of the robot say, convex hulls or pieces around them. Its verdicts are those of our checker with meshes.",
    "It keeps no margin, where ours keeps one to obstacles and one between bodies.",
    "It asks for collisions every 0.05 rad of a motion and not again on the path it has found; ours every 0.05 rad, "
    "and every 0.025 rad of the found path.",
    "It projects a motion every 0.05 rad (its default is 0.1; this is our step) to a tenth of the tolerance, which it "
    "has for each constraint, for position and orientation apart; ours has it for the norm of all rows.",
    "It writes a level hand as roll and pitch that are 0, ours as the two components of an axis.",
    "Its path is straight between its states; they are joined on the manifold every 0.02 rad before it is verified.",
    "It is C++ throughout; its time includes making the planner, 0.1 ms. Making its scene is left out, as for ours.",
)
_DENSE = 0.02  # spacing at which its waypoints are joined on the manifold before they are verified [rad]
_GROUP, _WORLD = "planned", "universe"
_NODES = 1_000_000  # as good as no limit: time ends a search
_COLOR = np.array([0.5, 0.5, 0.5, 1.0])


@dataclass(frozen=True)
class RoboplanParameters:
    """roboplan's options; defaults are those of 0.7.0, but for RRT-Connect, which it has off, and projections.

    Attributes:
        max_connection_distance: longest motion [rad].
        step: of collision checks along a motion and of projections, 0.1 by its default [rad].
    """

    max_connection_distance: float = 3.0
    step: float = 0.05


def load_roboplan() -> tuple[Any, Any]:
    """Return roboplan's modules core and rrt.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        from roboplan import core, rrt
    except ImportError as error:
        raise ConfigError(f"roboplan cannot be imported ({error}); pip install 'roboplan==0.7.0'") from None
    return core, rrt


@dataclass
class Roboplan(Route):
    """roboplan's RRT-Connect, whose waypoints are joined on the manifold outside of the time.

    Attributes:
        settings: of the robot.
        parameters: roboplan's.
    """

    settings: UrdfRobot
    parameters: RoboplanParameters
    geometry: Geometry | None = field(default=GEOMETRY, kw_only=True)
    uncounted: tuple[str, ...] = field(default=("iterations", *(f.name for f in fields(Counters))), kw_only=True)
    _peer: "RoboplanPeer | None" = None  # made with the robot of the first task: its scene takes a second

    def plan(self, case: Case, termination: Termination, seed: int) -> PlanResult:
        """Plan a case; see `Route`."""
        if self._peer is None:
            self._peer = RoboplanPeer(self.settings, case.task.robot, self.parameters)
        seconds, path = self._peer.plan(case.task, termination.time_limit or np.inf, seed)  # it ends by time only
        space = self.manifold.at(case.task)
        if path is None:
            return PlanResult(PlanStatus.FAILED, np.empty((0, space.dimension)), seconds, 0.0, 0, Counters(), seed)
        states = joined(space, dense(space, path, _DENSE))
        return PlanResult(PlanStatus.SOLVED, states, seconds, 0.0, 0, Counters(), seed)


class RoboplanPeer:
    """Plans problems of one robot.

    Args:
        settings: of the robot, as in conf/robot.
        robot: made of them.
        parameters: roboplan's.
    """

    def __init__(self, settings: UrdfRobot, robot: Robot, parameters: RoboplanParameters) -> None:
        self.core, self.rrt = load_roboplan()
        self.robot, self.parameters = robot, parameters
        urdf = resolve(settings.urdf, settings.package_dirs)
        description = self.core.loadUrdfSceneDescription(str(urdf), [str(SHARE), *settings.package_dirs])
        self.scene = self.core.Scene(robot.name, description)
        if settings.srdf:
            self.scene.importSrdf(resolve(settings.srdf, settings.package_dirs).read_text())
        self.scene.addGroup(_GROUP, list(robot.joint_names))
        self.whole = np.array(self.scene.getCurrentJointPositions(), float)
        for joint, value in settings.fixed.items():
            if joint in self.scene.getJointNames():
                self.whole[self.scene.getJointPositionIndices([joint])] = value
        self.planned = self.scene.getJointPositionIndices(list(robot.joint_names))
        bodies = robot.geometry.geometryObjects
        self.standing = sorted({robot.model.frames[b.parentFrame].name for b in bodies if not b.parentJoint})
        self._hold(settings.robot().body_names)
        self.added: list[str] = []

    def plan(self, task: Task, time_limit: float, seed: int) -> tuple[float, np.ndarray | None]:
        """Return the time of planning [s] and the waypoints (T, n), None without a path."""
        self.furnish(task)
        core, rrt, parameters = self.core, self.rrt, self.parameters
        constraints = [self._constraint(says, task.constraint.tolerance) for says in task.equations]
        options = rrt.RRTOptions(
            group_name=_GROUP,
            max_nodes=_NODES,
            max_connection_distance=parameters.max_connection_distance,
            collision_check_step_size=parameters.step,
            max_planning_time=time_limit,
            rrt_connect=True,
        )
        options.constraint_projection.path_step_size = parameters.step
        start, goal = (core.JointConfiguration(list(self.robot.joint_names), q) for q in (task.start, task.goal))
        begin = time.perf_counter()
        planner = rrt.RRT(self.scene, options)
        planner.setRngSeed(seed)
        try:
            path = np.array(planner.plan(start, goal, constraints).positions)
        except RuntimeError:  # how it says that there is no path
            return time.perf_counter() - begin, None
        return time.perf_counter() - begin, path

    def _constraint(self, says: Equation, tolerance: float) -> Any:
        """Return roboplan's constraint for one of a task's."""
        free = np.array([np.inf, np.inf, np.inf, 0.0, 0.0, np.inf])
        region = np.eye(4)
        if isinstance(says, Level) and says.axis == (0.0, 0.0, 1.0) and says.direction[:2] == (0.0, 0.0):
            frame, reference, bounds = says.frame, "", free
            region[:3, :3] = np.diag([1.0, 1.0, 1.0]) if says.direction[2] > 0 else np.diag([1.0, -1.0, -1.0])
        elif isinstance(says, Level) and says.direction == (0.0, 0.0, 1.0):
            # Another axis of the frame than z: the world is held upright in the frame, which says the same.
            frame, reference, bounds = _WORLD, says.frame, free
            region[:3, :3] = Rotation.align_vectors(says.axis, (0.0, 0.0, 1.0))[0].as_matrix()
        elif isinstance(says, Joined):
            frame, reference, bounds = says.other, says.frame, np.zeros(6)
            region = says.relative.se3().homogeneous
        else:
            raise ConfigError(f"roboplan has no constraint for {says}")
        return self.rrt.PoseConstraint(
            self.scene, _GROUP, frame, -bounds, bounds, np.asfortranarray(region), reference, tolerance, tolerance
        )

    def _hold(self, own: Collection[str]) -> None:
        """Attach the bodies that the robot holds besides its own; bodies that may touch are no pair to check there."""
        geometry, frames = self.robot.geometry, self.robot.model.frames
        links = [frames[body.parentFrame].name for body in geometry.geometryObjects]
        names, touching = self.robot.body_names, {frozenset(pair) for pair in self.robot.touching}
        pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
        paired = {frozenset(pair) for pair in pairs if frozenset(names[i] for i in pair) not in touching}
        for i, body in enumerate(geometry.geometryObjects):
            if body.name not in own:
                carrier = frames[body.parentFrame]
                # In the frame of the joint: roboplan takes the pose to be in that, whatever frame of a link is named.
                pose = np.asfortranarray(body.placement.homogeneous)
                size = 2 * body.geometry.halfSide
                self.scene.addBoxGeometry(body.name, carrier.name, self.core.Box(*size), pose, _COLOR)
                asked = {links[j] for j in range(len(links)) if frozenset((i, j)) in paired}
                for link in sorted(set(links) - asked - {carrier.name}):
                    self.scene.setCollisions(link, body.name, False)

    def collides(self, q: np.ndarray) -> bool:
        """Tell whether it finds a collision at q (n,) in the scene of the last task."""
        whole = self.whole.copy()
        whole[self.planned] = q
        return bool(self.scene.hasCollisions(whole))

    def furnish(self, task: Task) -> None:
        """Take the scene of a task, in place of that of the last one."""
        core, scene = self.core, self.scene
        while self.added:
            scene.removeGeometry(self.added.pop())
        for obstacle in task.obstacles:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = obstacle.rotation, obstacle.position
            x, y, z = obstacle.size
            arguments = (obstacle.name, "universe")
            if obstacle.shape is Shape.BOX:
                scene.addBoxGeometry(*arguments, core.Box(x, y, z), np.asfortranarray(pose), _COLOR)
            else:
                scene.addCylinderGeometry(*arguments, core.Cylinder(x / 2, z), np.asfortranarray(pose), _COLOR)
            for body in (*self.standing, *self.added):
                scene.setCollisions(body, obstacle.name, False)
            self.added.append(obstacle.name)
        q = self.whole.copy()
        q[self.planned] = task.start
        scene.setJointPositions(q)
