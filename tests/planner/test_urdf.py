"""Arms from URDF files: what Pinocchio reads in the same file, and what does not fit."""

import re

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.published_arms import published
from planner.cell_folder import home_faults
from planner.dynamics import Payload, joint_torques
from planner.errors import FileRefused
from planner.kinematics import forward
from planner.robots import ROBOT_NAMES, robot
from planner.urdf import cell_from_urdf
from tests.planner.urdf_files import at, urdf_text

ATOL = 1e-9  # [m] the published quarter turns are rounded to nine decimals, and 1e-8 m is taken for rounding
OFFSETS = np.random.default_rng(4).uniform(-1.0, 1.0, (6, 6)) * [4e-4, 4e-4, 4e-4, 1e-3, 1e-3, 1e-3]
OFFSETS[0, :5] = 0.0  # a controller's base stands on the first axis


def read(tmp_path, text, **given):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return cell_from_urdf(path, "arm", **given)


def published_limits(name):
    return {joint: dict(limit) for joint, limit in published(name, "joint_limits")["joint_limits"].items()}


def pinocchio_model(text):
    model = pin.buildModelFromXML(text)
    return model, model.createData()


def assert_moves_alike(cell, text, tip, atol=ATOL):
    model, data = pinocchio_model(text)
    q = np.random.default_rng(5).uniform(-6.0, 6.0, (50, 6))
    found = cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)
    for i in range(len(q)):
        pin.framesForwardKinematics(model, data, q[i])
        np.testing.assert_allclose(found[i], data.oMf[model.getFrameId(tip)].homogeneous, rtol=0, atol=atol)


def assert_weighs_alike(cell, text):
    model, data = pinocchio_model(text)
    rng = np.random.default_rng(6)
    q, qd, qdd = rng.uniform(-3.0, 3.0, (3, 50, 6))
    down_B = cell.X_WB[:3, :3].T @ [0.0, 0.0, -9.81]
    tool = Payload(cell.tool.mass_kg, 0.5 * cell.tool.X_FT[:3, 3], np.zeros((3, 3)))
    found = joint_torques(cell.robot, q, qd, qdd, down_B, tool)
    expected = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-8 * np.abs(expected).max())


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_published_description_of_an_arm_is_that_arm(tmp_path, name):
    text = urdf_text(name)
    written = read(tmp_path, text)
    assert written.cell.robot.name == name
    assert written.calibration is None
    assert "arm_data" not in written.text
    assert_moves_alike(written.cell, text, "tcp")
    assert_weighs_alike(written.cell, text)
    assert written.cell.tool.mass_kg == 0.7


def test_a_calibrated_arm_with_a_prefix_keeps_its_chain_to_a_nanometre(tmp_path):
    text = urdf_text("ur10e", prefix="left_", offsets=OFFSETS)
    written = read(tmp_path, text)
    assert written.cell.robot.name == "ur10e"
    assert written.calibration is not None
    assert "calibration file" in " ".join(written.notes)
    assert_moves_alike(written.cell, text, "left_tcp")
    assert_weighs_alike(written.cell, text)


