"""Task space regions and their chains: distances by hand, poses by pinocchio, doors by geometry."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from pipeline.constraints import TaskSpaceRegion, chain, feasible
from pipeline.constraints.regions import AXES
from pipeline.errors import ConfigError, ConstraintError, RobotError
from pipeline.robots import Obstacle, Placement, Shape, Validity, attach
from tests.robots.named import configurations, named
from tests.robots.worlds import differences, placement

INF = np.inf
FREE = (-INF,) * 6, (INF,) * 6
ORIGIN, OFFSET = Placement((0.4, 0.1, 0.5), (0.1, -0.2, 0.3)), Placement((0.0, 0.02, -0.1), (0.0, 0.4, 0.0))


def region(**bounds: tuple[float, float]) -> TaskSpaceRegion:
    """A region free in all dimensions but those given."""
    low, high = (list(side) for side in FREE)
    for axis, (a, b) in bounds.items():
        low[AXES.index(axis)], high[AXES.index(axis)] = a, b
    return TaskSpaceRegion(tuple(low), tuple(high), ORIGIN, OFFSET)


def at(region: TaskSpaceRegion, *coordinates: float) -> pin.SE3:
    """The pose of e by homogeneous matrices: origin, displacement, offset."""
    x, y, z, roll, pitch, yaw = coordinates
    R = pin.utils.rotate("z", yaw) @ pin.utils.rotate("y", pitch) @ pin.utils.rotate("x", roll)
    return region.origin.se3() * pin.SE3(R, np.array([x, y, z])) * region.offset.se3()


def at_angles(coordinates: np.ndarray) -> pin.SE3:
    """The pose of a displacement (6,)."""
    return pin.SE3(pin.rpy.rpyToMatrix(*coordinates[3:]), coordinates[:3])


def test_distance_per_dimension():
    """Outside of an interval the displacement is the way to the nearer bound, inside and in free dimensions 0."""
    r = region(x=(-0.1, 0.2), z=(0.0, 0.0), yaw=(-0.5, 0.5), roll=(0.0, 0.0))
    inside = at(r, 0.1, 5.0, 0.0, 0.0, 1.2, -0.4)
    np.testing.assert_allclose(r.displacement(inside), np.zeros(6), atol=1e-12)
    outside = at(r, 0.5, -3.0, -0.2, 0.3, 0.7, 0.9)
    np.testing.assert_allclose(r.displacement(outside), [0.3, 0, -0.2, 0.3, 0, 0.4], atol=1e-12)
    assert r.distance(outside) == pytest.approx(np.sqrt(0.09 + 0.04 + 0.09 + 0.16))


def test_angles_count_from_the_nearer_bound():
    """An angle just past half a turn is near a bound on the other side of it, and within bounds that cross it."""
    r = region(yaw=(3.0, 3.1))
    assert r.displacement(at(r, 0, 0, 0, 0, 0, -3.1))[5] == pytest.approx(2 * np.pi - 6.2, abs=1e-9)
    across = region(yaw=(3.0, 3.4))
    assert across.distance(at(across, 0, 0, 0, 0, 0, -3.1)) == pytest.approx(0, abs=1e-12)


def test_sampled_poses_are_inside():
    """Random poses of a region are at distance 0 from it, and spread to its bounds."""
    rng, r = (
        np.random.default_rng(1),
        region(x=(-0.1, 0.2), y=(0.0, 0.0), z=(1.0, 2.0), pitch=(-0.3, 0.3), roll=(0.1, 0.1)),
    )
    poses = [r.sample(rng) for _ in range(200)]
    assert max(r.distance(T) for T in poses) < 1e-9
    d = np.array([r.coordinates(T) for T in poses])
    assert np.ptp(d[:, 0]) > 0.25 and np.ptp(d[:, 5]) > 6
    with pytest.raises(ConstraintError, match="finite bounds"):
        region().sample(rng)


def test_any_sampled_pose_is_inside():
    """Poses of random regions, with angles turns away and pitches across and beyond a quarter turn, are inside."""
    rng = np.random.default_rng(8)
    for _ in range(300):
        middle, half = rng.uniform(-9, 9, 6), rng.choice([0.0, 1e-9, 0.1, 1.0, 4.0], 6)
        middle[4] = rng.choice([middle[4], np.pi / 2, -np.pi / 2, 3 * np.pi / 2, 2.0])
        r = TaskSpaceRegion(tuple(middle - half), tuple(middle + half), ORIGIN, OFFSET)
        for T in (r.sample(rng) for _ in range(3)):
            assert r.distance(T) < 1e-8
            assert r.pose(r.coordinates(T)).isApprox(T, 1e-5)


def equal_angles(R: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw of an orientation in many ways (n, 3): a grid of rolls where the pitch is a quarter turn."""
    roll, pitch, yaw = pin.rpy.matrixToRpy(R)
    if abs(np.cos(pitch)) > 1e-6:
        return np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    side, rolls = np.sign(pitch), np.linspace(0, 2 * np.pi, 5000)
    return np.stack([rolls, np.full_like(rolls, pitch), yaw - side * roll + side * rolls], axis=1)


