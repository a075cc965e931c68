"""The arms as data, against the published files."""

from pathlib import Path

import numpy as np
import pytest

from audit.judge.published_arms import COMPLETE, JOINTS, LINKS, SAME, published
from planner.errors import IncompleteRobot, UnknownRobot
from planner.robots import ARM_NUMBERS, INCOMPLETE_NAMES, ROBOT_NAMES, completed, missing_numbers, robot

DATA = Path(__file__).parents[2] / "planner" / "robot_data"


def test_every_published_arm_is_there():
    assert sorted(ROBOT_NAMES) == sorted(COMPLETE)
    files = {path.stem for path in DATA.glob("*.toml")} - {"capsules"}
    assert sorted((*ROBOT_NAMES, *INCOMPLETE_NAMES)) == sorted(files)
    assert len(files) == 17


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
    assert caught.value.known == (*ROBOT_NAMES, *INCOMPLETE_NAMES)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_a_published_arm_lacks_nothing(name):
    assert missing_numbers(name) == ()
    assert completed(name, {}) is robot(name)


LIMITS = ("joint_velocity_deg_s", "joint_torque_n_m")
CHAIN = ("dh_a_m", "dh_d_m")
MASSES = ("link_mass_kg", "link_com_m", "link_inertia_kg_m2")


@pytest.mark.parametrize(
    ("name", "missing"),
    [
        ("ur8long", LIMITS),
        ("ur10g_1750", CHAIN + LIMITS),
        ("ur18g_950", CHAIN + LIMITS),
        ("ur17g_1300", CHAIN + LIMITS + MASSES),
    ],
)
def test_an_arm_that_is_not_all_published_is_refused_by_name_with_what_is_missing(name, missing):
    assert name in INCOMPLETE_NAMES
    with pytest.raises(IncompleteRobot, match=name) as refused:
        robot(name)
    assert refused.value.missing == missing
    for key in missing:
        assert key in ARM_NUMBERS
        assert key in str(refused.value)


@pytest.mark.parametrize(("name", "other"), SAME.items())
def test_a_renamed_arm_is_the_other_one_but_for_its_payload(name, other):
    arm = robot(name)
    assert arm.name == name
    assert arm.payload_kg == {"ur7e": 7.5, "ur12e": 12.5}[name]
    for key in ("a", "d", "q_lower", "q_upper", "qd_max", "tau_max"):
        np.testing.assert_array_equal(getattr(arm, key), getattr(robot(other), key))
    assert arm.shape.of == other
    assert not arm.shape.is_estimate


def test_controllers_tell_different_models_apart_by_their_type():
    types = {name: robot(name).type_code for name in ROBOT_NAMES}
    assert (types["ur15"], types["ur18"], types["ur20"]) == (9, 5, 7)
    assert types["ur7e"] == types["ur5e"] == types["ur5"] == 1
