"""The symbolic kinematics say what pinocchio says, and refuse what they cannot say."""

import sysconfig
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import RobotError
from pipeline.robots import Robot, point_robot
from tests.robots.worlds import JOINTS, chain, placement

MODELS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"


def from_urdf(path: str) -> Robot:
    model = pin.buildModelFromUrdf(str(MODELS / path))
    return Robot(Path(path).stem, model, pin.GeometryModel(), model.lowerPositionLimit, model.upperPositionLimit)


def assert_agrees(robot: Robot, frames: list[str], rng: np.random.Generator, count: int = 5) -> None:
    q = ca.SX.sym("q", robot.dimension)
    poses = ca.Function("poses", [q], [part for frame in frames for part in robot.symbolic_pose(q, frame)])
    data = robot.model.createData()
    for configuration in rng.uniform(-3, 3, (count, robot.dimension)):
        found = [np.asarray(part) for part in poses(configuration)]
        pin.framesForwardKinematics(robot.model, data, configuration)
        for frame, R, p in zip(frames, found[::2], found[1::2], strict=True):
            expected = data.oMf[robot.model.getFrameId(frame)]
            np.testing.assert_allclose(R, expected.rotation, atol=1e-12, err_msg=frame)
            np.testing.assert_allclose(p[:, 0], expected.translation, atol=1e-12, err_msg=frame)


@pytest.mark.parametrize("kind", JOINTS)
def test_one_joint(kind):
    """The pose behind a single joint of every kind is pinocchio's, whichever way the joint is mounted."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        assert_agrees(chain(rng, [kind]), ["tool"], rng)


@pytest.mark.parametrize("seed", range(6))
def test_random_chain(seed):
    """The pose at the end of nine joints of mixed kinds is pinocchio's."""
    rng = np.random.default_rng(seed)
    robot = chain(rng, [*rng.choice(list(JOINTS), 7).tolist(), "revolute unaligned", "prismatic unaligned"])
    assert_agrees(robot, ["tool", "universe"], rng)


def test_only_the_joints_below_a_frame_move_it():
    """In a robot with two arms the pose of one hand depends on the joints of its own arm, in the model's order."""
    rng, model = np.random.default_rng(1), pin.Model()
    trunk = model.addJoint(0, pin.JointModelRZ(), placement(rng), "trunk")
    ends = {}
    for arm in ("left", "right"):
        joint = trunk
        for i in range(3):
            joint = model.addJoint(joint, pin.JointModelRX(), placement(rng), f"{arm}{i}")
        ends[arm] = joint
    for arm, joint in ends.items():
        model.addFrame(pin.Frame(f"{arm} hand", joint, 0, placement(rng), pin.FrameType.OP_FRAME))
    robot = Robot("two arms", model, pin.GeometryModel(), -np.ones(7), np.ones(7))
    q = ca.SX.sym("q", 7)
    for arm in ends:
        moved = [
            robot.joint_names[i] for i in range(7) if ca.depends_on(robot.symbolic_pose(q, f"{arm} hand")[1], q[i])
        ]
        assert moved == ["trunk", f"{arm}0", f"{arm}1", f"{arm}2"]
    assert_agrees(robot, ["left hand", "right hand"], rng)


@pytest.mark.parametrize(
    "urdf, joints", [("panda_description/urdf/panda.urdf", 9), ("baxter_description/urdf/baxter.urdf", 19)]
)
def test_known_robots(urdf, joints):
    """The last frame of every joint of Panda and Baxter, fingers included, is where pinocchio has it."""
    robot = from_urdf(urdf)
    assert robot.dimension == joints
    last = {frame.parentJoint: frame.name for frame in robot.model.frames}
    assert len(last) == joints + 1
    assert_agrees(robot, list(last.values()), np.random.default_rng(0), count=3)


def test_unknown_frame_names_those_there_are():
    """A frame that does not exist is refused with its name, the robot's name and the frames it has."""
    robot = chain(np.random.default_rng(0), ["RX", "PZ"])
    with pytest.raises(RobotError, match=r"'chain' has no frame 'gripper'.*universe, tool"):
        robot.symbolic_pose(ca.SX.sym("q", 2), "gripper")


@pytest.mark.parametrize("joint", [pin.JointModelRUBZ(), pin.JointModelSpherical(), pin.JointModelFreeFlyer()])
def test_unplannable_joint_is_named(joint):
    """A continuous, spherical or free joint below the frame is refused with its name and the kinds there are."""
    model = pin.Model()
    last = model.addJoint(
        model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "good"), joint, pin.SE3.Identity(), "bad"
    )
    model.addFrame(pin.Frame("tool", last, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    robot = Robot("odd", model, pin.GeometryModel(), -np.ones(model.nq), np.ones(model.nq))
    with pytest.raises(RobotError, match=r"'bad' of 'odd' is a \w+; only revolute and prismatic joints"):
        robot.symbolic_pose(ca.SX.sym("q", model.nq), "tool")


def test_point_robot_stands_where_its_coordinates_say():
    """The point's position is q itself, it does not turn, and its names and limits are x, y, z and those given."""
    robot = point_robot(0.01, [-1, -2, -3], [1, 2, 3])
    q = ca.SX.sym("q", 3)
    R, p = ca.Function("pose", [q], list(robot.symbolic_pose(q, "point")))([0.3, -0.4, 0.5])
    np.testing.assert_array_equal(np.asarray(p)[:, 0], [0.3, -0.4, 0.5])
    np.testing.assert_array_equal(np.asarray(R), np.eye(3))
    assert robot.joint_names == ("x", "y", "z") and robot.dimension == 3
    np.testing.assert_array_equal([robot.lower, robot.upper], [[-1, -2, -3], [1, 2, 3]])


@pytest.mark.parametrize("radius", [0.0, -0.1, float("nan")])
def test_point_robot_needs_a_radius(radius):
    """A point robot without a positive radius is refused with the value."""
    with pytest.raises(RobotError, match=rf"radius is {radius} m"):
        point_robot(radius, [-1] * 3, [1] * 3)


@pytest.mark.parametrize("upper", [[1, -1, 1], [1, 1, -2], [1, 1, float("nan")]])
def test_point_robot_needs_room(upper):
    """Limits of a point robot that leave no room, or are no numbers, are refused with their values."""
    with pytest.raises(RobotError, match=r"limits are \[-1, -1, -1\] to \[1, "):
        point_robot(0.1, [-1] * 3, upper)