@pytest.mark.parametrize("pitch", [None, np.pi / 2, -np.pi / 2])
def test_distance_is_to_the_nearest_of_equal_angles(pitch):
    """The distance is the least over all triples of angles that say the orientation, turns of each of them included."""
    rng = np.random.default_rng(9)
    for _ in range(40):
        middle, half = rng.uniform(-6, 6, 3), rng.choice([0.0, 0.3, 1.0, np.inf], 3)
        low, high = middle - half, middle + half
        r = TaskSpaceRegion((-INF,) * 3 + tuple(low), (INF,) * 3 + tuple(high))
        angles = rng.uniform(-np.pi, np.pi, 3)
        T = pin.SE3(pin.rpy.rpyToMatrix(angles[0], angles[1] if pitch is None else pitch, angles[2]), np.zeros(3))
        turned = equal_angles(T.rotation)[:, None] + 2 * np.pi * np.arange(-3, 4)[:, None]  # (n, 7, 3)
        least = np.linalg.norm(np.abs(turned - np.clip(turned, low, high)).min(axis=1), axis=1).min()
        assert r.distance(T) == pytest.approx(least, abs=1e-9 if pitch is None else 2e-3)


def said_again(r: TaskSpaceRegion, rng: np.random.Generator) -> list[TaskSpaceRegion]:
    """The same region in other words: angles turns later, the other triple, and seen from a frame turned about z."""
    low, high = np.array(r.lower), np.array(r.upper)
    turns = 2 * np.pi * np.r_[0, 0, 0, rng.integers(-2, 3, 3)]
    other = [np.r_[side[:3], side[3] + np.pi, 0, side[5] + np.pi] for side in (low, high)]
    other[0][4], other[1][4] = np.pi - high[4], np.pi - low[4]
    yaw = rng.uniform(-3, 3)
    origin = Placement.of(r.origin.se3() * pin.SE3(pin.utils.rotate("z", yaw), np.zeros(3)))
    shift = np.r_[0, 0, 0, 0, 0, -yaw]
    return [
        replace(r, lower=tuple(low + turns), upper=tuple(high + turns)),
        replace(r, lower=tuple(other[0]), upper=tuple(other[1])),
        replace(r, lower=tuple(low + shift), upper=tuple(high + shift), origin=origin),
    ]


def test_said_in_other_words():
    """A region said in other words is as far from any pose; x and y are free, so that its frame can be turned."""
    rng = np.random.default_rng(10)
    for _ in range(60):
        middle, half = rng.uniform(-4, 4, 6), rng.choice([0.0, 0.3, 1.0, np.inf], 6)
        half[:2] = INF
        r = TaskSpaceRegion(tuple(middle - half), tuple(middle + half), ORIGIN, OFFSET)
        for T in [placement(rng) for _ in range(5)]:
            for other in said_again(r, rng):
                assert other.distance(T) == pytest.approx(r.distance(T), abs=1e-9)


