"""What a viewer shows of a robot is what pinocchio's kinematics and a hinge's own formula say, at every time."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from pipeline.environments import Band, SphereEnvironment
from pipeline.planning import solve
from pipeline.planning.output import recording
from pipeline.problems import read_problem
from pipeline.recording import Recording, time_parameterise, write_recording
from pipeline.robots import Obstacle, Robot, Shape, UrdfRobot, attach
from pipeline.spec.scene import Split
from pipeline.tasks import set_up
from tests.recording.viewer import Viewer, matrix, nanoseconds, walk, xyz
from tests.robots import worlds
from tests.robots.named import named

DOOR = Path(__file__).parents[2] / "examples" / "door_panda.yaml"
TURN = (0.1, -0.2, 0.3, 0.9)
AMONG = (
    Obstacle(Shape.BOX, (1.0, 0.2, 0.3), TURN, (0.4, 0.2, 0.6)),
    Obstacle(Shape.CYLINDER, (-0.6, 1.0, 0.5), TURN, (0.2, 0.2, 0.8)),
)
# A base that floats and is called like the root of every pose, an arm with two bodies, one of them turned.
WORLD_THAT_MOVES = """<robot name="strange">
  <link name="world"><collision><origin xyz="0.1 0 0" rpy="0.3 0 0"/><geometry><box size="0.3 0.2 0.1"/></geometry>
  </collision></link>
  <link name="arm">
    <collision><origin xyz="0 0 0.2" rpy="0 1 0"/><geometry><cylinder radius="0.05" length="0.4"/></geometry>
    </collision>
    <collision><origin xyz="0 0 0.4"/><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <joint name="arm" type="revolute"><parent link="world"/><child link="arm"/><origin xyz="0 0 0.1" rpy="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


def wandering(robot: Robot, tool: str, obstacles: tuple[Obstacle, ...] = (), count: int = 6) -> Recording:
    """A robot on its way through random configurations (count, n)."""
    Q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (count, robot.dimension))
    return Recording(robot, obstacles, Q, time_parameterise(Q, 0.5), tool, Q[0], Q[-1])


def carrying(folder: Path) -> Recording:
    cup = Obstacle(Shape.CYLINDER, (0.02, 0.01, 0.08), TURN, (0.06, 0.06, 0.15), "cup")
    return wandering(attach(named("panda"), cup, "panda_hand_tcp"), "panda_hand_tcp", AMONG)


def on_the_sphere(folder: Path) -> Recording:
    environment = SphereEnvironment(blocks=5, bands=(Band(-0.1, 0.1, "x", -1),))
    scene = environment.scenes({Split.TEST: 1})[0]
    found = wandering(set_up(scene.statement).robot, "point", scene.obstacles)
    return Recording(**{**vars(found), "manifold_sphere_radius": environment.radius})


def with_a_moving_world(folder: Path) -> Recording:
    (folder / "strange.urdf").write_text(WORLD_THAT_MOVES)
    bounds = {name: (-0.5, 0.5) for name in ("x", "y", "z", "yaw", "pitch", "roll")}
    joints = (*(f"base_{name}" for name in bounds), "arm")
    robot = UrdfRobot(str(folder / "strange.urdf"), joints, "arm", "strange", floating=bounds).robot()
    return wandering(robot, "arm")


def opening_a_door(folder: Path) -> Recording:
    solution = solve(read_problem(DOOR, time_limit=60.0))
    return recording(solution, solution.summary())


CASES: dict[str, Callable[[Path], Recording]] = {
    "panda": lambda folder: wandering(named("panda"), "panda_hand_tcp", AMONG),
    "carried": carrying,
    "door": opening_a_door,
    "sphere": on_the_sphere,
    "pholus": lambda folder: wandering(named("pholus"), "ball2"),
    "joints without frames": lambda folder: wandering(
        worlds.chain(np.random.default_rng(1), list(worlds.JOINTS), balls=0.05), "tool"
    ),
    "moving world": with_a_moving_world,
}


