"""The arms as data, against the published files."""

import numpy as np
import pytest

from planner.errors import UnknownRobot
from planner.robots import ROBOT_NAMES, robot
from tests.planner.published_arms import JOINTS, LINKS, ROBOTS, published


def test_every_published_arm_is_there():
    assert sorted(ROBOT_NAMES) == sorted(ROBOTS)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_limits_are_the_published_ones(name):
    arm = robot(name)
    limits = [published(name, "joint_limits")["joint_limits"][f"{joint}_joint"] for joint in JOINTS]
    assert arm.joint_names == tuple(f"{joint}_joint" for joint in JOINTS)
    np.testing.assert_allclose(arm.qd_max, [limit["max_velocity"] for limit in limits], rtol=1e-15)
    np.testing.assert_allclose(arm.tau_max, [limit["max_effort"] for limit in limits], rtol=1e-15)
    bounded = [i for i, limit in enumerate(limits) if limit["has_position_limits"]]
    np.testing.assert_allclose(arm.q_upper[bounded], [limits[i]["max_position"] for i in bounded], rtol=1e-15)
    np.testing.assert_allclose(arm.q_lower[bounded], [limits[i]["min_position"] for i in bounded], rtol=1e-15)


@pytest.mark.parametrize("name", ["ur3", "ur3e"])
def test_a_joint_without_end_is_bounded_at_one_turn(name):
    assert robot(name).q_upper[5] == -robot(name).q_lower[5] == 2 * np.pi


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_masses_and_rates(name):
    arm = robot(name)
    mass = published(name, "physical_parameters")["inertia_parameters"]
    assert [link.mass for link in arm.links] == [mass[f"{link}_mass"] for link in LINKS]
    assert [link.name for link in arm.links] == list(LINKS)
    assert arm.sample_rate_hz == {"CB3": 125, "e-Series": 500}[arm.generation]
    assert (arm.generation == "CB3") == (name in ("ur3", "ur5", "ur10"))


def test_an_arm_is_one_object_that_cannot_be_changed():
    arm = robot("ur5e")
    assert robot("ur5e") is arm
    assert {arm: 1}[robot("ur5e")] == 1
    with pytest.raises(ValueError, match="read-only"):
        arm.a[1] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        arm.links[0].inertia[0, 0] = 0.0


def test_an_unknown_arm_names_the_known():
    with pytest.raises(UnknownRobot, match="ur5e") as caught:
        robot("kr16")
    assert caught.value.known == ROBOT_NAMES