def least_turn(R: np.ndarray, fixed: dict[int, float]) -> float:
    """The smallest angle from an orientation to one with these angles: on a grid of the free ones, then refined."""
    free = [i for i in range(3) if i not in fixed]

    def turn(values: np.ndarray) -> np.ndarray:
        angles = np.zeros((len(values), 3))
        angles[:, free] = values
        for i, value in fixed.items():
            angles[:, i] = value
        return (Rotation.from_matrix(R).inv() * Rotation.from_euler("xyz", angles)).magnitude()

    if not free:
        return float(turn(np.zeros((1, 0)))[0])
    grid = np.stack(np.meshgrid(*[np.linspace(-np.pi, np.pi, 50)] * len(free)), axis=-1).reshape(-1, len(free))
    begin = grid[int(np.argmin(turn(grid)))]
    return float(minimize(lambda x: turn(x[None])[0], begin, method="Nelder-Mead", tol=1e-10).fun)


SETS = [c for k in (1, 2, 3) for c in combinations((3, 4, 5), k)]


@pytest.mark.parametrize("pitch", [-0.2, 2.0, np.pi / 2, -np.pi / 2, 5.0])
@pytest.mark.parametrize("angles", SETS, ids=lambda c: "-".join(AXES[i] for i in c))
def test_fixed_angles_are_the_smallest_turn(angles, pitch):
    """The rows' length is the smallest turn that meets the fixed angles, by brute force; so it is 0 just inside."""
    rng, robot = np.random.default_rng(11), named("panda")
    bounds = {i: value for i, value in ((3, 0.3), (4, pitch), (5, -2.5)) if i in angles}
    r = region(**{AXES[i]: (value, value) for i, value in bounds.items()})
    constraint = r.constraint(robot)
    alone = angles == (4,) and abs(np.cos(pitch)) < 1e-6
    assert constraint.k == len(angles) + alone
    again = [other.constraint(robot) for other in said_again(r, rng)]
    for q in configurations(robot, rng, 4):
        T = robot.pose(q, robot.tool)
        R = (r.origin.se3().inverse() * T * r.offset.se3().inverse()).rotation
        turn = least_turn(R, {i - 3: value for i, value in bounds.items()})
        assert np.linalg.norm(constraint.value(q)) == pytest.approx(turn, abs=1e-6)
        for other in again:
            assert np.linalg.norm(other.value(q)) == pytest.approx(turn, abs=1e-6)


@pytest.mark.parametrize("pitch", [-0.2, 2.0, np.pi / 2, 5.0])
@pytest.mark.parametrize("angles", SETS, ids=lambda c: "-".join(AXES[i] for i in c))
def test_fixed_angles_are_smooth_inside(angles, pitch):
    """Where a region is met its rows are 0 and independent, with the Jacobian of finite differences, at any pitch."""
    rng, robot = np.random.default_rng(12), named("panda")
    for q in configurations(robot, rng, 3):
        inside = np.r_[0, 0, 0, 0.3, pitch, -2.5]
        r = replace(region(**{AXES[i]: (inside[i], inside[i]) for i in angles}), offset=Placement())
        r = replace(r, origin=Placement.of(robot.pose(q, robot.tool) * at_angles(inside).inverse()))
        constraint = r.constraint(robot)
        assert np.linalg.norm(constraint.value(q)) < 1e-9
        constraint.frame(q)
        near = q + 1e-3 * rng.normal(size=7)
        np.testing.assert_allclose(constraint.jacobian(near), differences(constraint.value, near), atol=1e-4)


