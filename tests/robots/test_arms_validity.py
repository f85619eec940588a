"""Verdicts of arms among obstacles are those of plain coal, pair by pair."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError, RobotError
from pipeline.robots import Obstacle, Robot, Shape, Validity, attach, point_robot
from tests.robots.named import ROBOT_NAMES, configurations, named
from tests.robots.worlds import ball_clearance, chain, random_obstacles


def spread(rng: np.random.Generator, count: int, robot: Robot) -> list[Obstacle]:
    """Obstacles of all primitive shapes about a robot, off its pose of rest and what stands, each with a name."""
    found: list[Obstacle] = []
    while len(found) < count:
        for obstacle in random_obstacles(rng, count, (0.05, 0.25)):
            place = 0.9 * np.array(obstacle.position) + [0, 0, 0.4]
            obstacle = replace(obstacle, position=tuple(place), name=f"o{len(found)}")
            if plain(robot, [obstacle], robot.rest, 0.03, 0.0, standing=True):
                found.append(obstacle)
    return found[:count]


def plain(robot: Robot, obstacles, q, margin=0.0, self_margin=None, touching=(), standing=False) -> bool:
    """True when no pair of the robot's bodies, and no moving body and obstacle, come nearer than the margins.

    `touching` says how deep pairs (body, obstacle) may be in each other [m]; bodies of the robot that may touch are not
    asked. With `standing` bodies that do not move are held against obstacles as well.
    """
    data, geometry = robot.model.createData(), robot.geometry
    placed = geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
    bodies = []
    for body, M in zip(geometry.geometryObjects, placed.oMg, strict=True):
        bodies.append(coal.CollisionObject(body.geometry, M.rotation, M.translation))
    request = coal.CollisionRequest()
    request.security_margin = margin if self_margin is None else self_margin
    names = robot.body_names
    for pair in geometry.collisionPairs:
        named = names[pair.first], names[pair.second]
        asked = named not in robot.touching and named[::-1] not in robot.touching
        if asked and coal.collide(bodies[pair.first], bodies[pair.second], request, coal.CollisionResult()):
            return False
    touching = dict(touching)
    for obstacle in obstacles:
        there = obstacle.collision_object()
        for body, shape in zip(geometry.geometryObjects, bodies, strict=True):
            depth = touching.get((body.name, obstacle.name))
            request.security_margin = margin if depth is None else -depth
            asked = body.parentJoint or standing
            if asked and coal.collide(shape, there, request, coal.CollisionResult()):
                return False
    return True


@pytest.mark.parametrize("count", [0, 15, 80])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_verdicts_are_plain_coals(name, count):
    """Among none, a few and a crowd of obstacles, with and without margin, a verdict is that of all pairs."""
    robot, rng = named(name), np.random.default_rng(count)
    obstacles = spread(rng, count, robot)
    near = robot.rest + rng.normal(scale=0.1, size=(60, robot.dimension))
    Q = np.concatenate([configurations(robot, rng, 40), np.clip(near, robot.lower, robot.upper)])
    for margin, self_margin in ((0.0, None), (0.02, 0.0)):
        validity = Validity(robot, obstacles, margin, self_margin)
        verdicts = [validity.free(q) for q in Q]
        assert verdicts == [plain(robot, obstacles, q, margin, self_margin) for q in Q]
        assert any(verdicts)
        assert not all(verdicts)


def test_crowd_and_list_agree():
    """The same obstacles give the same verdicts whether they are few or, with far ones added, a crowd."""
    robot, rng = named("panda"), np.random.default_rng(3)
    obstacles = spread(rng, 30, robot)
    far = [Obstacle(Shape.SPHERE, (20.0 + i, 0, 0), (0, 0, 0, 1), (0.1,) * 3) for i in range(60)]
    few, crowd = Validity(robot, obstacles, 0.01), Validity(robot, [*obstacles, *far], 0.01)
    Q = configurations(robot, rng, 400)
    verdicts = [few.free(q) for q in Q]
    assert verdicts == [crowd.free(q) for q in Q]
    assert 20 < sum(verdicts) < 380


def tool_ball(size: float = 0.1) -> Obstacle:
    return Obstacle(Shape.SPHERE, (0.0, 0.0, 0.05), (0, 0, 0, 1), (size,) * 3, "cup")


def test_grasped_object_moves_with_the_hand():
    """A ball in the hand hits an obstacle exactly where its centre, by the hand's pose, comes near enough."""
    robot, rng = named("panda"), np.random.default_rng(4)
    bare = replace(robot, geometry=pin.GeometryModel())
    carrier = attach(bare, tool_ball(), "panda_hand_tcp")
    obstacles = spread(rng, 40, robot)
    validity = Validity(carrier, obstacles)
    Q = configurations(robot, rng, 500)
    centres = np.array([robot.pose(q, "panda_hand_tcp").act(np.array([0, 0, 0.05])) for q in Q])
    clearance = ball_clearance(obstacles, centres, 0.05)
    decided = np.abs(clearance) > 1e-5
    assert [validity.free(q) for q in Q[decided]] == (clearance[decided] > 0).tolist()
    assert 20 < (clearance > 0).sum() < 480


