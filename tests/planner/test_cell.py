"""Cell files: what is read, what is filled in, and every kind of refusal."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from planner.cell import CellSource, Safety, cell_faults, load_cell, parse_cell, read_source
from planner.errors import CellError

CELLS = Path(__file__).parents[2] / "cells"
SHIPPED = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim", "sdu-table", "example-real")
LEAST = 'robot = "ur5e"\n[link]\nkind = "sim"\n'


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_cells_are_read(name):
    cell = load_cell(CELLS / f"{name}.toml")
    assert cell.name == name
    assert cell.sha256 == hashlib.sha256((CELLS / f"{name}.toml").read_bytes()).hexdigest()
    document = json.loads(json.dumps(cell.as_document()))
    assert document["robot"] == cell.robot.name
    assert document["sha256"] == cell.sha256


def test_only_the_example_drives_a_real_arm():
    kinds = {name: load_cell(CELLS / f"{name}.toml").link.kind for name in SHIPPED}
    assert [name for name, kind in kinds.items() if kind == "ur"] == ["example-real"]


def test_defaults_are_filled_in_and_numbers_kept_as_written():
    cell = parse_cell(LEAST + "[limits]\njoint_velocity_rad_s = 2.5\n", "c")
    document = cell.as_document()
    assert document["limits"]["joint_velocity_rad_s"] == 2.5
    assert document["limits"]["joint_jerk_rad_s3"] == 500.0
    assert document["surroundings"]["gravity_m_s2"] == 9.81
    assert document["sim"]["polyscope"] == "5.11.1"
    np.testing.assert_array_equal(cell.limits.qd_max, np.full(6, 2.5))
    np.testing.assert_allclose(cell.limits.tau_max, 0.9 * cell.robot.tau_max)


def test_the_table_of_the_project_is_its_published_frame():
    """The report's transform takes a world point into the base frame; ours is its inverse, made orthonormal."""
    published = np.array(
        [
            [-0.384, -0.9233, 0.0005, 0.7021],
            [0.9233, -0.384, 0.0018, -0.7111],
            [-0.0015, 0.0012, 1.0, -0.0334],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    X_WB = load_cell(CELLS / "sdu-table.toml").X_WB
    np.testing.assert_allclose(np.linalg.inv(X_WB), published, atol=1e-4)


DEEP = 5000
NO_CELLS = {
    "nested lists": b"home_rad = " + b"[" * DEEP + b"]" * DEEP,
    "nested tables": b"[" + b"a." * DEEP + b"a]\n",
    "a long key": b"a" + b".a" * 100_000 + b" = 1",
    "many digits": b"home_rad = " + b"1" * 6000,
    "hexadecimal digits": b"home_rad = 0x" + b"f" * 6000,
    "bytes": bytes(range(256)),
    "too much": b"# comment\n" * 60_000,
}


@pytest.mark.parametrize("text", NO_CELLS.values(), ids=NO_CELLS)
def test_a_file_that_is_no_cell_is_refused_in_a_sentence(tmp_path, text):
    file = tmp_path / "cell.toml"
    file.write_bytes(text)
    for read in (load_cell, lambda path: cell_faults(read_source(path)) and load_cell(path)):
        with pytest.raises(CellError) as refusal:
            read(file)
        assert len(str(refusal.value)) < 500


NO_CALIBRATIONS = {
    "a date that is none": "kinematics: {hash: 2001-99-99}",
    "many digits": f"kinematics: {{hash: {'1' * 6000}}}",
    "many digits in place of a number": "kinematics:\n"
    + "".join(
        f"  {link}: {{x: {'1' * 6000}, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}}\n"
        for link in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    ),
    "nested lists": "kinematics: " + "[" * DEEP + "]" * DEEP,
    "nested mappings": "\n".join(" " * n + "a:" for n in range(120)),
    "a list within itself": "kinematics: &a [*a]",
    "lists of lists of lists": "a0: &a0 [1]\n"
    + "\n".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30))
    + "\nkinematics: *a29",
    "a tag": "kinematics: !!python/object/apply:os.system [ls]",
    "too much": "kinematics: {}\n" + "# comment\n" * 60_000,
    "no text": "\0",
}


@pytest.mark.parametrize("text", NO_CALIBRATIONS.values(), ids=NO_CALIBRATIONS)
def test_a_file_that_is_no_calibration_is_refused_in_a_sentence(tmp_path, text):
    (tmp_path / "arm.yaml").write_text(text)
    file = tmp_path / "cell.toml"
    file.write_text(LEAST + '[kinematics]\ncalibration = "arm.yaml"\n')
    with pytest.raises(CellError) as refusal:
        load_cell(file)
    assert len(str(refusal.value)) < 600
    assert "arm.yaml" in str(refusal.value)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["pipe", "folder"])
