"""Bodies that no joint moves stand on things, and in nothing: what overlaps them is refused, both named."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Robot, Shape, Validity, attach
from pipeline.robots.bodies import body_of
from tests.robots import meshes
from tests.robots.named import ROBOT_NAMES, named
from tests.robots.test_arms_validity import plain

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FAR = [Obstacle(Shape.SPHERE, (20.0 + i, 0, 0), UPRIGHT, (0.1,) * 3, f"far {i}") for i in range(70)]


def floor(top: float, thick: float = 0.1) -> Obstacle:
    """A floor with its top at a height [m]."""
    return Obstacle(Shape.BOX, (0.0, 0.0, top - thick / 2), UPRIGHT, (3.0, 3.0, thick), "floor")


BASES = {
    "panda": {"panda_link0_0"},
    "olivia": {"base_0"},
    "pholus": set(),
    "ur5": {"base_link_0"},
    "kinova": {"j2s6s200_link_base_0"},
    "sawyer": {"base_0", "controller_box_0", "pedestal_feet_0", "pedestal_0"},
}


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_base_is_what_the_root_link_carries(name):
    """The base are the bodies that no joint of the description moves; what is only fixed here is no part of it."""
    robot = named(name)
    fixed = {body.name for body in robot.geometry.geometryObjects if not body.parentJoint}
    if name in BASES:
        assert robot.base == fixed == BASES[name]
    else:
        assert {"torso_0", "pedestal_0"} <= set(map(body_of, robot.base)) and robot.base < fixed
        assert not any("arm" in body or "gripper" in body or body == "head_0" for body in robot.base)


@pytest.mark.parametrize("crowd", [0, 70])
def test_a_robot_stands_on_its_floor(crowd):
    """A base may stand 2 mm deep in a floor, or a tenth of a thin one; deeper the floor is refused, with how deep."""
    robot, foot = named("sawyer"), -0.913
    for thick, allowed in ((0.1, 0.002), (0.01, 0.001)):
        for depth in (-0.01, 0.0, allowed - 1e-5):
            validity = Validity(robot, [floor(foot + depth, thick), *FAR[:crowd]], 0.005)
            assert validity.free(robot.rest)
            assert validity.clearance(robot.rest) > 0.3
        contact = validity.deepest_contact(robot.rest[None])
        assert (contact.first, contact.second) == ("pedestal_feet_0", "floor")
        assert contact.depth == pytest.approx(depth, abs=1e-9)
        with pytest.raises(
            ProblemError, match=r"'floor' stands 0\.0\d+ m inside body 'pedestal_feet_0' of 'sawyer'.*may"
        ):
            Validity(robot, [*FAR[:crowd], floor(foot + allowed + 1e-5, thick)])


def test_an_arm_that_is_not_planned_for():
    """An obstacle in a fixed arm is refused, however little it is in it; one that it may touch is not."""
    robot = named("baxter_right")
    elbow = robot.pose(robot.rest, "left_upper_elbow").translation

    def ball(out: float) -> Obstacle:
        return Obstacle(Shape.SPHERE, tuple(elbow + np.array([0.0, out, 0.0])), UPRIGHT, (0.04,) * 3, "ball")

    low, high = 0.0, 1.0  # beside the left elbow, at 0.5 mm in whatever is there, or off it
    for _ in range(40):
        middle = (low + high) / 2
        free = plain(robot, [ball(middle)], robot.rest, standing=True)
        low, high = (low, middle) if free else (middle, high)
    assert Validity(robot, [ball(high + 0.0005)]).free(robot.rest)
    with pytest.raises(ProblemError, match=r"'ball' stands .* m inside body 'left_.*it may not touch it") as refused:
        Validity(robot, [ball(high - 0.0005)])
    body = str(refused.value).split("'")[3]
    assert Validity(robot, [ball(high - 0.0005)], touching=[(body, "ball")]).free(robot.rest)
    table = Obstacle(Shape.BOX, tuple(elbow), UPRIGHT, (0.5, 0.5, 0.04), "table")
    with pytest.raises(ProblemError, match=r"'table' stands .*\(and \d+ pairs more\)"):
        Validity(robot, [table])


def standing(shape: Shape, file: str = "", base: bool = True, points=None, size=(1.0, 1.0, 1.0)) -> Robot:
    """A robot of a body that stands at the origin, and a ball that moves 3 m above it."""
    model, geometry = pin.Model(), pin.GeometryModel()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3(np.eye(3), np.array([0, 0, 3.0])), "slide")
    geometry.addGeometryObject(pin.GeometryObject("ball", joint, pin.SE3.Identity(), pin.hppfcl.Sphere(0.1)))
    robot = Robot("column", model, geometry, -np.ones(1), np.ones(1))
    column = Obstacle(shape, (0.0, 0.0, 0.0), UPRIGHT, size, "column", file, points)
    return replace(attach(robot, column, "universe"), base=frozenset(["column"]) if base else frozenset())


def test_meshes_and_leaves_stand_too(tmp_path):
    """A base that is a mesh, convex or not, may stand on a floor and on leaves, and has nothing inside."""
    files = {"box": meshes.box(), "corner": meshes.corner(), "open": (meshes.box()[0], meshes.box()[1][:-1])}
    pea = Obstacle(Shape.SPHERE, (-0.3, -0.3, 0.0), UPRIGHT, (0.1,) * 3, "pea")
    grid = np.stack(np.meshgrid(*[np.arange(-0.15, 0.2, 0.1)] * 2, [-0.55]), axis=-1).reshape(-1, 3)
    for name, mesh in files.items():
        robot = standing(Shape.MESH, meshes.write(tmp_path / f"{name}.obj", mesh))
        free = replace(robot, base=frozenset())
        for depth, refused in ((-0.001, ()), (0.001, (free,)), (0.003, (free, robot))):
            leaves = Obstacle(Shape.OCTREE, (0, 0, depth), UPRIGHT, (0.1,) * 3, "floor", points=grid)
            for ground in (floor(-0.5 + depth), leaves):
                for other in (free, robot):
                    if other in refused:
                        with pytest.raises(ProblemError, match=r"'floor' stands .* inside body 'column'"):
                            Validity(other, [ground])
                    else:
                        assert Validity(other, [ground]).free(np.zeros(1))
        if name == "open":
            assert Validity(robot, [pea]).surfaces == ("column",)
        else:
            with pytest.raises(ProblemError, match=r"'pea' stands .* inside body 'column'"):
                Validity(robot, [pea])
    hollow = replace(pea, position=(0.3, 0.3, 0.0))  # in the notch of the corner
    assert Validity(standing(Shape.MESH, str(tmp_path / "corner.obj")), [hollow]).free(np.zeros(1))