@pytest.mark.parametrize("name", ["panda", "baxter_right"])
def test_fixed_dimensions_are_met(name):
    """Projected configurations are inside of the region by pinocchio; a pitch of 2 as well as one of -0.2."""
    robot = named(name)
    for pitch in (-0.2, 2.0):
        r = region(z=(0.2, 0.2), roll=(0.3, 0.3), pitch=(pitch, pitch))
        constraint = r.constraint(robot)
        assert constraint.k == 3
        Q, converged = constraint.project_batch(configurations(robot, np.random.default_rng(3), 60))
        assert converged.sum() > 10
        for q in Q[converged]:
            assert r.distance(robot.pose(q, robot.tool)) < 3e-3  # a turn of 0.001 is up to 0.0024 of roll there


def test_a_walk_passes_the_quarter_turn():
    """A hand that only pitches, its roll and yaw fixed, walks from a pitch of 1.2 to one of 1.9 as along any arc."""
    robot = named("panda")
    q = np.array([0.3, -0.4, 0.2, -1.9, 0.1, 1.6, 0.5])
    begin = np.r_[0, 0, 0, 0.0, 1.2, 0.0]
    r = region(roll=(0.0, 0.0), yaw=(0.0, 0.0))
    r = replace(
        r, origin=Placement.of(robot.pose(q, robot.tool) * r.offset.se3().inverse() * at_angles(begin).inverse())
    )
    constraint, pitches = r.constraint(robot), []
    Jw = np.array([0.0, 1.0, 0.0])
    for _ in range(200):
        T = robot.pose(q, robot.tool)
        pitches.append(r.coordinates(T)[4])
        tangent, _ = constraint.frame(q)
        data = robot.model.createData()
        J = pin.computeFrameJacobian(robot.model, data, q, robot.frame_id(robot.tool), pin.WORLD)[3:]
        turning = r.origin.se3().rotation @ Jw @ J @ tangent  # of the pitch, per step along the tangent space
        q = constraint.project(q + tangent @ turning / np.linalg.norm(turning) * 0.02).q
        if pitches[-1] > 1.9:
            break
    assert pitches[-1] > 1.9 and (np.diff(pitches) > 0).all()


BOUNDS = {
    13: dict(x=(-0.3, 0.3), y=(-0.3, 0.3), z=(-0.2, 0.2), roll=(-0.4, 0.4), pitch=(-0.4, 0.4), yaw=(-INF, INF)),
    11: dict(x=(-0.3, 0.3), y=(-0.3, 0.3), z=(-0.2, 0.2), roll=(0.0, 0.0), pitch=(0.0, 0.0), yaw=(-INF, INF)),
    9: dict(x=(0.0, 0.0), y=(-0.3, 0.3), z=(0.0, 0.0), roll=(0.0, 0.0), pitch=(0.0, 0.0), yaw=(-1.0, 1.0)),
}


@pytest.mark.parametrize("n", BOUNDS)
def test_implicit_manifold_space(n):
    """A chain of one region adds its 6, 4 or 2 unfixed dimensions; where its 6 rows are 0 the hand is in the region."""
    robot, r = named("panda"), replace(region(**BOUNDS[n]), offset=Placement(rpy=(np.pi, 0, 0)))
    held = chain(robot, [r])
    assert (held.constraint.n, held.constraint.k, held.robot.dimension, held.arm) == (n, 6, n, 7)
    np.testing.assert_allclose(held.robot.lower[:7], robot.lower)
    rng = np.random.default_rng(4)
    Q, converged = held.constraint.project_batch(configurations(held.robot, rng, 2000))
    inside = converged & ((Q >= held.robot.lower) & (Q <= held.robot.upper)).all(axis=1)
    assert inside.sum() > 10
    for q in Q[inside]:
        assert r.distance(robot.pose(q[:7], robot.tool)) < 2e-3
        np.testing.assert_allclose(held.constraint.jacobian(q), differences(held.constraint.value, q), atol=1e-5)