def test_what_is_no_file_is_not_waited_for(tmp_path, make):
    make(tmp_path / "cell.toml")
    with pytest.raises(CellError, match="not a file"):
        load_cell(tmp_path / "cell.toml")
    make(tmp_path / "arm.yaml")
    file = tmp_path / "other.toml"
    file.write_text(LEAST + '[kinematics]\ncalibration = "arm.yaml"\n')
    with pytest.raises(CellError, match=r"arm.yaml.*not a file"):
        load_cell(file)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('robot = "ur5e"\n', "link.kind"),
        ('robot = "kr16"\n[link]\nkind = "sim"\n', "robot"),
        ("speed = 3\n" + LEAST, "speed"),
        (LEAST + "[limits]\nvelocity = 3.0\n", "limits.velocity"),
        (LEAST + "[limits]\njoint_velocity_rad_s = nan\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_velocity_rad_s = inf\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_velocity_rad_s = 1" + 400 * "0" + "\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_velocity_rad_s = 4.0\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_velocity_rad_s = [1, 1, 1]\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_velocity_rad_s = true\n", "limits.joint_velocity_rad_s"),
        (LEAST + "[limits]\njoint_acceleration_rad_s2 = 41.0\n", "limits.joint_acceleration_rad_s2"),
        (LEAST + "[limits]\njoint_torque_fraction = 1.1\n", "limits.joint_torque_fraction"),
        (LEAST + "[surroundings]\ngravity_m_s2 = 0.0\n", "surroundings.gravity_m_s2"),
        (LEAST + "[limits]\njoint_position_upper_rad = [7, 1, 1, 1, 1, 1]\n", "limits.joint_position_upper_rad"),
        (
            LEAST + "[limits]\njoint_position_lower_rad = [1, 1, 1, 1, 1, 1]\n"
            "joint_position_upper_rad = [1, 2, 2, 2, 2, 2]\n",
            "limits.joint_position_lower_rad",
        ),
        (LEAST.replace("[link]", "home_rad = [0, 0, 3.5, 0, 0, 0]\n[link]"), "home_rad"),
        (LEAST + '[gripper]\noutput = "pneumatic"\n', "gripper.output"),
        (LEAST + "[gripper]\nindex = 2\n", "gripper.index"),
        (LEAST + "[gripper]\nopening_direction = [0.0, 0.0, 0.0]\n", "gripper.opening_direction"),
        (LEAST + "[gripper]\nopening_cone_rad = 4.0\n", "gripper.opening_cone_rad"),
        (LEAST + "[gripper]\nhold_acceleration_m_s2 = [40.0, 40.0]\n", "gripper.hold_acceleration_m_s2"),
        (LEAST + "[gripper]\nhold_acceleration_m_s2 = 0.0\n", "gripper.hold_acceleration_m_s2"),
        (LEAST + "[safety]\npower_w = -1.0\n", "safety.power_w"),
        (LEAST + "[safety]\nspeed = 1.0\n", "safety.speed"),
        (LEAST + '[sim]\npolyscope = "3.15"\n', "sim.polyscope"),
        (LEAST + "[surroundings]\nkeep_out = [{ lower_m = [0, 0, 0], upper_m = [1, 1, 0] }]\n", "keep_out"),
        (LEAST + "[base_in_world]\nrotation_vector_rad = [0, 0, 90]\n", "base_in_world.rotation_vector_rad"),
        (LEAST + "[surroundings]\nkeep_out = [{ lower_m = [0, 0, 0] }]\n", "keep_out[0].upper_m"),
        (LEAST + "[tool]\ncapsules = [{ from_m = [0, 0], to_m = [0, 0, 1], radius_m = 0.1 }]\n", "capsules"),
        ("robot = \n", "file"),
    ],
)
def test_refusals_name_the_field(text, field):
    with pytest.raises(CellError) as refusal:
        parse_cell(text, "c")
    assert field in refusal.value.field


def test_a_misspelt_key_of_a_box_is_named_before_what_it_leaves_missing():
    with pytest.raises(CellError) as refusal:
        parse_cell(LEAST + "[surroundings]\nkeep_out = [{ lower = [0, 0, 0], upper_m = [1, 1, 1] }]\n", "c")
    assert refusal.value.field == "surroundings.keep_out[0].lower"


