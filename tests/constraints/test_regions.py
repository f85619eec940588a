"""Task space regions and their chains: distances by hand, poses by pinocchio, doors by geometry."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

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


@pytest.mark.parametrize("name", ["panda", "baxter_right"])
def test_fixed_dimensions_are_rows(name):
    """The rows are the region's displacement by pinocchio, and their Jacobian that of finite differences."""
    robot = named(name)
    r = region(z=(0.2, 0.2), roll=(0.3, 0.3), pitch=(-0.2, -0.2))
    constraint = r.constraint(robot)
    assert constraint.k == 3
    for q in configurations(robot, np.random.default_rng(2), 10):
        d = r.displacement(robot.pose(q, robot.tool))
        np.testing.assert_allclose(np.abs(constraint.value(q)), np.abs(d[[2, 3, 4]]), atol=1e-9)
        np.testing.assert_allclose(constraint.jacobian(q), differences(constraint.value, q), atol=1e-4, rtol=1e-3)
    Q, converged = constraint.project_batch(configurations(robot, np.random.default_rng(3), 60))
    assert converged.sum() > 10
    for q in Q[converged]:
        assert r.distance(robot.pose(q, robot.tool)) < 1e-3


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
    "quarter turn": (
        lambda: region(pitch=(np.pi / 2,) * 2).constraint(named("panda")),
        ConstraintError,
        "turn the region's frame",
    ),
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
def test_free_angles_keep_their_range(bounds, limits):
    """A chain's angle with bounds a turn apart keeps them as joint limits; missing ones make it a whole turn."""
    low, high = bounds
    held = chain(named("panda"), [TaskSpaceRegion((0, 0, 0, 0, 0, low), (0, 0, 0, 0, 0, high))])
    assert (held.robot.lower[7], held.robot.upper[7]) == pytest.approx(limits)