def test_grasped_object_leaves_the_hand_alone():
    """An object within the hand collides with no body of the hand's joint, but with the robot's other bodies."""
    robot = named("panda")
    held = attach(robot, tool_ball(0.2), "panda_hand_tcp")
    assert Validity(held, []).free(robot.rest)
    large = attach(robot, replace(tool_ball(), size=(1.5, 1.5, 1.5)), "panda_hand_tcp")
    assert not Validity(large, []).free(robot.rest)
    others = [b.name for b in robot.geometry.geometryObjects]  # what may touch may not be in each other
    deep = Validity(attach(robot, replace(tool_ball(), size=(1.5, 1.5, 1.5)), "panda_hand_tcp", others), [])
    assert not deep.free(robot.rest) and not any("hand" in name for pair in deep.contacts(robot.rest) for name in pair)


def test_touching_pairs_may_touch():
    """A cup may stand on the table it is told to touch, and on nothing else; clearance leaves the pair out too."""
    held = attach(named("panda"), tool_ball(), "panda_hand_tcp")
    q = held.rest
    below = held.pose(q, "panda_hand_tcp").act(np.array([0, 0, 0.05])) - [0, 0, 0.05 + 0.025 - 0.0015]
    table = Obstacle(Shape.BOX, tuple(below), (0, 0, 0, 1), (0.5, 0.5, 0.05), "table")
    assert not Validity(held, [table]).free(q)
    touching = Validity(held, [table], touching=[("cup", "table")])
    assert touching.free(q) == plain(named("panda"), [table], q)
    assert touching.free(q)
    assert touching.clearance(q) > Validity(held, [table]).clearance(q)
    twin = replace(table, name="twin")
    assert not Validity(held, [table, twin], touching=[("cup", "table")]).free(q)
    crowd = [Obstacle(Shape.SPHERE, (20.0 + i, 0, 0), (0, 0, 0, 1), (0.1,) * 3) for i in range(100)]
    assert Validity(held, [table, *crowd], touching=[("cup", "table")]).free(q)
    assert not Validity(held, [table, twin, *crowd], touching=[("cup", "table")]).free(q)
    sunk = replace(table, position=(*below[:2], below[2] + 0.01))
    assert not Validity(held, [sunk], touching=[("cup", "table")]).free(q)
    assert Validity(held, [sunk], touching={("cup", "table"): 0.012}).free(q)


