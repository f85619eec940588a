"""Bounds on the motion of bodies hold at every point of a chord, and are not much larger than they must be."""

import numpy as np
import pinocchio as pin
import pytest
from arms import BAXTER, PANDA, known

from pipeline.verification.kinematics import WORLD
from pipeline.verification.motion import Motion

_SHARES = np.linspace(0, 1, 201)


@pytest.mark.parametrize("robot", [PANDA, BAXTER], ids=lambda robot: robot.name)
@pytest.mark.parametrize("step", [0.02, 0.3, 2.0])
def test_speed_is_within_its_bound(robot, step):
    """Corners of bodies, seen from the world and from other joints, move no faster than stated, by differences.

    The joints' frames are pinocchio's.
    """
    kinematics, items, _ = known(robot)
    rng = np.random.default_rng(0)
    model = robot.robot().model
    moving = [i for i, item in enumerate(items) if item.joint != WORLD]
    views = [(i, WORLD) for i in moving[::3]]
    for i, j in rng.choice(moving, (20, 2)):
        if items[i].joint != items[j].joint:
            views.append((int(i), items[j].joint))
    motion = Motion(kinematics, items, views)
    numbers = [model.getJointId(joint.name) for joint in kinematics.joints]
    excess: list[float] = []
    for _ in range(10):
        Q = rng.uniform(kinematics.lower, kinematics.upper, (2, len(kinematics.names)))
        Q[1] = Q[0] + step * (Q[1] - Q[0]) / np.linalg.norm(Q[1] - Q[0])
        Q = np.clip(Q, kinematics.lower, kinematics.upper)
        rates = motion.rates(Q, kinematics.joint_poses(Q), np.arange(motion.count))[:, 0]
        data, poses = model.createData(), []
        for share in _SHARES:
            q = np.empty(model.nq)
            for number, joint in zip(numbers, kinematics.joints, strict=True):
                q[model.idx_qs[number]] = (Q[0] + share * (Q[1] - Q[0]))[joint.variable]
            pin.forwardKinematics(model, data, q)
            poses.append([pin.SE3(data.oMi[number]) for number in numbers])
        for (item, seen), rate in zip(views, rates, strict=True):
            points = items[item].form.moving @ items[item].place.R.T + items[item].place.p
            x = []
            for pose in poses:
                M = pose[items[item].joint]
                if seen != WORLD:
                    M = pose[seen].inverse() * M
                x.append(points @ M.rotation.T + M.translation)
            speed = np.linalg.norm(np.diff(x, axis=0), axis=2).max() / (_SHARES[1] - _SHARES[0])
            assert speed <= rate * (1 + 1e-9)
            excess.append(rate / (speed + 1e-3))
    assert step > 0.1 or np.median(excess) < 1.2