def test_chain_frames_are_poses_of_the_regions():
    """The end of a chain of two regions is the product of their poses at the chain's values."""
    rng = np.random.default_rng(5)
    first = region(x=(-1, 1), y=(-1, 1), z=(0.2, 0.2), roll=(-1, 1), pitch=(0.3, 0.3), yaw=(-1, 1))
    second = replace(
        region(x=(0, 0), y=(-1, 1), z=(-1, 1), roll=(0, 0), pitch=(-1, 1), yaw=(0.5, 0.5)),
        origin=Placement.of(placement(rng)),
    )
    held = chain(named("panda"), [first, second], name="links")
    for q in configurations(held.robot, rng, 5):
        x, y, yaw, roll, y2, z2, pitch2 = q[7:]
        T = at(first, x, y, 0.2, roll, 0.3, yaw)
        assert held.robot.pose(q, "links_0").isApprox(T, 1e-9)
        assert held.robot.pose(q, "links_1").isApprox(T * at(second, 0, y2, z2, 0, pitch2, 0.5), 1e-9)
    assert held.robot.joint_names[7:] == tuple(
        f"links_{i}" for i in ("0_x", "0_y", "0_yaw", "0_roll", "1_y", "1_z", "1_pitch")
    )


def test_a_chain_of_any_angles():
    """A chain whose pitch is across a quarter turn and whose yaw is a turn away ends where a region of them is met."""
    rng, robot = np.random.default_rng(15), named("panda")
    r = region(x=(-0.1, 0.1), y=(0, 0), z=(0, 0.1), roll=(-0.2, 0.2), pitch=(1.2, 2.0), yaw=(7.0, 7.2))
    for q in configurations(robot, rng, 5):
        origin = Placement.of(robot.pose(q, robot.tool) * replace(r, origin=Placement()).sample(rng).inverse())
        held = chain(robot, [replace(r, origin=origin)])
        values, violation = held.values(q)
        assert violation < 1e-6 and replace(r, origin=origin).distance(robot.pose(q, robot.tool)) < 1e-8
        assert (held.robot.lower[7:] <= values).all() and (values <= held.robot.upper[7:]).all()


HINGE = Placement((0.75, 0.35, 0.45))  # the door's axis, vertical
DOOR = TaskSpaceRegion((0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 1.2), HINGE)
# The handle is 0.4 m from the hinge, along -y when shut; the hand holds it level, pointing at the door, and may tilt.
HANDLE = TaskSpaceRegion(
    (0, 0, 0, 0, -0.5, 0), (0, 0, 0, 0, 0.5, 0), Placement((0.0, -0.4, 0.0)), Placement(rpy=(0, np.pi / 2, 0))
)


def test_hinged_door():
    """Along a door's manifold the hand keeps its distance from the hinge and its height, as the door's angle turns."""
    robot = named("panda")
    door = chain(robot, [DOOR, HANDLE], name="door")
    assert door.constraint.n == 9
    rng = np.random.default_rng(6)
    Q, converged = door.constraint.project_batch(configurations(door.robot, rng, 400))
    inside = converged & ((Q >= door.robot.lower) & (Q <= door.robot.upper)).all(axis=1)
    assert inside.sum() > 10 and np.ptp(Q[inside, 7]) > 0.4
    for q in Q[inside]:
        hand = robot.pose(q[:7], robot.tool).translation
        turned = np.array([np.sin(q[7]), -np.cos(q[7])]) * 0.4
        np.testing.assert_allclose(hand[:2], np.add([0.75, 0.35], turned), atol=2e-3)
        assert hand[2] == pytest.approx(0.45, abs=2e-3)


