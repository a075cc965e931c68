"""Measured chains against plain products of their tables, and against Pinocchio from their files."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yaml

from audit.judge.published_arms import LINKS, placement, published_file
from planner.calibration import (
    DhTable,
    calibrated,
    calibration_text,
    parse_calibration,
    published_table,
    table_of,
    transforms_of_table,
)
from planner.errors import CellError
from planner.geometry import levers
from planner.kinematics import chain_difference, forward, inverse_branches, jacobian, link_poses, singularity_distances
from planner.robots import ROBOT_NAMES, robot
from tests.planner.calibration.arms import UR5E_FILE, UR10_DEVIATIONS, deviated_table, measured_arm, product_of

EXACT = 1e-9  # [m, -] of a pose


def postures(rng, count):
    return rng.uniform(-2.0 * np.pi, 2.0 * np.pi, (count, 6))


def poses_of(table, q):
    return np.array([product_of(table, row) for row in q])


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_a_thousand_poses_are_those_of_the_controllers_table(name):
    rng = np.random.default_rng([7, ROBOT_NAMES.index(name)])
    for flange in (False, True):
        table = deviated_table(name, rng, flange=flange)
        text = calibration_text(measured_arm(name, table).fixed, table.hash)
        file, arm = parse_calibration(text.encode(), "arm.yaml", robot(name))
        q = postures(rng, 500)
        assert np.abs(forward(arm, q) - poses_of(table, q)).max() < EXACT
        assert file.hash == table.hash
        assert ("flange" in text) == flange
        assert chain_difference(arm, robot(name)).largest_m > 1e-3


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_published_file_is_the_published_arm_and_has_its_hash(name):
    text = published_file(name, "default_kinematics").read_bytes()
    file, arm = parse_calibration(text, "default_kinematics.yaml", robot(name))
    assert chain_difference(arm, robot(name)).largest_m < 2e-9  # the file's quarter turns are rounded to 2e-10
    assert file.hash == published_table(robot(name)).hash


def test_a_public_file_is_what_pinocchio_makes_of_it():
    rng = np.random.default_rng(3)
    _, arm = parse_calibration(UR5E_FILE, "my_robot_calibration.yaml", robot("ur5e"))
    model = pin.Model()
    joint = 0
    for link in LINKS:
        origin = yaml.safe_load(UR5E_FILE)["kinematics"][link]
        joint = model.addJoint(joint, pin.JointModelRZ(), placement(origin, False), link)
    data = model.createData()
    for q in postures(rng, 100):
        pin.forwardKinematics(model, data, q)
        assert np.abs(forward(arm, q) - data.oMi[6].homogeneous).max() < EXACT
    assert 1e-3 < chain_difference(arm, robot("ur5e")).largest_m < 5e-3  # 2.0 mm, 0.8 mm in the median


def test_the_table_of_a_public_file_has_offsets_of_many_metres_that_cancel():
    rng = np.random.default_rng(4)
    _, arm = parse_calibration(UR5E_FILE, "my_robot_calibration.yaml", robot("ur5e"))
    table = table_of(arm)
    q = postures(rng, 100)
    assert np.abs(table.d[1:3]).min() > 0.1
    assert np.abs(arm.d - robot("ur5e").d).max() < 1e-3
    assert np.abs(poses_of(table, q) - forward(arm, q)).max() < EXACT
    assert np.abs(forward(measured_arm("ur5e", table), q) - forward(arm, q)).max() < EXACT


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-6])
def test_offsets_of_hundreds_of_metres_cancel(angle):
    rng = np.random.default_rng(5)
    arm = measured_arm("ur10e", deviated_table("ur10e", rng, length=2e-3, angle=angle))
    table = table_of(arm)
    q = postures(rng, 50)
    assert np.abs(forward(measured_arm("ur10e", table), q) - forward(arm, q)).max() < EXACT
    assert np.abs(poses_of(table, q) - forward(arm, q)).max() < EXACT


def test_a_measured_table_of_a_ur10_is_kept():
    rng = np.random.default_rng(6)
    model = published_table(robot("ur10"))
    table = DhTable(
        *(x + y for x, y in zip((model.theta, model.a, model.d, model.alpha), UR10_DEVIATIONS, strict=True))
    )
    arm = measured_arm("ur10", table)
    q = postures(rng, 200)
    assert np.abs(forward(arm, q) - poses_of(table, q)).max() < EXACT
    assert np.abs(arm.d - model.d).max() < 2e-3
    assert np.abs(poses_of(table_of(arm), q) - poses_of(table, q)).max() < EXACT


def test_frames_turn_about_the_axes_of_the_joints():
    rng = np.random.default_rng(8)
    arm = measured_arm("ur5e", deviated_table("ur5e", rng))
    for q in postures(rng, 5):
        X = link_poses(arm, q)
        step = 1e-6
        J = jacobian(arm, q)
        for joint, change in enumerate(np.eye(6) * step):
            moved = link_poses(arm, q + change)
            back = link_poses(arm, q - change)
            assert np.abs((moved - back)[: joint + 1]).max() == 0.0
            linear = (moved[6, :3, 3] - back[6, :3, 3]) / (2.0 * step)
            assert np.abs(J[:3, joint] - linear).max() < 1e-8
            assert np.abs(moved[joint + 1, :3, :3] @ X[joint + 1, :3, :3].T @ J[3:, joint] - J[3:, joint]).max() < 1e-9


def test_levers_bound_the_distances_from_the_axes():
    rng = np.random.default_rng(9)
    for name in ("ur3e", "ur10e"):
        arm = measured_arm(name, deviated_table(name, rng, flange=True))
        X = link_poses(arm, postures(rng, 500))
        for frame in range(1, 7):
            arms = X[:, frame, None, :3, 3] - X[:, :frame, :3, 3]
            distances = np.linalg.norm(np.cross(arms, X[:, :frame, :3, 2]), axis=2).max(axis=0)
            assert np.all(distances <= levers(arm, frame, 0.0)[:frame] + 1e-12)


@pytest.mark.parametrize("name", ["ur3", "ur5e", "ur10e", "ur20"])
def test_the_inverse_is_exact_and_complete(name):
    rng = np.random.default_rng([10, ROBOT_NAMES.index(name)])
    arm = measured_arm(name, deviated_table(name, rng))
    q = rng.uniform(-np.pi, np.pi, (300, 6))
    q = q[singularity_distances(arm, q).minimum > 0.1]
    X = forward(arm, q)
    branches, excess = inverse_branches(arm, X)
    found = np.isfinite(branches[..., 0])
    errors = np.abs(forward(arm, branches[found]) - np.broadcast_to(X[:, None], (*found.shape, 4, 4))[found])
    assert errors.max() < EXACT
    assert np.all((excess == 0.0) == found)
    away = np.abs((branches - q[:, None] + np.pi) % (2.0 * np.pi) - np.pi).max(axis=2)
    assert np.all(np.nanmin(np.where(found, away, np.nan), axis=1) < 1e-7)


def test_a_pose_far_out_of_reach_has_no_solution():
    arm = measured_arm("ur5e", deviated_table("ur5e", np.random.default_rng(11)))
    X = np.eye(4)
    X[:3, 3] = 1.5, 0.0, 0.3
    branches, excess = inverse_branches(arm, X)
    assert np.isnan(branches).all()
    assert excess.min() > 0.3


def test_equal_chains_are_one_arm():
    table = deviated_table("ur5e", np.random.default_rng(12))
    assert measured_arm("ur5e", table) is measured_arm("ur5e", DhTable(table.theta, table.a, table.d, table.alpha))
    assert calibrated(robot("ur5e"), transforms_of_table(table)).published is robot("ur5e")


GOOD = UR5E_FILE.decode()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "is not YAML"),
        ("\xff", "is no"),
        ("[]", "has no mapping `kinematics`"),
        (GOOD.replace("wrist_3", "wrist_4"), "unknown link"),
        (GOOD[: GOOD.index("  wrist_3")], "wrist_3: is missing"),
        (
            GOOD.replace("x: -0.425170344631444", "x: .nan"),
            r"kinematics\.forearm\.x = '\.nan': must be a finite number",
        ),
        (GOOD.replace("x: -0.425170344631444", "x: true"), "must be a finite number"),
        (GOOD.replace("x: -0.425170344631444", "x: abc"), "must be a finite number"),
        (GOOD.replace("    x: -0.425170344631444\n", ""), "must have exactly x, y, z, roll, pitch, yaw"),
        (GOOD.replace("-0.425170344631444", "-0.6127"), "wrist_1_joint is|elbow_joint is"),
        (GOOD.replace("{x: 0, y: 0, z: 0.1627", "{x: 0.01, y: 0, z: 0.1627"), "base_in_world"),
    ],
)
def test_a_wrong_file_is_refused(text, words):
    with pytest.raises(CellError, match=words) as refused:
        parse_calibration(text.encode("latin-1"), "arm.yaml", robot("ur5e"))
    assert "arm.yaml" in str(refused.value)


@pytest.mark.parametrize(("of", "other"), [("ur3", "ur3e"), ("ur5", "ur5e"), ("ur10e", "ur16e"), ("ur20", "ur30")])
def test_a_file_of_another_model_is_refused(of, other):
    text = published_file(of, "default_kinematics").read_bytes()
    with pytest.raises(CellError, match=f"is no {other}"):
        parse_calibration(text, "arm.yaml", robot(other))


def test_numbers_that_yaml_reads_as_text_are_numbers():
    text = GOOD.replace("yaw: 5.707382499074709e-08", "yaw: 6e-08")
    assert yaml.safe_load(text)["kinematics"]["shoulder"]["yaw"] == "6e-08"
    assert parse_calibration(text.encode(), "arm.yaml", robot("ur5e"))[1].fixed is not None