def test_mesh_and_octree_obstacles(tmp_path):
    """A box given as a mesh file, and as an octree of points inside it, gives a ball the verdicts of the box."""
    size, corners = np.array([0.4, 0.6, 0.8]), np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6),
             (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    text = "".join(f"v {' '.join(map(str, c / 2))}\n" for c in corners)
    text += "".join(f"f {' '.join(str(i + 1) for i in face)}\n" for face in faces)
    (tmp_path / "box.obj").write_text(text)
    rng = np.random.default_rng(5)
    place = {"position": (0.1, 0.2, -0.1), "quaternion": (0.1, 0.2, 0.3, 0.9)}
    box = Obstacle(Shape.BOX, **place, size=tuple(size))
    mesh = Obstacle(Shape.MESH, **place, size=tuple(size), file=str(tmp_path / "box.obj"))
    grid = np.stack(np.meshgrid(*(np.arange(-s / 2 + 0.01, s / 2, 0.02) for s in size)), axis=-1).reshape(-1, 3)
    octree = Obstacle(Shape.OCTREE, **place, size=(0.02,) * 3, points=grid)
    robot = point_robot(0.05, [-2] * 3, [2] * 3)
    Q = box.position + 0.7 * rng.uniform(-1, 1, (500, 3))
    distance = ball_clearance([box], Q, 0.05)
    solid, shell, leaves = (Validity(robot, [o]) for o in (box, mesh, octree))
    for q, d in zip(Q, distance, strict=True):
        if abs(d) > 1e-4:
            assert solid.free(q) == (d > 0)
            assert shell.free(q) == (d > 0)
        if abs(d) > 0.04:  # a leaf's diagonal
            assert leaves.free(q) == (d > 0)


def test_conditions_are_asked():
    """A configuration that fails a condition is not free, and the condition is not asked of the verdict of another."""

    class Above:
        def holds(self, q):
            return bool(q[2] > 0)

    validity = Validity(point_robot(0.1, [-1] * 3, [1] * 3), [], conditions=[Above()])
    assert validity.free(np.array([0, 0, 0.5])) and not validity.free(np.array([0, 0, -0.5]))
    assert not validity.widened(0.1).free(np.array([0, 0, -0.5]))


BAD_GRASPS = {
    "no name": (lambda r: attach(r, replace(tool_ball(), name=""), "panda_hand"), RobotError, "empty"),
    "name taken": (lambda r: attach(r, replace(tool_ball(), name="panda_hand_0"), "panda_hand"), RobotError, "taken"),
    "no frame": (lambda r: attach(r, tool_ball(), "panda_hnad"), RobotError, "did you mean 'panda_hand'"),
    "no body": (lambda r: attach(r, tool_ball(), "panda_hand", ["panda_link"]), RobotError, "lacks: 'panda_link'"),
    "no mesh": (
        lambda r: attach(r, replace(tool_ball(), shape=Shape.MESH, file="no.stl"), "panda_hand"),
        ProblemError,
        "no mesh 'no.stl'",
    ),
    "no points": (
        lambda r: attach(r, replace(tool_ball(), shape=Shape.OCTREE), "panda_hand"),
        ProblemError,
        "needs points",
    ),
    "touching body": (lambda r: Validity(r, [], touching=[("cup", "table")]), ProblemError, "lacks: 'cup'"),
    "touching obstacle": (
        lambda r: Validity(r, [], touching=[("panda_hand_0", "table")]),
        ProblemError,
        "'table'; there are: none",
    ),
    "self margin": (lambda r: Validity(r, [], self_margin=-1.0), ProblemError, "self_margin is -1.0 m"),
}


@pytest.mark.parametrize("case", BAD_GRASPS)
def test_bad_grasps_and_scenes_are_refused(case):
    """Names that do not exist or are taken, and shapes without content, are refused with what there is."""
    make, kind, message = BAD_GRASPS[case]
    with pytest.raises(kind, match=message):
        make(named("panda"))


@pytest.mark.parametrize("seed", range(4))
def test_random_chains(seed):
    """Random serial chains of balls among random obstacles: the verdict is the closed form of every ball."""
    rng = np.random.default_rng(seed)
    kinds = rng.choice(["RX", "RY", "RZ", "PX", "revolute unaligned"], 6).tolist()
    robot, obstacles = chain(rng, kinds, balls=0.05), random_obstacles(rng, 20)
    validity = Validity(robot, obstacles, 0.01)
    data, verdicts = robot.model.createData(), []
    for q in rng.uniform(-2, 2, (200, 6)):
        pin.forwardKinematics(robot.model, data, q)
        centres = np.array([data.oMi[j].translation for j in range(1, 7)])
        clearance = ball_clearance(obstacles, centres, 0.05).min()
        if abs(clearance - 0.01) > 1e-5:
            verdicts.append(validity.free(q))
            assert verdicts[-1] == (clearance > 0.01)
    assert 10 < sum(verdicts) < len(verdicts)
