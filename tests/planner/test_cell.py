"""Cell files: what is read, what is filled in, and every kind of refusal."""

import hashlib
import json
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.cell import CellSource, Safety, cell_of_keys, load_cell, mended_cell, parse_cell, read_source, source
from planner.errors import CellError
from planner.rotations import pose

CELLS = Path(__file__).parents[2] / "cells"
SHIPPED = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim", "ur15-sim", "sdu-table", "example-real")
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


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("", 0.02),
        ("clearance_m = 0.03", 0.03),
        ("clearance_m = 0.03\nflight_clearance_m = 0.005", 0.005),
        ("clearance_m = 0.0", 0.001),
    ],
)
def test_the_object_in_flight_keeps_the_cells_clearance_or_one_of_its_own(keys, expected):
    cell = parse_cell(f"{LEAST}[surroundings]\n{keys}\n", "c")
    assert cell.surroundings.flight_clearance_m == expected
    assert cell.as_document()["surroundings"]["flight_clearance_m"] == expected
    assert parse_cell(LEAST, "c").surroundings.flight_clearance_m == 0.02


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
    for read in (load_cell, lambda path: mended_cell(read_source(path))[0] and load_cell(path)):
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
        (LEAST + "serial = 20245500815\n", "link.serial"),
        (LEAST + 'serial = ""\n', "link.serial"),
        (LEAST + 'serial = "2024 5500815"\n', "link.serial"),
        ("robot = \n", "file"),
        (LEAST + "[surroundings]\nflight_clearance_m = 0.0\n", "surroundings.flight_clearance_m"),
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


def test_a_serial_number_is_read_and_may_be_absent():
    assert parse_cell(LEAST + 'serial = "20245500815"\n', "c").link.serial == "20245500815"
    assert parse_cell(LEAST, "c").link.serial is None


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
    published = (
        Path(__file__).parents[2] / "audit" / "judge" / "published" / "ur5e" / "default_kinematics.yaml"
    ).read_text()
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


POST = 'name = "post", shape = "cylinder", pose = { position_m = [0.8, 0.1, 0.4] }, radius_m = 0.05, length_m = 0.8'


SHAPES = (
    f"{{ {POST}, clearance_m = 0.01 }}",
    "{ pose = { position_m = [1, 0, 0.2], rotation_vector_rad = [0, 0, 0.5] }, size_m = [0.2, 0.4, 0.4] }",
    '{ shape = "sphere", pose = { position_m = [0, 1, 1] }, radius_m = 0.2 }',
    '{ shape = "capsule", pose = { position_m = [0, -1, 1], rotation_vector_rad = [1.5707963, 0, 0] }, '
    "radius_m = 0.1, length_m = 0.6 }",
    '{ name = "wall", lower_m = [-2, -2, 0], upper_m = [-1.9, 2, 1] }',
)


def test_shapes_are_read_with_pose_size_name_and_clearance():
    here = parse_cell(f"{LEAST}[surroundings]\nkeep_out = [{', '.join(SHAPES)}]\n", "c")
    around = here.surroundings
    assert around.keep_out_names == ("post", "box 1", "sphere 2", "capsule 3", "wall")
    extents = [[0.1, 0.1, 0.8], [0.2, 0.4, 0.4], [0.4, 0.4, 0.4], [0.2, 0.2, 0.8], [0.1, 4.0, 1.0]]
    np.testing.assert_allclose([shape.extent for shape in around.keep_out], extents)
    np.testing.assert_allclose(around.keep_out[0].lower, [0.75, 0.05, 0.0])
    np.testing.assert_allclose(around.keep_out[3].upper, [0.1, -0.6, 1.1], atol=1e-6)
    np.testing.assert_allclose(around.clearance_m + around.further_clearances, [0.01, *[0.02] * 4])
    np.testing.assert_allclose(around.flight_clearances, [0.01, *[0.02] * 4])
    again = here.with_obstacles({"shape": "sphere", "pose": {"position_m": [2, 2, 2]}, "radius_m": 0.1})
    assert again.surroundings.keep_out_names[-1] == "sphere 5"
    assert again.sha256 != here.sha256


