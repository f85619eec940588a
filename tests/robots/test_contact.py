"""Bodies that may touch may be in each other so deep and no deeper, by closed forms and through every route."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Robot, Shape, Validity, attach, point_robot
from tests.robots import meshes
from tests.robots.named import configurations, named
from tests.robots.worlds import RADIUS, ball_clearance, on_sphere, rotation

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
BALL = 0.05  # radius [m]
FAR = [Obstacle(Shape.SPHERE, (20.0 + i, 0, 0), UPRIGHT, (0.1,) * 3, f"far {i}") for i in range(70)]


def obstacle(kind: str, rng: np.random.Generator, folder) -> tuple[Obstacle, Obstacle]:
    """An obstacle of a kind, anywhere and turned anyhow, and a primitive with the same surface."""
    a, b, c = rng.uniform(0.1, 0.4, 3)
    size = {"sphere": (a, a, a), "cylinder": (a, a, c)}.get(kind, (a, b, c))
    shape = Shape(kind) if kind != "hull" else Shape.BOX
    primitive = Obstacle(shape, tuple(rng.uniform(-1, 1, 3)), tuple(rng.normal(size=4)), size, "table")
    if kind != "hull":
        return primitive, primitive
    file = meshes.write(folder / "box.obj", meshes.box())
    return replace(primitive, shape=Shape.MESH, file=file), primitive


def near(primitive: Obstacle, level: float, rng: np.random.Generator, count: int) -> np.ndarray:
    """Points at which a ball is deeper than a level, or less deep, by 1e-5 to 0.03 m (count, 3)."""
    directions, middle = on_sphere(rng, count), np.array(primitive.position)
    start = middle + 0.03 * rng.normal(size=(count, 3))
    low, high = np.zeros((count, 1)), np.full((count, 1), 2.0)
    for _ in range(50):
        half = (low + high) / 2
        inside = ball_clearance([primitive], start + half * directions, BALL)[:, None] < level
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    off = rng.choice([-1, 1], (count, 1)) * 10 ** rng.uniform(-5, -1.5, (count, 1))
    return start + (high + off) * directions


@pytest.mark.parametrize("crowd", [0, 70])
@pytest.mark.parametrize("kind", ["box", "sphere", "cylinder", "hull"])
def test_touching_is_contact_to_a_depth(kind, crowd, tmp_path):
    """A ball that may touch is free exactly when it is at most 2 mm deep in closed form; margins are not asked of it.

    So by `free`, `free_rows` and `all_free`, beside a crowd too; with a reserve less deep by it; at margin 5 mm the
    depth is 1.5 mm. The pair says 2 mm.
    """
    rng, robot, said = np.random.default_rng(crowd), point_robot(BALL, [-3] * 3, [3] * 3), []
    for _ in range(6):
        table, primitive = obstacle(kind, rng, tmp_path)
        scene = [table, *FAR[:crowd]]
        exact = Validity(robot, scene, touching=[("point", "table")])
        planned = Validity(robot, scene, 0.005, touching=[("point", "table")])
        assert [(pair.second, pair.depth) for pair in exact.pairs() if pair.depth] == [("table", 0.002)]
        bodies, none = np.full(1, 0.001), np.empty(0)
        for checker, depth in (
            (exact, 0.002),
            (planned, 0.0015),
            (planned.widened(0.001), 0.0005),
            (planned.widened(0.01), -0.0085),
            (exact.reserving(bodies, none), 0.001),
        ):
            Q = near(primitive, -depth, rng, 25)
            clearance = ball_clearance([primitive], Q, BALL)
            decided = np.abs(clearance + depth) > 2e-6
            wanted = clearance[decided] > -depth
            assert [checker.free(q) for q in Q[decided]] == wanted.tolist()
            np.testing.assert_array_equal(checker.free_rows(Q[decided]), wanted)
            np.testing.assert_array_equal(checker.all_free(Q[decided][:, None]), wanted)
            if depth in (0.002, 0.0015, -0.0085):
                assert [bool(checker.contacts(q)) for q in Q[decided]] == (~wanted).tolist()
            said += wanted.tolist()
    assert 0.2 < np.mean(said) < 0.8


def polytope(kind: str, rng: np.random.Generator) -> tuple[Obstacle, np.ndarray]:
    """A body at the origin, and the corners of a polytope with its surface, or nearly so."""
    size = tuple(rng.uniform(0.06, 0.3, 3))
    if kind == "cylinder":
        size = (size[0], size[0], size[2])
        points = meshes.tube(size[0] / 2, size[2], 60)[0][:-2]
    else:
        points = meshes.box(size)[0]
    return Obstacle(Shape(kind), (0.0, 0.0, 0.0), UPRIGHT, size, kind), points


@pytest.mark.parametrize("first", ["box", "cylinder"])
@pytest.mark.parametrize("second", ["box", "cylinder"])
def test_depth_is_that_of_the_minkowski_difference(first, second):
    """Depths of boxes and cylinders, flat on each other or askew, are those of their Minkowski difference."""
    rng, base = np.random.default_rng(5), replace(point_robot(0.01, [-3] * 3, [3] * 3), geometry=pin.GeometryModel())
    error = 1e-6 if first == second == "box" else 5e-4  # of 60 corners of a circle
    for number in range(12):
        (held, P), (there, Q) = polytope(first, rng), polytope(second, rng)
        turn = rng.normal(size=4) if number % 3 else np.array([0, 0, rng.normal(), 1.0])
        turned = Q @ rotation(turn).T
        planes = ConvexHull((P[:, None] - turned[None]).reshape(-1, 3)).equations
        robot = attach(base, held, "point")
        there = replace(there, quaternion=tuple(turn), name="there")
        validity = Validity(robot, [there], touching=[(first, "there")])
        aside = np.append(rng.uniform(-0.02, 0.02, 2), 0.0)
        direction = on_sphere(rng, 1)[0] if number % 3 else np.array([0, 0, 1.0])
        for wanted in 10 ** rng.uniform(-4, -2, 4):
            low, high = 0.0, 2.0
            for _ in range(50):
                half = (low + high) / 2
                q = aside + half * direction
                deeper = -(planes[:, :3] @ -q + planes[:, 3]).max() > wanted
                low, high = (half, high) if deeper else (low, half)
            q = aside + low * direction
            contact = validity.deepest_contact(q[None])
            assert contact.depth == pytest.approx(wanted, abs=error)
            assert (contact.first, contact.second) == (first, "there")
            if abs(wanted - 0.002) > error:
                assert validity.free(q) == (wanted < 0.002)


def test_nothing_passes_through_what_it_may_touch():
    """A carried bottle that is lowered through a table is refused on the way, however thin both are."""
    for thick in (0.04, 0.001, 0.0001):
        for width in (0.1, 0.001):
            bottle = Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.0), UPRIGHT, (width, width, 0.3), "bottle")
            robot = attach(point_robot(1e-4, [-3] * 3, [3] * 3), bottle, "point")
            table = Obstacle(Shape.BOX, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, thick), "table")
            validity = Validity(robot, [table], touching=[("bottle", "table")])
            way = np.zeros((401, 3))
            way[:, 2] = np.linspace(0.5, -0.5, 401)
            free = validity.free_rows(way)
            assert free[0] and free[-1] and not free[np.abs(way[:, 2]) < 0.149].any()
            (depth,) = [pair.depth for pair in validity.pairs() if pair.first == "bottle" and pair.obstacle]
            assert depth == pytest.approx(min(0.002, 0.1 * thick, 0.1 * width))


def test_bodies_beside_each_other():
    """A body that may touch another one of the robot may so to its depth, and may not be in it deeper."""
    model, geometry = pin.Model(), pin.GeometryModel()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.addFrame(pin.Frame("slide", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    other = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "rest")
    geometry.addGeometryObject(pin.GeometryObject("palm", other, pin.SE3.Identity(), pin.hppfcl.Sphere(0.1)))
    bare = Robot("pair", model, geometry, -np.ones(2), np.ones(2))
    cup = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), UPRIGHT, (0.2, 0.2, 0.2), "cup")
    for asked, depth in (((), 0.0), (["palm"], 0.002), ({"palm": 0.01}, 0.01), ({"palm": None}, 0.002)):
        robot = attach(bare, cup, "slide", asked)
        for obstacles in ((), FAR):
            validity = Validity(robot, obstacles)
            assert [pair.depth for pair in validity.pairs() if not pair.obstacle] == [pytest.approx(depth)]
            for off in (-1e-5, 1e-5):
                assert validity.free(np.array([0.2 - depth + off, 0.0])) == (off > 0)
        wide = Validity(robot, (), 0.0, 0.004)
        kept = 0.004 if not depth else min(0.004, depth / 4) - depth
        for off in (-1e-5, 1e-5):
            assert wide.free(np.array([0.2 + kept + off, 0.0])) == (off > 0)
            assert wide.widened(0.003).free(np.array([0.2 + kept + 0.003 + off, 0.0])) == (off > 0)
    found = validity.deepest_contact(np.array([[0.5, 0.0], [0.195, 0.0], [0.199, 0.0]]))
    assert (found.first, found.second) == ("palm", "cup") and found.depth == pytest.approx(0.005)
    assert validity.deepest_contact(np.array([[0.5, 0.0]])) is None


def test_pairs_are_all_there_are():
    """The pairs are those of the robot, and each moving body with each obstacle, by their names and numbers."""
    robot = attach(named("panda"), Obstacle(Shape.SPHERE, (0, 0, 0.1), UPRIGHT, (0.1,) * 3, "cup"), "panda_hand_tcp")
    scene = [
        Obstacle(Shape.BOX, (2.0, y, 0), UPRIGHT, (0.1,) * 3, name) for y, name in ((0, "table"), (1, ""), (2, "table"))
    ]
    pairs = Validity(robot, scene, touching={("cup", "table"): 0.003}).pairs()
    own = [pair for pair in pairs if not pair.obstacle]
    assert [(pair.body, pair.other) for pair in own] == [(p.first, p.second) for p in robot.geometry.collisionPairs]
    moving = [i for i, body in enumerate(robot.geometry.geometryObjects) if body.parentJoint]
    others = {(pair.body, pair.other): pair for pair in pairs if pair.obstacle}
    assert set(others) == {(i, number) for i in moving for number in range(3)} and len(others) == len(pairs) - len(own)
    cup = robot.body_names.index("cup")
    assert {key: pair.depth for key, pair in others.items() if pair.depth} == {(cup, 0): 0.003, (cup, 2): 0.003}
    for (body, number), pair in others.items():
        assert pair.first == robot.body_names[body] and pair.second == (scene[number].name or "obstacle 1")


@pytest.mark.parametrize("depth", [-0.001, 0.0, np.nan, np.inf, 0.021])
def test_depths_out_of_bounds(depth):
    """A depth that is not above 0, or more than half of the thinner body, is refused with the bound."""
    table = Obstacle(Shape.BOX, (0.0, 0.0, -1.0), UPRIGHT, (1.0, 1.0, 0.04), "table")
    robot = point_robot(BALL, [-3] * 3, [3] * 3)
    with pytest.raises(ProblemError, match=rf"'point' may touch 'table' {depth} m deep.*at most 0.02 m, half"):
        Validity(robot, [table], touching={("point", "table"): depth})
    assert Validity(robot, [table], touching={("point", "table"): 0.02}).pairs()[0].depth == 0.02


def test_meshes_that_may_be_touched(tmp_path):
    """A closed convex mesh may be touched, as its hull; another one, an open one and an octree are refused by name."""
    robot = point_robot(BALL, [-3] * 3, [3] * 3)
    bodies = {"box": meshes.box(), "corner": meshes.corner(), "open": (meshes.box()[0], meshes.box()[1][:-1])}
    files = {name: meshes.write(tmp_path / f"{name}.obj", mesh) for name, mesh in bodies.items()}
    there = {n: Obstacle(Shape.MESH, (0, 0, 0), UPRIGHT, (1, 1, 1), "table", file) for n, file in files.items()}
    there["octree"] = Obstacle(Shape.OCTREE, (0, 0, 0), UPRIGHT, (0.1,) * 3, "table", points=np.zeros((1, 3)))
    assert Validity(robot, [there["box"]], touching=[("point", "table")]).pairs()[0].depth == 0.002
    for name, words in (("corner", "a mesh that is not convex"), ("open", "open edges"), ("octree", "an octree")):
        with pytest.raises(ProblemError, match=f"'point' may touch 'table', but 'table' is .*{words}.*give what is"):
            Validity(robot, [there[name]], touching=[("point", "table")])
        held = attach(point_robot(RADIUS, [-3] * 3, [3] * 3), replace(there[name], name="held"), "point")
        with pytest.raises(ProblemError, match=f"'held' may touch 'box', but 'held' is .*{words}"):
            Validity(held, [Obstacle(Shape.BOX, (2, 0, 0), UPRIGHT, (1,) * 3, "box")], touching=[("held", "box")])


def test_reasons_say_how_deep():
    """Of each pair its own distance is said, and what it must keep: contact with itself is no clearance."""
    robot = attach(named("panda"), Obstacle(Shape.BOX, (0, 0, 0.1), UPRIGHT, (0.1,) * 3, "cup"), "panda_hand_tcp")
    hand = robot.pose(robot.rest, "panda_hand_tcp")
    below = hand.act(np.array([0, 0, 0.15 + 0.05 - 0.01]))
    turn = tuple(pin.Quaternion(hand.rotation).coeffs())
    table = Obstacle(Shape.BOX, tuple(below), turn, (0.4, 0.4, 0.1), "table")
    touching = [("cup", "table")]
    said = Validity(robot, [table], 0.005, touching=touching).reason(robot.rest)
    assert said == "in collision: cup with table (0.01 m deep, of at most 0.002 m, of which the margin keeps 0.0005 m)"
    said = Validity(robot, [table]).reason(robot.rest)
    assert said == "in collision: cup with table (0.01 m deep)"
    apart = replace(table, position=tuple(hand.act(np.array([0, 0, 0.15 + 0.05 + 0.004]))))
    said = Validity(robot, [apart], 0.005).reason(robot.rest)
    assert said == "in collision: cup with table (0.004 m apart, with a margin of 0.005 m)"
    assert Validity(robot, [apart], 0.003).reason(robot.rest) == "free"
    itself = Validity(named("panda"), [replace(table, position=(3.0, 0, 0))], 0.05, 0.0)
    Q = configurations(robot, np.random.default_rng(0), 100)
    said = next(itself.reason(q) for q in Q if not itself.free(q))
    assert "table" not in said and "clearance" not in said and " m deep)" in said
