"""A robot stands on its floor to a depth, and in nothing else."""

import pytest
from arms import PANDA, known

from pipeline.robots import Obstacle, Shape
from pipeline.verification.pairs import items_of_obstacles
from pipeline.verification.standing import standing_contact

FLAT = (0.0, 0.0, 0.0, 1.0)


def said(*obstacles: Obstacle, touching=None) -> str | None:
    return standing_contact([*known(PANDA)[1], *items_of_obstacles(obstacles)], touching or {})


@pytest.mark.parametrize(("top", "free"), [(-0.001, True), (0.0, True), (0.0015, True), (0.0025, False), (0.05, False)])
def test_a_floor_may_be_touched(top, free):
    """The panda's base may be 2 mm in a floor, and no deeper; the message names both."""
    base = min(0.0, *(float(i.form.middle[2] - i.form.half[2]) for i in known(PANDA)[1] if i.joint == -1))
    floor = Obstacle(Shape.BOX, (0.0, 0.0, base + top - 0.05), FLAT, (2.0, 2.0, 0.1), name="floor")
    found = said(floor)
    assert (found is None) == free, found
    assert free or ("'floor'" in str(found) and "panda_link0" in str(found))


def test_a_box_around_the_base_is_refused():
    """An obstacle that the base stands in is refused wherever it is among the obstacles."""
    far = Obstacle(Shape.SPHERE, (3.0, 0.0, 0.0), FLAT, (0.1,) * 3, name="far")
    inside = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.05), FLAT, (0.01,) * 3, name="inside")
    assert said(far) is None
    assert "'inside'" in str(said(far, inside)) and "'inside'" in str(said(inside, far))


def test_what_is_said_to_touch_may_touch_as_deep_as_said():
    """A depth that is said counts in place of the usual one."""
    body = next(i.name for i in known(PANDA)[1] if i.joint == -1)
    floor = Obstacle(Shape.BOX, (0.0, 0.0, 0.004 - 0.05), FLAT, (2.0, 2.0, 0.1), name="floor")
    assert said(floor) is not None
    assert said(floor, touching={(body, "floor"): 0.03}) is None