@pytest.mark.parametrize("axis", [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
def test_axes_may_point_along_any_coordinate_of_their_links(tmp_path, axis):
    text = urdf_text("ur5e", axis=axis)
    assert 'axis xyz="0 0 1"' not in text
    written = read(tmp_path, text)
    assert (written.cell.robot.name, written.calibration) == ("ur5e", None)
    assert_moves_alike(written.cell, text, "tcp")
    assert_weighs_alike(written.cell, text)


def test_tighter_limits_are_taken_over_and_wider_ones_are_named(tmp_path):
    bounds = published_limits("ur5e")
    bounds["elbow_joint"] |= {"max_position": 2.0, "max_velocity": 1.5}
    bounds["wrist_2_joint"] |= {"max_effort": 14.0}
    bounds["wrist_3_joint"] |= {"max_velocity": 9.0}
    written = read(tmp_path, urdf_text("ur5e", limits=bounds))
    limits = written.cell.limits
    assert limits.q_upper[2] == 2.0
    assert limits.qd_max[2] == 1.5
    np.testing.assert_allclose(limits.tau_max, 0.5 * robot("ur5e").tau_max)
    assert limits.qd_max[5] == robot("ur5e").qd_max[5]
    assert any("velocity" in note and "wrist_3" in note for note in written.notes)


def test_other_masses_are_the_arms(tmp_path):
    text = urdf_text("ur5e").replace('mass value="8.058"', 'mass value="9.5"')
    written = read(tmp_path, text)
    assert [link.mass for link in written.cell.robot.links][1] == 9.5
    assert 'source = "URDF file arm.urdf"' in written.text
    assert_weighs_alike(written.cell, text)


def test_other_masses_of_a_calibrated_arm_are_in_its_own_frames(tmp_path):
    text = urdf_text("ur5e", offsets=8.0 * OFFSETS).replace('mass value="8.058"', 'mass value="9.5"')
    written = read(tmp_path, text)
    assert written.calibration is not None
    assert_moves_alike(written.cell, text, "tcp")
    assert_weighs_alike(written.cell, text)


def test_a_file_without_masses_or_limits_has_the_published_ones(tmp_path):
    text = re.sub(r"<inertial>.*?</inertial>", "", urdf_text("ur16e", limits={}), flags=re.DOTALL)
    written = read(tmp_path, text)
    assert written.cell.robot is robot("ur16e")
    assert any("mass" in note for note in written.notes)


def test_an_arm_whose_numbers_are_not_published_is_taken_from_its_file(tmp_path):
    text = urdf_text("ur8long", limits=published_limits("ur15"))
    written = read(tmp_path, text)
    assert written.cell.robot.name == "ur8long"
    np.testing.assert_allclose(written.cell.robot.tau_max, robot("ur15").tau_max)
    assert_moves_alike(written.cell, text, "tcp")
    assert_weighs_alike(written.cell, text)


def test_an_arm_with_no_published_kinematics_is_named(tmp_path):
    text = urdf_text("ur8long", limits=published_limits("ur15")).replace("-0.8989", "-0.8000")
    with pytest.raises(FileRefused, match=r"ur10g_1750.*ur17g_1300.*ur18g_950"):
        read(tmp_path, text)
    written = read(tmp_path, text, model="ur17g_1300")
    assert written.cell.robot.name == "ur17g_1300"
    assert written.cell.robot.a[1] == -0.8
    assert_moves_alike(written.cell, text, "tcp")
    assert_weighs_alike(written.cell, text)
    again = read(tmp_path, text.replace('name="arm"', 'name="ur17g-1300"'))
    assert again.cell.robot is written.cell.robot


def test_two_models_with_the_same_kinematics_are_said(tmp_path):
    written = read(tmp_path, urdf_text("ur5e"))
    assert any("ur5e and ur7e" in note for note in written.notes)
    named = read(tmp_path, urdf_text("ur5e"), model="ur7e")
    assert named.cell.robot is robot("ur7e")
    assert named.notes == written.notes[1:]


def test_fingers_are_a_tool_and_several_ends_are_named(tmp_path):
    fingers = "".join(
        f'<link name="finger_{i}"><inertial><mass value="0.1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0"'
        f' izz="0"/></inertial></link><joint name="close_{i}" type="prismatic"><parent link="gripper"/>'
        f'<child link="finger_{i}"/><origin xyz="0 0.0{i} 0.1"/></joint>'
        for i in (1, 2)
    )
    text = urdf_text("ur5e").replace("</robot>", fingers + "</robot>")
    written = read(tmp_path, text)
    assert written.cell.tool.mass_kg == pytest.approx(0.9)
    assert any("finger_1, finger_2" in note and "--tcp" in note for note in written.notes)
    assert any("close_1, close_2" in note for note in written.notes)
    named = read(tmp_path, text, tcp="tcp")
    np.testing.assert_allclose(named.cell.tool.X_FT[:3, 3], [0.0, 0.0, 0.12], atol=1e-12)


def body(name, shape, xyz="0 0 0", rpy="0 0 0", parent="base_link", kind="fixed", tag="collision"):
    return (
        f'<link name="{name}"><{tag}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></{tag}></link>'
        f'<joint name="to_{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/></joint>'
    )


def beside(*bodies, name="ur5e", stand=None):
    return urdf_text(name, stand=stand).replace("</robot>", "".join(bodies) + "</robot>")


BOX = '<box size="1.2 0.8 0.05"/>'


def test_a_box_under_the_base_is_kept_out_of(tmp_path):
    stand = at((0.3, -0.2, 0.8), (0.0, 0.0, np.pi / 2))
    written = read(tmp_path, beside(body("table", BOX, "0.1 0 -0.025"), stand=stand))
    (box,) = written.cell.surroundings.keep_out
    np.testing.assert_allclose(box.lower, [0.3 - 0.4, -0.1 - 0.6, 0.75], atol=1e-12)
    np.testing.assert_allclose(box.upper, [0.3 + 0.4, -0.1 + 0.6, 0.8], atol=1e-12)
    assert box.core is None
    assert 'name = "table"' in written.text
    assert any("keep_out has the shapes of table" in note for note in written.notes)
    assert any("floor" in note and "z = 0 of world, 0.8 m below" in note for note in written.notes)
    assert home_faults(written.cell) == []


@pytest.mark.parametrize(
    ("around", "words"),
    [
        (body("table", '<box size="1 1 0"/>'), "table (a box without thickness)"),
        (body("table", '<mesh filename="package://lab/table.stl"/>'), "table (a mesh)"),
        (body("post", '<cylinder radius="0.1" length="0"/>', parent="world"), "post (a cylinder without thickness)"),
        (body("hat", "<cone/>"), "hat (a cone)"),
        (body("picture", BOX, tag="visual"), "picture (a box that is only drawn)"),
        (body("camera", BOX, parent="forearm_link"), "camera (moved by shoulder_pan_joint)"),
        (body("door", BOX, kind="revolute"), "door (moved by to_door)"),
    ],
)
def test_a_shape_around_the_arm_that_is_not_taken_over_is_named(tmp_path, around, words):
    written = read(tmp_path, beside(around, stand=at()))
    assert written.cell.surroundings.keep_out == ()
    assert any(f"the shape of {words} is not taken over" in note for note in written.notes)


def test_turned_and_round_shapes_are_kept_out_where_they_are(tmp_path):
    around = body("table", BOX, "2 0 0.5", "0 0 0.1") + body("post", '<cylinder radius="0.1" length="1"/>', "1.5 1 0.5")
    written = read(tmp_path, beside(around, body("ball", '<sphere radius="0.1"/>', "-2 0 0.5"), stand=at()))
    table, post, ball = written.cell.surroundings.keep_out
    assert [shape.kind for shape in (table, post, ball)] == ["box", "cylinder", "sphere"]
    np.testing.assert_allclose(table.X_WC[:2, :2], [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    np.testing.assert_allclose([post.X_WC[:3, 3], ball.X_WC[:3, 3]], [[1.5, 1.0, 0.5], [-2.0, 0.0, 0.5]])
    np.testing.assert_allclose([*table.extent, *post.extent, *ball.extent], [1.2, 0.8, 0.05, 0.2, 0.2, 1.0, *[0.2] * 3])
    assert "surroundings.keep_out has the shapes of table, post, ball" in written.notes


def test_shapes_of_the_arm_itself_are_its_own(tmp_path):
    mesh = '<collision><geometry><mesh filename="base.stl"/></geometry></collision>'
    text = beside(stand=at()).replace(
        '<link name="base_link_inertia"/>', f'<link name="base_link_inertia">{mesh}</link>'
    )
    text = text.replace('<link name="forearm_link">', f'<link name="forearm_link">{mesh}')
    assert text.count("base.stl") == 2
    written = read(tmp_path, text)
    assert not any("shape" in note and "tool" not in note for note in written.notes)
    boxed = read(tmp_path, text.replace('<mesh filename="base.stl"/>', BOX))
    assert any("base_link_inertia count as the arm's base" in note for note in boxed.notes)


GOOD = urdf_text("ur5e")
ELBOW = '<joint name="elbow_joint" type="revolute">'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not XML"),
        ("<robot", "is not XML"),
        ('<?xml version="1.0" encoding="rot13"?><robot/>', "is not XML"),
        ('<?xml version="1.0" encoding="foo"?><robot/>', "is not XML"),
        ("<sdf/>", "outermost element is <sdf>"),
        ("<robot/>", "has no links"),
        ('<robot xmlns:xacro="x"><xacro:include/></robot>', "xacro"),
        ('<!DOCTYPE robot [<!ENTITY a "aaaa">]><robot>&a;</robot>', "declares a document type"),
        ('<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', "declares a document type"),
        ("<a>" * 40 + "</a>" * 40, "nests deeper than 32 levels"),
        (GOOD.replace(ELBOW, ELBOW.replace("revolute", "fixed")), "has 5 moving joints"),
        (GOOD.replace(ELBOW, ELBOW.replace("revolute", "prismatic")), "elbow_joint is prismatic"),
        (GOOD.replace(ELBOW, ELBOW.replace("revolute", "twisted")), "its type is 'twisted'"),
        (GOOD.replace("gripper-tcp", "x").replace('"x" type="fixed"', '"x" type="revolute"'), None),
        (
            GOOD.replace('"shoulder_pan_joint"', '"j1"').replace('gripper-tcp" type="fixed', 'j7" type="revolute'),
            "7 moving",
        ),
        (GOOD.replace('link="world"', 'link="moon"'), "there is no link moon"),
        (GOOD.replace('child link="tcp"', 'child link="gripper"'), "hangs from two joints"),
        (GOOD.replace('parent link="world"', 'parent link="tcp"'), "exactly one link|circle"),
        (GOOD.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), "its axis is zero"),
        (GOOD.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>', 2), "is not (across|parallel to)"),
        (GOOD.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', 2), "parallel to"),
        (GOOD.replace("-0.425", "-0.9"), "the closest, that of the ur.*, differs by"),
        (GOOD.replace("-0.425", "-0.445"), "is no ur5e"),
        (GOOD.replace("-0.425", "nan"), "is no finite number"),
        (GOOD.replace("-0.425", "1e999"), "is no finite number"),
        (GOOD.replace('mass value="8.058"', 'mass value="-8.058"'), "below 0"),
        (GOOD.replace('mass value="8.058"', 'weight value="8.058"'), "<mass> is missing"),
        (beside(body("table", '<box size="1 1 -1"/>')), "the size of its box is negative"),
        (beside(body("table", '<box size="1 1"/>')), "three numbers"),
        (beside(body("table", "")), "its <geometry> is empty"),
        (
            beside(
                body("b", BOX).replace(
                    "</link>", 1000 * f"<collision><geometry>{BOX}</geometry></collision>" + "</link>"
                )
            ),
            "1001 shapes",
        ),
        (GOOD.replace('ixx="0.0', 'ixx="9.0', 1).replace('name="arm"', 'name="ur5e"'), "inertia of no body"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, text, words):
    if words is None:
        assert read(tmp_path, text).cell.robot.name == "ur5e"
        return
    with pytest.raises(FileRefused, match=words) as refused:
        read(tmp_path, text)
    assert str(refused.value).startswith(str(tmp_path / "arm.urdf"))
    assert len(str(refused.value)) < 600


def test_an_unknown_model_and_an_unknown_link_are_refused(tmp_path):
    with pytest.raises(FileRefused, match=r"unknown robot 'kr16'"):
        read(tmp_path, GOOD, model="kr16")
    with pytest.raises(FileRefused, match=r"did you mean 'ur5e'\?"):
        read(tmp_path, GOOD, model="UR5e")
    with pytest.raises(FileRefused, match="is no ur3e"):
        read(tmp_path, GOOD, model="ur3e")
    with pytest.raises(FileRefused, match="no link lamp"):
        read(tmp_path, GOOD, tcp="lamp")


def test_a_file_that_lacks_what_is_not_published_is_refused_with_it(tmp_path):
    bounds = published_limits("ur15")
    for joint in ("elbow_joint", "wrist_3_joint"):
        bounds[joint] |= {"max_velocity": 0.0, "max_effort": 0.0}
    for limits, velocity in [({}, "shoulder_pan_joint, .*, wrist_3_joint"), (bounds, "elbow_joint, wrist_3_joint")]:
        with pytest.raises(FileRefused) as refused:
            read(tmp_path, urdf_text("ur8long", limits=limits))
        words = str(refused.value)
        assert re.search(f"lacks a velocity above 0 in the <limit> of {velocity} and an effort above 0", words)
        assert "for a ur8long that is not published" in words
        assert "[arm_data] takes joint_velocity_deg_s, joint_torque_n_m, with their source" in words
    without = re.sub(r"<inertial>.*?</inertial>", "", GOOD, count=1, flags=re.DOTALL)
    with pytest.raises(FileRefused, match=r"a mass above 0 in the <inertial> of .*shoulder_link.*link_mass_kg"):
        read(tmp_path, without, model="ur17g_1300")


def test_a_large_file_is_not_read(tmp_path):
    with pytest.raises(FileRefused, match=r"larger than 5000000 bytes"):
        read(tmp_path, "<robot>" + " " * 5_000_000)


def test_names_in_a_file_cannot_add_to_the_cell_file(tmp_path):
    path = tmp_path / 'x"\n[link]\nkind = "ur"\n#.urdf'
    path.write_text(GOOD.replace('mass value="8.058"', 'mass value="9.5"'))
    written = cell_from_urdf(path, "arm")
    assert written.cell.link.kind == "sim"
    assert written.text.count("\n[link]\n") == 1