def test_the_door_itself_moves_and_collides():
    """A panel attached to the door's frame swings with it: it hits an obstacle at one angle and not at another."""
    door = chain(named("panda"), [DOOR, HANDLE], name="door")
    # Shut, the panel lies from the hinge towards -y; its frame is at the hinge.
    panel = Obstacle(Shape.BOX, (0.0, -0.2, 0.0), (0, 0, 0, 1), (0.02, 0.4, 0.4), "panel")
    robot = attach(replace(door.robot, geometry=pin.GeometryModel()), panel, "door_0")
    shut, ajar = door.robot.rest.copy(), door.robot.rest.copy()
    shut[7], ajar[7] = 0.0, 1.2
    on_the_way = Obstacle(Shape.SPHERE, (0.75, 0.05, 0.45), (0, 0, 0, 1), (0.1,) * 3, "ball")
    validity = Validity(robot, [on_the_way])
    assert not validity.free(shut) and validity.free(ajar)


def test_values_for_an_arm_configuration():
    """For an arm that holds the chain's end the values are those it was put at; otherwise ||F|| says so."""
    door = chain(named("panda"), [DOOR, HANDLE], name="door")
    q = feasible(door.constraint, door.robot.lower, door.robot.upper, np.random.default_rng(7))
    values, violation = door.values(q[:7])
    np.testing.assert_allclose(values, q[7:], atol=5e-3)
    assert violation < 1e-3
    away, violation = door.values(named("panda").rest)
    assert violation > 0.05
    assert (away >= door.robot.lower[7:]).all() and (away <= door.robot.upper[7:]).all()


MALFORMED = {
    "five bounds": (lambda: TaskSpaceRegion((0,) * 5, (0,) * 6), ConstraintError, "six numbers"),
    "NaN": (lambda: region(x=(np.nan, 0)), ConstraintError, "six numbers"),
    "crossed": (lambda: region(x=(1, 0)), ConstraintError, "x of a region has bounds 1 and 0"),
    "interval": (
        lambda: region(x=(0, 1), y=(0, 0)).constraint(named("panda")),
        ConstraintError,
        "bounds x by intervals.*chain",
    ),
    "nothing fixed": (lambda: region().constraint(named("panda")), ConstraintError, "fixes no dimension"),
    "no region": (lambda: chain(named("panda"), []), ConstraintError, "at least one region"),
    "all fixed": (lambda: chain(named("panda"), [TaskSpaceRegion((0,) * 6, (0,) * 6)]), ConstraintError, "use a pose"),
    "unbounded chain": (lambda: chain(named("panda"), [region()]), RobotError, "'chain_0_x' has limits -inf and inf"),
    "no frame": (lambda: chain(named("panda"), [DOOR], frame="hand"), RobotError, "no frame 'hand'"),
    "frame taken": (lambda: chain(chain(named("panda"), [DOOR]).robot, [DOOR]), RobotError, "already"),
    "placement": (lambda: Placement((0, 0)), ConfigError, "three finite numbers"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_is_refused(case):
    """Malformed regions and chains are refused with the offending value and the way out."""
    make, kind, message = MALFORMED[case]
    with pytest.raises(kind, match=message):
        make()


@pytest.mark.parametrize(
    "bounds, limits",
    [
        ((0.0, 2 * np.pi), (0.0, 2 * np.pi)),
        ((np.pi, 3 * np.pi), (np.pi, 3 * np.pi)),
        ((0.0, INF), (0.0, 2 * np.pi)),
        ((-INF, 1.0), (1.0 - 2 * np.pi, 1.0)),
        ((-INF, INF), (-np.pi, np.pi)),
    ],
)
def test_free_angles_rest_in_the_middle(bounds, limits):
    """A chain's angle with bounds a turn apart turns without end, and rests in the middle of them."""
    low, high = bounds
    held = chain(named("panda"), [TaskSpaceRegion((0, 0, 0, 0, 0, low), (0, 0, 0, 0, 0, high))])
    assert held.robot.turning[7] and held.robot.rest[7] == pytest.approx(np.mean(limits))