def test_keep_in_takes_the_shapes_that_keep_out_takes():
    far = "{ lower_m = [-2, -2, 0], upper_m = [2, 2, 3] }"
    here = parse_cell(f"{LEAST}[surroundings]\nkeep_in = [{', '.join((*SHAPES, far))}]\n", "c")
    around = here.surroundings
    assert around.keep_in_names == ("post", "box 1", "sphere 2", "capsule 3", "wall", "box 5")
    assert around.keep_in_clearances.tolist() == [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]  # not the cell's
    assert around.rooms.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(around.box_within, [[-2, -2, 0], [2, 2, 3]])


@pytest.mark.parametrize(
    ("entry", "field", "reason"),
    [
        ('{ shape = "points", file = "a.ply" }', "[0].shape", "box, cylinder, sphere, capsule, mesh"),
        ('{ shape = "mesh", file = "a.stl", pose = { position_m = [1, 0, 0] } }', "[0].file", "beside the cell file"),
        ('{ shape = "sphere", pose = { position_m = [90, 0, 0] }, radius_m = 20 }', "[0].pose", "110 m from the arm"),
        (f"{{ {POST} }}, {{ {POST} }}", "[1].name", "another one"),
        (f"{{ {POST}, clearance_m = -1 }}", "[0].clearance_m", "must lie in"),
    ],
)
def test_a_room_that_cannot_be_is_refused_by_its_field(entry, field, reason):
    with pytest.raises(CellError, match=reason) as refusal:
        parse_cell(f"{LEAST}[surroundings]\nkeep_in = [{entry}]\n", "c")
    assert refusal.value.field == f"surroundings.keep_in{field}"


@pytest.mark.parametrize(
    ("entries", "field", "reason"),
    [
        ('{ shape = "cone", pose = { position_m = [1, 0, 0] } }', "[0].shape", "box, cylinder, sphere, capsule"),
        ('{ shape = "sphere", radius_m = 0.1 }', "[0].pose", "missing"),
        (
            '{ shape = "sphere", pose = { position_m = [1e300, 0, 0] }, radius_m = 0.1 }',
            "[0].pose.position_m[0]",
            "1000",
        ),
        (
            '{ shape = "sphere", pose = { position_m = [1, 0, 0] }, radius_m = 0.1, name = "a\\nb" }',
            "[0].name",
            "printable",
        ),
        ('{ shape = "sphere", pose = { }, radius_m = 0.1 }', "[0].pose.position_m", "is missing: it must be a list"),
        (f"{{ {POST}, size_m = [1, 1, 1] }}", "[0].size_m", "unknown key"),
        (f"{{ {POST.replace('0.05', '-0.05')} }}", "[0].radius_m", "must lie in"),
        (f"{{ {POST}, clearance_m = -1 }}", "[0].clearance_m", "must lie in"),
        (f"{{ {POST.replace('post', 'a, b')} }}", "[0].name", "without"),
        (f"{{ {POST.replace('post', 'forearm')} }}", "[0].name", "something else"),
        (f"{{ {POST.replace('post', 'tool_0')} }}", "[0].name", "something else"),
        (f"{{ {POST} }}, {{ {POST} }}", "[1].name", "another one"),
        (
            f"{{ {POST.replace('post', 'box 1')} }}, {{ lower_m = [1, 1, 0], upper_m = [2, 2, 1] }}",
            "[1].name",
            "another",
        ),
        (f"{{ {POST}, lower_m = [1, 1, 0] }}", "[0].lower_m", "unknown key"),
    ],
)
def test_a_shape_that_cannot_be_is_refused_by_its_field(entries, field, reason):
    with pytest.raises(CellError, match=reason) as refusal:
        parse_cell(f"{LEAST}[surroundings]\nkeep_out = [{entries}]\n", "c")
    assert refusal.value.field == f"surroundings.keep_out{field}"


