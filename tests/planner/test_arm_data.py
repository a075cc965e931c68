"""Arms that a cell file completes: what is not published is asked for by name, and taken with its source."""

import json

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.published_arms import pinocchio_arm
from planner.cell import CellSource, cell_of_keys, completed_arm, mended_cell, parse_cell
from planner.dynamics import joint_torques
from planner.errors import CellError
from planner.geometry import arm_capsules
from planner.kinematics import forward
from planner.robots import INCOMPLETE_NAMES, completed, missing_numbers, published_number, robot

LINK = '[link]\nkind = "sim"\n'
NUMBERS = {
    "dh_a_m": robot("ur18").a.tolist(),
    "dh_d_m": robot("ur18").d.tolist(),
    "joint_velocity_deg_s": [150.0] * 6,
    "joint_torque_n_m": [400.0, 400.0, 200.0, 70.0, 70.0, 60.0],
    "link_mass_kg": [link.mass for link in robot("ur18").links],
    "link_com_m": [link.com.tolist() for link in robot("ur18").links],
    "link_inertia_kg_m2": [link.inertia[np.triu_indices(3)].tolist() for link in robot("ur18").links],
}


def file_of(name, **changes):
    numbers = {key: NUMBERS[key] for key in missing_numbers(name)} | {"source": "a letter of the maker"} | changes
    data = "".join(f"{key} = {json.dumps(value)}\n" for key, value in numbers.items() if value is not None)
    return f'robot = "{name}"\n[arm_data]\n{data}{LINK}'


@pytest.mark.parametrize("name", INCOMPLETE_NAMES)
def test_an_arm_that_is_not_all_published_is_refused_by_name(name):
    with pytest.raises(CellError, match=name) as refused:
        parse_cell(f'robot = "{name}"\n{LINK}', "c")
    assert refused.value.field == "robot"
    for word in (*missing_numbers(name), "[arm_data]", "source"):
        assert word in refused.value.reason


@pytest.mark.parametrize("name", INCOMPLETE_NAMES)
def test_a_cell_file_completes_it(name):
    cell = parse_cell(file_of(name), "c")
    arm = cell.robot
    assert arm.name == name
    np.testing.assert_allclose(arm.qd_max, np.radians(150.0))
    np.testing.assert_allclose(cell.limits.tau_max, 0.9 * np.array(NUMBERS["joint_torque_n_m"]))
    np.testing.assert_allclose(np.degrees(arm.q_upper), [360.0, 360.0, 180.0, 360.0, 360.0, 360.0])
    assert arm.published is arm
    assert parse_cell(file_of(name), "other").robot is arm
    assert len(arm_capsules(arm)) == 12
    assert arm.payload_kg is None
    assert arm.shape.is_estimate
    for key in missing_numbers(name):
        without = file_of(name, **{key: None})
        with pytest.raises(CellError, match=key):
            parse_cell(without, "c")


def test_a_completed_arm_moves_and_weighs_as_published():
    arm = completed("ur8long", {key: NUMBERS[key] for key in missing_numbers("ur8long")})
    rng = np.random.default_rng(2)
    q = rng.uniform(-6.0, 6.0, (50, 6))
    qd = rng.normal(size=(50, 6))
    model = pinocchio_arm("ur8long", exact=True).copy()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data = model.createData()
    found = joint_torques(arm, q, qd, qd, model.gravity.linear)
    expected = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qd, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    for i in range(len(q)):
        pin.forwardKinematics(model, data, q[i])
        np.testing.assert_allclose(forward(arm, q)[i], data.oMi[6].homogeneous, rtol=0, atol=1e-9)


