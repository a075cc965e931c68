"""An arm that is 5 mm off the published table: imported over the wire, compared, and thrown with."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from executor.robot import read_kinematics
from planner.calibration import DhTable, calibration_text
from planner.kinematics import forward
from tests.planner.calibration.arms import measured_arm, product_of
from tests.system.rig import LOB, Rig

POSES = 1000
SAME_M = 1e-4  # [m] promised
LANDED_M = 3e-3  # [m] ideal arm with the published table: 1.3 mm


def truth_text(seed: int) -> str:
    """A truth file whose arm deviates by up to 5 mm and 5 mrad in every number of its table."""
    rng = np.random.default_rng(seed)
    a, d = rng.uniform(-5e-3, 5e-3, (2, 6)).tolist()
    alpha, theta = rng.uniform(-5e-3, 5e-3, (2, 6)).tolist()
    return f"[arm]\ndh_deviation = {{ a_m = {a}, d_m = {d}, alpha_rad = {alpha}, theta_rad = {theta} }}\n"


def landing_error(rig: Rig) -> float:
    row = rig.end(rig.queue_plan(rig.plan(LOB, backend="casadi")))
    assert row.outcome == "completed", row.reason
    return row.metrics["landing_error_m"]


@pytest.fixture
def deviating(own_rig: Rig) -> Rig:
    truth = own_rig.folder / "truth.toml"
    truth.write_text(truth_text(7))
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    return own_rig


@pytest.mark.slow
def test_a_calibrated_throw_lands_and_another_arms_file_is_refused(deviating: Rig) -> None:
    rig = deviating
    rig.start_executor()
    without = landing_error(rig)
    command = ["from api.cli import main; main()", "cell", "kinematics", "--from-robot", "--cell", "rig"]
    done = subprocess.run(
        [sys.executable, "-c", *command], env=rig.environment, capture_output=True, text=True, check=True
    )
    assert "rig-kinematics.yaml" in done.stdout
    rig.rewrite(rig.path.read_text() + '\n[kinematics]\ncalibration = "rig-kinematics.yaml"\n')
    table = read_kinematics(rig.host).table
    q = np.random.default_rng(1).uniform(-6.0, 6.0, (POSES, 6))
    told = np.array([product_of(table, row) for row in q])
    assert np.linalg.norm((forward(rig.cell.robot, q) - told)[:, :3, 3], axis=1).max() < SAME_M
    with_calibration = landing_error(rig)
    print(f"landed {without * 1e3:.1f} mm off without, {with_calibration * 1e3:.2f} mm with the calibration")
    assert with_calibration < LANDED_M < without

    other = DhTable(table.theta, table.a + 5e-4 * np.eye(6)[1], table.d, table.alpha)
    (rig.folder / "rig-kinematics.yaml").write_text(calibration_text(measured_arm("ur5e", other).fixed, other.hash))
    rig.rewrite(rig.path.read_text())
    row = rig.end(rig.queue_plan(rig.plan(LOB, backend="casadi")))
    assert row.outcome == "refused"
    assert "kinematic_calibration: rig-kinematics.yaml" in row.reason