def test_every_fault_of_a_shape_is_named_at_once():
    entries = (
        '{ shape = "cone", height_m = 1 }',
        f"{{ {POST.replace('0.05', '-1').replace('post', 'a, b')}, colour = 3, size_m = [1, 1, 1] }}",
        '{ shape = "box", pose = { position_m = [1, 2] }, size_m = [1, 0, 1], clearance_m = 7 }',
    )
    text = f"{LEAST}[surroundings]\nkeep_out = [{', '.join(entries)}]\n[timing]\nlag_s = 9\n"
    where = "surroundings.keep_out"
    assert [fault.field for fault in mended_cell(CellSource("c", text.encode()))[0]] == [
        "timing.lag_s",
        f"{where}[0].shape",
        f"{where}[1].name",
        f"{where}[1].colour",
        f"{where}[1].size_m",
        f"{where}[1].radius_m",
        f"{where}[2].clearance_m",
        f"{where}[2].pose.position_m",
        f"{where}[2].size_m[1]",
    ]


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
serial = 7
"""


def test_every_fault_of_a_file_is_named_at_once():
    faults = {fault.field: fault.reason for fault in mended_cell(CellSource("c", MANY_FAULTS.encode()))[0]}
    assert set(faults) == {
        "surprise", "home_rad[1]", "tool.mass_kg", "tool.capsules[0].to_m", "tool.capsules[0].colour",
        "tool.capsules[1].to_m", "tool.capsules[1].radius_m", "limits.joint_velocity_rad_s[2]", "limits.tcp_speed_m_s",
        "surroundings.keep_out[0].lower_m", "gripper.output", "link.kind", "link.serial",
    }  # fmt: skip
    assert "beyond the arm's own limit" in faults["limits.joint_velocity_rad_s[2]"]


def test_reading_the_file_stops_at_the_first_of_them():
    with pytest.raises(CellError) as first:
        parse_cell(MANY_FAULTS, "c")
    assert str(first.value) == str(mended_cell(CellSource("c", MANY_FAULTS.encode()))[0][0])


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
    assert [fault.field for fault in mended_cell(CellSource("c", text.encode()))[0]] == fields


@pytest.mark.parametrize(("kind", "robot_makes_it"), [("sim", False), ("ur", True)])
def test_a_missing_calibration_file_belongs_beside_the_cell_file(kind, robot_makes_it):
    text = f'robot = "ur5e"\n[link]\nkind = "{kind}"\n[kinematics]\ncalibration = "missing.yaml"\n'
    with pytest.raises(CellError, match="put it beside the cell file") as refused:
        parse_cell(text, "c")
    assert ("--from-robot" in refused.value.reason) == robot_makes_it


@pytest.mark.parametrize(("given", "meant"), [("UR5e", "ur5e"), ("ur-10e", "ur10e"), ("fanuc", None), ("", None)])
def test_the_arm_that_was_meant_is_named(given, meant):
    with pytest.raises(CellError) as refused:
        parse_cell(LEAST.replace("ur5e", given), "c")
    found = refused.value.reason.partition("; did you mean ")[2]
    assert found == ("" if meant is None else f"{meant!r}?")


def test_a_wrong_name_does_not_hide_what_else_is_wrong():
    faults = mended_cell(CellSource("a b", (LEAST + "[timing]\nlag_s = 9\n").encode()))[0]
    assert [fault.field for fault in faults] == ["name", "timing.lag_s"]


def test_a_cell_made_in_code_has_a_hash_of_its_own():
    here = load_cell(CELLS / "ur5e-sim.toml")
    slower = here.with_limits(joint_velocity_rad_s=2.0)
    np.testing.assert_array_equal(slower.limits.qd_max, np.full(6, 2.0))
    assert slower.limits.tcp_speed_max == here.limits.tcp_speed_max
    in_code = replace(here, limits=replace(here.limits, qd_max=np.full(6, 2.0)))
    heavier = replace(here, object=replace(here.object, mass_kg=0.1))
    assert len({here.sha256, slower.sha256, heavier.sha256}) == 3
    assert slower.as_document()["limits"]["joint_velocity_rad_s"] == 2.0
    assert in_code.sha256 == slower.sha256 == replace(slower, name="another").sha256
    assert replace(slower, limits=here.limits).sha256 != slower.sha256
    same = replace(here, limits=replace(here.limits))
    assert same.sha256 == here.sha256  # nothing was changed


def test_what_a_profile_has_learnt_keeps_the_hash_of_the_file():
    here = load_cell(CELLS / "ur5e-sim.toml")
    gripper = replace(here.gripper, delay_s=0.05)
    learnt = here.as_learnt(timing=replace(here.timing, lag_s=0.03), gripper=gripper)
    assert learnt.sha256 == here.sha256
    assert (learnt.timing.lag_s, learnt.gripper.delay_s) == (0.03, 0.05)
    slow = learnt.with_limits(joint_velocity_rad_s=2.0)
    assert slow.timing.lag_s == 0.03
    assert slow.sha256 not in (here.sha256, here.with_limits(joint_velocity_rad_s=2.0).sha256)


@pytest.mark.parametrize(
    ("keys", "field"),
    [
        ({"joint_velocity_rad_s": 20.0}, r"limits\.joint_velocity_rad_s"),
        ({"joint_acceleration_rad_s2": [15.0, 15.0, 41.0, 15.0, 15.0, 15.0]}, r"joint_acceleration_rad_s2\[2\]"),
        ({"joint_position_upper_rad": 7.0}, r"limits\.joint_position_upper_rad"),
        ({"joint_torque_fraction": 1.1}, r"limits\.joint_torque_fraction"),
        ({"joint_velocity_rad_s": float("nan")}, r"limits\.joint_velocity_rad_s"),
        ({"speed": 1.0}, r"limits\.speed: unknown key"),
    ],
)
def test_no_key_says_that_an_arm_can_do_more_than_it_can(keys, field):
    with pytest.raises(CellError, match=field):
        load_cell(CELLS / "ur5e-sim.toml").with_limits(**keys)


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        ({"qd_max": 20.0}, r"limits\.qd_max\[0\] = 20\.0: is beyond the arm's own limit of 3\.14159"),
        ({"qdd_max": [15.0, 15.0, 41.0, 15.0, 15.0, 15.0]}, r"limits\.qdd_max\[2\]"),
        ({"q_upper": 7.0}, r"limits\.q_upper\[0\]"),
        ({"tau_max": 151.0}, r"limits\.tau_max\[0\]"),
        ({"qd_max": np.nan}, r"limits\.qd_max\[0\]"),
    ],
)
def test_no_cell_says_that_an_arm_can_do_more_than_it_can(limits, field):
    here = load_cell(CELLS / "ur5e-sim.toml")
    values = {name: np.broadcast_to(value, (6,)) for name, value in limits.items()}
    with pytest.raises(CellError, match=field):
        replace(here, limits=replace(here.limits, **values))


def test_a_tool_and_obstacles_changed_in_code_are_those_of_a_file():
    here = load_cell(CELLS / "ur5e-sim.toml")
    post = {"lower_m": np.array([0.8, 0.1, 0.0]), "upper_m": (0.9, 0.2, 1.0)}
    there = here.with_tool(mass_kg=0.8).with_obstacles(post)
    assert there.tool.mass_kg == 0.8
    assert there.tool.capsules[0].radius_m == here.tool.capsules[0].radius_m
    assert len(there.surroundings.keep_out) == len(here.surroundings.keep_out) + 1
    assert there.document["surroundings"]["keep_out"][-1]["upper_m"] == [0.9, 0.2, 1.0]
    assert there.sha256 not in (here.sha256, here.with_tool(mass_kg=0.8).sha256)
    assert here.with_tool().sha256 == here.sha256  # nothing was changed
    with pytest.raises(CellError, match=r"tool\.mass_kg"):
        here.with_tool(mass_kg=40.0)
    with pytest.raises(CellError, match=r"keep_out\[\d\]"):
        here.with_obstacles({"lower_m": [1.0, 1.0, 1.0], "upper_m": [0.0, 0.0, 0.0]})


def test_a_cell_is_stated_by_the_keys_of_a_file():
    stated = {"name": "bench", "robot": "ur5e", "link": {"kind": "sim"}, "tool": {"tcp_position_m": (0.0, 0.0, 0.1)}}
    here = cell_of_keys({**stated, "home_rad": np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])})
    assert (here.name, here.robot.name) == ("bench", "ur5e")
    assert here.as_document()["home_rad"] == [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
    assert "name" in stated
    with pytest.raises(CellError, match=r"tool\.mass: unknown key"):
        cell_of_keys({**stated, "tool": {"mass": 1.0}})
    with pytest.raises(CellError, match=r"gripper\.delay: unknown key; did you mean 'delay_s'\?"):
        cell_of_keys({**stated, "gripper": {"delay": 0.1}})
    with pytest.raises(CellError, match=r"must be one of .*; did you mean 'robotiq'\?"):
        cell_of_keys({**stated, "gripper": {"kind": "robotic"}})


def test_x_is_polyscope_x():
    assert parse_cell(LEAST + '[sim]\npolyscope = "x"\n', "cell").sim.polyscope == "10.14.0"


def test_an_arm_changed_in_code_is_still_the_arm_of_its_name():
    here = load_cell(CELLS / "ur5e-sim.toml")
    fast = replace(here.robot, qd_max=np.full(6, 20.0))
    with pytest.raises(CellError, match="beyond the arm's own limit"):
        replace(here, robot=fast, limits=replace(here.limits, qd_max=fast.qd_max))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ("[tool]\nmass_kg = 12.0\n", r"tool\.mass_kg = 12\.0: tool and object weigh 12\.05 kg together; .* 5 kg"),
        ("[tool]\nmass_kg = 1.0\n[object]\nmass_kg = 8.0\n", r"object\.mass_kg = 8\.0: .* weigh 9 kg together"),
    ],
)
def test_more_than_the_rated_payload_is_refused(changes, reason):
    with pytest.raises(CellError, match=reason):
        parse_cell(LEAST + changes, "c")
    assert parse_cell(LEAST + "[tool]\nmass_kg = 4.95\n", "c").tool.mass_kg == 4.95  # with the object exactly 5 kg
    here = load_cell(CELLS / "ur5e-sim.toml")
    with pytest.raises(CellError, match=r"object\.mass_kg = 8\.0"):
        replace(here, object=replace(here.object, mass_kg=8.0))


@pytest.mark.parametrize(
    ("changes", "field", "reason"),
    [
        ("[base_in_world]\nposition_m = [500, 0, 0]\n", "base_in_world.position_m[0]", "must lie in [-100, 100]"),
        (
            "[surroundings]\nkeep_in = [{ lower_m = [-500, -1, 0], upper_m = [500, 1, 2] }]\n",
            "surroundings.keep_in[0].lower_m[0]",
            "is 500 m from the arm, more than 100 m",
        ),
        ("[tool]\ntcp_position_m = [0, 0, 170]\n", "tool.tcp_position_m[2]", "must lie in [-3, 3]"),
        (
            "[tool]\ncapsules = [{ from_m = [0, 0, 0], to_m = [0, 0, 0.15], radius_m = 0.0 }]\n",
            "tool.capsules[0].radius_m",
            "must lie in [0.001, 1]",
        ),
        (
            "[tool]\ncapsules = [{ from_m = [0, 0, 0], to_m = [0, 0, 150], radius_m = 0.05 }]\n",
            "tool.capsules[0].to_m[2]",
            "must lie in [-3, 3]",
        ),
        ("[gripper]\nhold_acceleration_m_s2 = 1e9\n", "gripper.hold_acceleration_m_s2", "must lie in [0.001, 10000]"),
        ("[safety]\nelbow_speed_m_s = 1e3\n", "safety.elbow_speed_m_s", "must lie in [1e-06, 20]"),
        ("[safety]\nmomentum_kg_m_s = 1e9\n", "safety.momentum_kg_m_s", "must lie in [1e-06, 1000]"),
        ("[safety]\npower_w = 1e9\n", "safety.power_w", "must lie in [1e-06, 10000]"),
        ("[safety]\nstopping_time_s = 100.0\n", "safety.stopping_time_s", "must lie in [1e-06, 10]"),
    ],
)
def test_values_that_no_cell_has_are_refused_with_their_limit(changes, field, reason):
    with pytest.raises(CellError) as refusal:
        parse_cell(LEAST + changes, "c")
    assert (refusal.value.field, refusal.value.reason) == (field, reason)


def test_a_tool_without_a_shape_is_given_one():
    here = parse_cell(LEAST + "[tool]\ntcp_position_m = [0, 0.3, 0.4]\n[object]\nradius_m = 0.05\n", "c")
    (assumed,) = here.tool.capsules
    assert here.tool.is_assumed
    np.testing.assert_allclose(assumed.to_m, [0.0, 0.27, 0.36])  # to the object, half a metre away
    assert assumed.radius_m == pytest.approx(0.0467, abs=1e-3)  # source: UR5e, mesh of wrist 3
    longer = replace(here, tool=replace(here.tool, X_FT=pose([0.0, 0.0, 0.2], np.eye(3))))
    np.testing.assert_allclose(longer.tool.capsules[0].to_m, [0.0, 0.0, 0.15])
    assert parse_cell(LEAST, "c").tool.capsules == ()
    shipped = load_cell(CELLS / "ur5e-sim.toml")
    assert not shipped.tool.is_assumed
    assert replace(shipped, tool=replace(shipped.tool, capsules=())).tool.is_assumed


WRONG = ("", "0.02", [], {}, [1, 2], -1, math.nan, math.inf, 1e308, True, None, [[0, 0, 0]], {"a": 1})
WHOLE = {
    "timing": {"lag_s": 0.02},
    "outputs": {"glue": {"output": "standard_digital", "index": 1, "delay_s": 0.006, "sense_input": 2}},
    "gripper": {"delay_s": 0.04, "opening_direction": [0.0, 0.0, 1.0], "opening_cone_rad": 0.3, "grip_input": 3},
    "sim": {"polyscope": "5.11", "seed": 3},
    "surroundings": {"keep_out": [{"name": "box", "lower_m": [0.6, 0.5, 0.0], "upper_m": [0.8, 0.7, 0.2]}]},
    "safety": {"tool_speed_m_s": 3.0},
    "limits": {"joint_velocity_rad_s": 2.0},
    "tool": {"mass_kg": 1.0, "tcp_position_m": [0.0, 0.0, 0.15]},
    "object": {"mass_kg": 0.05},
    "home_rad": [0.0, -1.5, 1.5, -1.5, -1.5, 0.0],
}


def with_wrong(value, wrong):
    """Yields (path, value) with one entry of nested keys and lists replaced, for each entry."""
    yield "", wrong
    if not isinstance(value, dict | list):
        return
    for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
        for path, changed in with_wrong(entry, wrong):
            copy = value.copy()
            copy[key] = changed
            yield f"{key}.{path}", copy


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_a_wrong_value_at_any_key_is_refused_by_its_own_name_or_read(wrong):
    """Never another exception: one such file would keep the service from starting."""
    cell_of_keys({"robot": "ur5e", "link": {"kind": "sim"}, **WHOLE})
    for path, keys in with_wrong(WHOLE, wrong):
        if not isinstance(keys, dict):
            continue
        refused = refused_field({"robot": "ur5e", "link": {"kind": "sim"}, **keys})
        if path.startswith(("timing.lag_s", "sim.polyscope")) and wrong is not None:
            assert refused == path.removesuffix(".")


def refused_field(keys):
    """Returns the field by which keys of a cell are refused; None where they are read."""
    try:
        cell_of_keys(keys)
    except CellError as refusal:
        return refusal.field
    return None


def test_a_direction_whose_length_overflows_is_refused():
    gripper = {"opening_direction": [0.0, 0.0, 1e308], "opening_cone_rad": 0.3}
    with pytest.raises(CellError, match=r"opening_direction\[2\]"):
        cell_of_keys({"robot": "ur5e", "link": {"kind": "sim"}, "gripper": gripper})


def test_a_file_is_taken_apart_once_and_again_when_it_changes(tmp_path, monkeypatch):
    """A service reads the file at every request, and an observation of a target comes thirty times a second."""
    path = tmp_path / "cell.toml"
    first = (CELLS / "ur5e-sim.toml").read_bytes() + b"# read once\n"
    source._named_in.cache_clear()
    parsed = []
    parse = source.parse_toml
    monkeypatch.setattr(source, "parse_toml", lambda text: parsed.append(text) or parse(text))
    path.write_bytes(first)
    read = [read_source(path) for _ in range(3)]
    assert parsed == [first]
    path.write_bytes(first + b"# and again\n")
    assert read_source(path) != read[0]
    assert read[0] == read[1] == read[2]
    assert len(parsed) == 2