def test_a_completed_arm_keeps_its_own_limits_in_code():
    cell = parse_cell(file_of("ur8long"), "c")
    assert cell.with_limits(joint_velocity_rad_s=2.0).robot is cell.robot
    with pytest.raises(CellError, match="beyond the arm's own limit"):
        cell.with_limits(joint_velocity_rad_s=2.7)
    again = cell_of_keys({"name": "c", **cell.document})
    assert again.robot is cell.robot
    assert completed_arm(cell.as_document()) is cell.robot


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"source": None}, "source", "where the numbers are from"),
        ({"source": " "}, "source", "where the numbers are from"),
        ({"source": "x" * 501}, "source", "500 characters"),
        ({"joint_velocity_deg_s": [3.1] * 5}, "joint_velocity_deg_s", "list of 6 numbers"),
        ({"joint_velocity_deg_s": [0.5] * 6}, "joint_velocity_deg_s[0]", "must lie in"),
        ({"joint_position_upper_deg": [360.0, 360.0, 181.0, *[360.0] * 3]}, "joint_position_upper_deg[2]", "beyond"),
        ({"dh_a_m": [0.0, 0.475, -0.3, 0.0, 0.0, 0.0]}, "dh_a_m[1]", "must be below 0"),
        ({"dh_a_m": [0.1, -0.475, -0.3, 0.0, 0.0, 0.0]}, "dh_a_m[0]", "must be 0"),
        ({"dh_d_m": [0.2, 0.0, 0.0, 0.1, 0.0, 0.1]}, "dh_d_m[4]", "must be above 0"),
        ({"link_mass_kg": [1.0, 1.0, 1.0, 1.0, 1.0, 0.0]}, "link_mass_kg[5]", "must lie in"),
        ({"link_com_m": [[0.0, 0.0]] * 6}, "link_com_m[0]", "list of 3 numbers"),
        ({"link_com_m": [0.0] * 6}, "link_com_m[0]", "list of 3 numbers"),
        ({"link_inertia_kg_m2": [[1.0, 0.0, 0.0, 1.0, 0.0, 3.0]] * 6}, "link_inertia_kg_m2[0]", "of no body"),
        ({"link_inertia_kg_m2": [[1.0, 2.0, 0.0, 1.0, 0.0, 1.0]] * 6}, "link_inertia_kg_m2[0]", "of no body"),
        ({"colour": "blue"}, "colour", "unknown key"),
    ],
)
def test_a_wrong_number_is_refused_and_nothing_else(changes, field, words):
    text = file_of("ur17g_1300", **changes)
    faults = mended_cell(CellSource("c", text.encode()))[0]
    assert [fault.field for fault in faults] == [f"arm_data.{field}"]
    assert words in faults[0].reason


def test_what_is_published_can_be_lowered_alone():
    lower = parse_cell(file_of("ur15", joint_velocity_deg_s=[100.0] * 6, joint_torque_n_m=[70.0] * 6), "c").robot
    np.testing.assert_allclose(lower.qd_max, np.radians(100.0))
    np.testing.assert_array_equal(lower.tau_max, 70.0)
    assert lower.published is lower
    assert parse_cell(file_of("ur5e", payload_kg=4.0), "c").robot.payload_kg == 4.0
    for key, value, field in (
        ("joint_velocity_deg_s", [180.0] * 5 + [181.0], "joint_velocity_deg_s[5]"),
        ("joint_position_lower_deg", [-361.0, *[-360.0] * 5], "joint_position_lower_deg[0]"),
        ("payload_kg", 5.1, "payload_kg"),
    ):
        with pytest.raises(CellError, match="beyond the published") as refused:
            parse_cell(file_of("ur5e", **{key: value}), "c")
        assert refused.value.field == f"arm_data.{field}"
    with pytest.raises(CellError, match=r"is published for a ur5e; .* measured chain"):
        parse_cell(file_of("ur5e", dh_a_m=NUMBERS["dh_a_m"]), "c")


def test_masses_can_be_others_than_the_published():
    assert published_number("ur15", "payload_kg") is None
    assert published_number("ur5e", "link_mass_kg")[1] == robot("ur5e").links[1].mass
    heavier = parse_cell(file_of("ur5e", link_mass_kg=[4.0, 9.0, 3.0, 1.4, 1.4, 0.4]), "c")
    assert heavier.robot.links[1].mass == 9.0
    np.testing.assert_array_equal(heavier.robot.links[1].com, robot("ur5e").links[1].com)


def test_a_payload_that_is_given_is_kept():
    text = file_of("ur15", payload_kg=15.0) + "[tool]\nmass_kg = 15.1\n"
    with pytest.raises(CellError, match="a ur15 is rated for 15 kg"):
        parse_cell(text, "c")
    parse_cell(f'robot = "ur15"\n{LINK}[tool]\nmass_kg = 15.1\n', "c")


def test_every_fault_is_named_where_the_arm_is_incomplete():
    text = f'robot = "ur8long"\n{LINK}[object]\nmass_kg = -1.0\n'
    assert [fault.field for fault in mended_cell(CellSource("c", text.encode()))[0]] == ["robot", "object.mass_kg"]