@pytest.fixture(scope="module", params=CASES)
def case(request, tmp_path_factory) -> tuple[Recording, Viewer]:
    folder = tmp_path_factory.mktemp("recording")
    found = CASES[request.param](folder)
    write_recording(folder / "a.mcap", found)
    return found, Viewer(folder / "a.mcap")


def placements(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Pose of every body in the world (4, 4), by pinocchio."""
    data, placed = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
    return {body.name: placed.oMg[i].homogeneous for i, body in enumerate(robot.geometry.geometryObjects)}


def test_every_body_is_where_it_is(case):
    """At every time each body of the robot, what it carries included, is drawn where forward kinematics has it."""
    found, viewer = case
    expected = [placements(found.robot, q) for q in found.states]
    assert {f"body/{name}" for name in expected[0]} == {name for name in viewer.entities if name.startswith("body/")}
    moved = set()
    for name in expected[0]:
        entity = viewer.entities[f"body/{name}"]
        (part,) = entity.triangles
        assert len(part.points) and len(part.indices)
        inside = matrix(part.pose.position, part.pose.orientation)
        drawn = np.array([viewer.shown(entity, time) @ inside for time in viewer.clock])  # (T, 4, 4)
        np.testing.assert_allclose(drawn, [T[name] for T in expected], atol=1e-9)
        if np.abs(drawn - drawn[0]).max() > 1e-3:
            moved.add(name)
    assert moved == {body.name for body in found.robot.geometry.geometryObjects if body.parentJoint}


def test_points_move_with_their_bodies(case):
    """Each body has a cloud, sent once, whose points lie on its surface at every time, all over it."""
    found, viewer = case
    bodies = {body.name: body for body in found.robot.geometry.geometryObjects}
    placed = [placements(found.robot, q) for q in found.states]
    assert {f"/robot_points/{name}" for name in bodies} == {t for t in viewer.clouds if t != "/obstacle_points"}
    for name, body in bodies.items():
        (_,) = viewer.messages[f"/robot_points/{name}"]
        frame, points = viewer.clouds[f"/robot_points/{name}"]
        assert 100 <= len(points) <= 500
        homogeneous = np.column_stack([points, np.ones(len(points))]).T  # (4, P)
        frames = [viewer.in_root(frame, time) for time in viewer.clock]
        there = np.array([np.linalg.inv(T[name]) @ F @ homogeneous for T, F in zip(placed, frames, strict=True)])
        local = there[0]
        assert np.abs(there - local).max() < 1e-6
        body.geometry.computeLocalAABB()
        size = np.ptp(local[:3], axis=1)
        whole = body.geometry.aabb_local.max_ - body.geometry.aabb_local.min_
        assert (size > 0.8 * whole).all() and (size < 1.001 * whole).all()
        flat = isinstance(body.geometry, coal.Box | coal.ConvexBase)  # round bodies are drawn with 24 corners
        assert np.abs(depth(body.geometry, local[:3].T)).max() < (1e-6 if flat else 0.01 * whole.max())


def depth(geometry: coal.CollisionGeometry, P: np.ndarray) -> np.ndarray:
    """How far points (N, 3) in a shape's frame are outside of it, negative inside, 0 on it (N,); closed forms."""
    across = np.linalg.norm(P[:, :2], axis=1)
    match geometry:
        case coal.Box():
            return (np.abs(P) - geometry.halfSide).max(axis=1)
        case coal.Sphere():
            return np.linalg.norm(P, axis=1) - geometry.radius
        case coal.Capsule():
            return np.hypot(across, np.maximum(np.abs(P[:, 2]) - geometry.halfLength, 0)) - geometry.radius
        case coal.Cylinder():
            return np.maximum(across - geometry.radius, np.abs(P[:, 2]) - geometry.halfLength)
        case coal.ConvexBase():
            planes = ConvexHull(np.array(geometry.points())).equations
            return (P @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    raise AssertionError(f"no formula for {geometry}")


def test_what_stands_stays(case):
    """Obstacles, the balls at start and goal and the tool's path are drawn at the same place at every time."""
    found, viewer = case
    ends = {
        name: found.robot.pose(q, found.tool).translation for name, q in (("start", found.start), ("goal", found.goal))
    }
    way = [found.robot.pose(q, found.tool).translation for q in found.states]
    for time in viewer.clock:
        for k, obstacle in enumerate(found.obstacles):
            entity = viewer.entities[f"obstacle/{k:04d}"]
            (part,) = [*entity.cubes, *entity.spheres, *entity.cylinders, *entity.triangles]
            drawn = viewer.shown(entity, time) @ matrix(part.pose.position, part.pose.orientation)
            np.testing.assert_allclose(drawn[:3, :3], obstacle.rotation, atol=1e-9)
            np.testing.assert_allclose(drawn[:3, 3], obstacle.position, atol=1e-9)
        for name, position in ends.items():
            (ball,) = viewer.entities[name].spheres
            drawn = viewer.shown(viewer.entities[name], time) @ matrix(ball.pose.position, ball.pose.orientation)
            np.testing.assert_allclose(drawn[:3, 3], position, atol=1e-9)
        (line,) = viewer.entities["path"].lines
        drawn = viewer.shown(viewer.entities["path"], time) @ matrix(line.pose.position, line.pose.orientation)
        np.testing.assert_allclose([xyz(p) for p in line.points] @ drawn[:3, :3].T + drawn[:3, 3], way, atol=1e-9)


def test_frames_are_one_tree(case):
    """One root, no cycle, and every frame that a message speaks of is in the tree from the first moment."""
    found, viewer = case
    assert viewer.root == "world"
    assert found.tool in viewer.children
    used = {
        m.frame_id for rows in viewer.messages.values() for *_, top in rows for m in walk(top) if hasattr(m, "frame_id")
    }
    assert used <= viewer.children | {viewer.root}
    for frame in viewer.children:
        viewer.in_root(frame, viewer.clock[0])


def test_quaternions_have_unit_length(case):
    """No message holds a quaternion of another length, which viewers would scale by or refuse."""
    _, viewer = case
    found = [m for rows in viewer.messages.values() for *_, top in rows for m in walk(top)]
    turns = np.array([[*xyz(m), m.w] for m in found if m.DESCRIPTOR.full_name == "foxglove.Quaternion"])
    assert len(turns) >= len(viewer.clock)
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1, atol=1e-12)


def test_time_runs_forward(case):
    """Log times never go back, on a topic they increase, and all that is stamped has the time it is logged at."""
    _, viewer = case
    for rows in viewer.messages.values():
        times = [time for time, _, _ in rows]
        assert times == [published for _, published, _ in rows]
        assert times[0] == 0 and all(before < after for before, after in pairwise(times))
        for time, _, top in rows:
            assert {nanoseconds(m.timestamp) for m in walk(top) if m.DESCRIPTOR.fields_by_name.get("timestamp")} <= {
                time
            }


def test_the_door_turns_about_its_hinge(tmp_path):
    """The panel is drawn where the hinge's place and the angle in the file put it: no kinematics of ours or others'."""
    write_recording(tmp_path / "a.mcap", opening_a_door(tmp_path))
    viewer = Viewer(tmp_path / "a.mcap")
    (part,) = viewer.entities["body/panel"].triangles
    angles = []
    for time, _, states in viewer.messages["/joint_states"]:
        (angle,) = [joint.position for joint in states.joints if joint.name == "door_0_yaw"]
        turned = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
        drawn = viewer.shown(viewer.entities["body/panel"], time) @ matrix(part.pose.position, part.pose.orientation)
        np.testing.assert_allclose(drawn[:3, :3], turned, atol=1e-9)
        np.testing.assert_allclose(
            drawn[:3, 3], np.array([0.75, 0.35, 0.45]) + turned @ np.array([0, -0.26, 0]), atol=1e-9
        )
        angles.append(angle)
    assert np.ptp(angles) > 0.7
