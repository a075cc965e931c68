"""The simulator's joint torques on plain floats are the planner's."""

import numpy as np
import pytest

from planner.dynamics import Payload, joint_torques
from planner.robots import ROBOT_NAMES, robot
from simulator.physics.dynamics import JointTorques

EXACT = 1e-11  # [N m] two orders of the same sums of products differ by rounding alone


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_torques_are_the_planners(name):
    arm = robot(name)
    torques = JointTorques(robot(name))
    draw = np.random.default_rng(0)
    for _ in range(20):
        q, qd, qdd = draw.normal(size=(3, 6)) * [[2.0], [2.0], [10.0]]
        up = draw.normal(size=3) * 5.0
        com = draw.normal(size=3) * 0.1
        expected = joint_torques(arm, q, qd, qdd, -up, Payload(1.7, com, np.zeros((3, 3))))
        found = torques.of(q.tolist(), qd.tolist(), qdd.tolist(), tuple(up.tolist()), 1.7, tuple(com.tolist()))
        np.testing.assert_allclose(found, expected, atol=EXACT)