def test_grip_and_safety_are_read():
    here = parse_cell(
        LEAST
        + "[gripper]\nopening_direction = [0, 0, 2]\nopening_cone_rad = 1.2\nhold_acceleration_m_s2 = [40, 30, 20]\n"
        "[safety]\ntool_speed_m_s = 1.5\n",
        "c",
    )
    np.testing.assert_array_equal(here.gripper.opening_direction, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(here.gripper.hold_acceleration_m_s2, [40.0, 30.0, 20.0])
    assert (here.gripper.opening_cone_rad, here.safety.tool_speed_m_s, here.safety.power_w) == (1.2, 1.5, None)
    least = parse_cell(LEAST, "c")
    assert least.gripper.hold_acceleration_m_s2 is None
    assert least.safety == Safety()


def test_a_missing_file_and_a_bad_name_are_refused():
    with pytest.raises(CellError):
        load_cell(CELLS / "nowhere.toml")
    with pytest.raises(CellError, match="letters"):
        parse_cell(LEAST, "../etc")


def test_a_calibration_is_part_of_the_cell(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(LEAST + '[kinematics]\ncalibration = "arm.yaml"\n')
    with pytest.raises(CellError, match=r"kinematics\.calibration = 'arm\.yaml': cannot be read"):
        load_cell(path)
    published = (Path(__file__).parent / "published" / "ur5e" / "default_kinematics.yaml").read_text()
    (tmp_path / "arm.yaml").write_text(published)
    cell = load_cell(path)
    assert (cell.calibration.name, cell.calibration.hash) == ("arm.yaml", "calib_12788084448423163542")
    assert cell.robot.fixed is not None
    assert cell.as_document()["kinematics"] == {"calibration": "arm.yaml"}
    (tmp_path / "arm.yaml").write_text(published.replace("z: 0.1625", "z: 0.1627"))
    again = load_cell(path)
    assert again.sha256 != cell.sha256
    assert again.robot.d[0] == pytest.approx(0.1627)
    assert parse_cell(LEAST, "lab").sha256 == hashlib.sha256(LEAST.encode()).hexdigest()


@pytest.mark.parametrize("name", ['"../arm.yaml"', '"/etc/passwd"', '""', "3", '".hidden"'])
def test_a_calibration_is_a_file_beside_the_cell(name):
    with pytest.raises(CellError, match=r"kinematics\.calibration"):
        parse_cell(f"{LEAST}[kinematics]\ncalibration = {name}\n", "c")


MANY_FAULTS = """
robot = "ur5e"
surprise = 1
home_rad = [0.0, 99.0, 0.0, 0.0, 0.0, 0.0]
[tool]
mass_kg = -1.0
capsules = [{from_m = [0, 0, 0], to_m = [0, 0], radius_m = 0.05, colour = "red"}, {from_m = [0, 0, 0]}]
[limits]
joint_velocity_rad_s = [1, 1, 99, 1, 1, 1]
tcp_speed_m_s = nan
[surroundings]
keep_out = [{lower_m = [0, 0, 1], upper_m = [1, 1, 0]}]
[gripper]
output = "mouth"
[link]
kind = "wish"
"""


def test_every_fault_of_a_file_is_named_at_once():
    faults = {fault.field: fault.reason for fault in cell_faults(CellSource("c", MANY_FAULTS.encode()))}
    assert set(faults) == {
        "surprise", "home_rad[1]", "tool.mass_kg", "tool.capsules[0].to_m", "tool.capsules[0].colour",
        "tool.capsules[1].to_m", "tool.capsules[1].radius_m", "limits.joint_velocity_rad_s[2]", "limits.tcp_speed_m_s",
        "surroundings.keep_out[0].lower_m", "gripper.output", "link.kind",
    }  # fmt: skip
    assert "beyond the arm's own limit" in faults["limits.joint_velocity_rad_s[2]"]


def test_reading_the_file_stops_at_the_first_of_them():
    with pytest.raises(CellError) as first:
        parse_cell(MANY_FAULTS, "c")
    assert str(first.value) == str(cell_faults(CellSource("c", MANY_FAULTS.encode()))[0])


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        (LEAST, []),
        ("robot =", ["file"]),
        ("", ["robot", "link.kind"]),
        (
            'robot = "ur99"\n[link]\nkind = "sim"\n[limits]\njoint_velocity_rad_s = 3.2\ntcp_speed_m_s = -1\n',
            ["robot", "limits.tcp_speed_m_s"],
        ),
        (LEAST.replace("[link]", "timing = 3\n[link]"), ["timing"]),
        (
            LEAST + '[kinematics]\ncalibration = "missing.yaml"\n[timing]\nlag_s = 9\n',
            ["kinematics.calibration", "timing.lag_s"],
        ),
    ],
)
def test_faults_of_one_kind(text, fields):
    assert [fault.field for fault in cell_faults(CellSource("c", text.encode()))] == fields


def test_a_wrong_name_does_not_hide_what_else_is_wrong():
    faults = cell_faults(CellSource("a b", (LEAST + "[timing]\nlag_s = 9\n").encode()))
    assert [fault.field for fault in faults] == ["name", "timing.lag_s"]
