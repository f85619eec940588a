"""Joints of a planning group that follow others of it: an equation each."""

from typing import Any

import casadi as ca

from pipeline.constraints.base import Constraint
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot


def following(robot: Robot, **settings: Any) -> Constraint:
    """Keep every follower at its multiplier times its leader's value plus its offset (1 row each, [rad or m]).

    Raises:
        ConstraintError: no joint of the robot follows another.
    """
    if not robot.followers:
        raise ConstraintError(f"no joint of robot {robot.name!r} follows another")
    q, p, at = ca.SX.sym("q", robot.dimension), Numbers(), robot.joint_names.index
    rows = [q[at(name)] - (p(f.multiplier) * q[at(f.leader)] + p(f.offset)) for name, f in robot.followers.items()]
    labels = [f"{name} beside where {f.leader} puts it [rad or m]" for name, f in robot.followers.items()]
    return Constraint("following joints", q, ca.vertcat(*rows), labels=labels, numbers=p, **settings)
