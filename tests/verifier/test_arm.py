"""The verifier's arm holds what Pinocchio computes from the published URDF numbers, at any instant of a motion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicHermiteSpline

from audit.judge.pinocchio_arm import arm_model, poses_and_velocity
from planner.cell import Cell
from tests.planner import problems
from verifier.arm import ArmPieces, empty_masses, object_mass
from verifier.pieces import all_pieces
from verifier.plan_document import SampledMotion
from verifier.taylor import TaylorModel

ROUNDED = 1e-9  # [m, m/s] quarter turns are rounded in URDF files
ROUNDED_TORQUE = 1e-7  # [N m] likewise


def random_motion(cell: Cell, ticks: int = 30) -> SampledMotion:
    """A motion of random jerks, and so no plan."""
    rng = np.random.default_rng(5)
    h = 1.0 / cell.robot.sample_rate_hz
    jerk = rng.uniform(-300.0, 300.0, (ticks, 6))
    q, qd, qdd = [rng.uniform(-2.0, 2.0, 6)], [rng.uniform(-1.0, 1.0, 6)], [rng.uniform(-3.0, 3.0, 6)]
    for j in jerk:
        q.append(q[-1] + h * qd[-1] + h * h / 2.0 * qdd[-1] + h**3 / 6.0 * j)
        qd.append(qd[-1] + h * qdd[-1] + h * h / 2.0 * j)
        qdd.append(qdd[-1] + h * j)
    return SampledMotion(cell.robot.sample_rate_hz, np.array(q), np.array(qd), np.array(qdd), None)


def misses(x: TaylorModel, s: float, exact: np.ndarray) -> float:
    """By how much a model does not hold values at all its pieces, at most."""
    return float((np.abs(x.c0 + x.c1 * s + x.c2 * s * s - exact) - x.r).max())


@pytest.mark.parametrize("name", ["ur5e-sim", "ur5-sim", "ur10e-sim"])
@pytest.mark.parametrize("s", [-1.0, -0.3, 0.7])
def test_the_arm_holds_what_pinocchio_computes(name: str, s: float):
    cell = problems.cell(name)
    motion = random_motion(cell)
    pieces = all_pieces(motion)
    arm = ArmPieces(cell, pieces)
    t = (pieces.tick + 0.5 + 0.5 * s) / motion.rate_hz
    spline = CubicHermiteSpline(np.arange(len(motion.q)) / motion.rate_hz, motion.q, motion.qd)
    states = list(zip(spline(t), spline(t, 1), spline(t, 2), strict=True))
    empty = arm_model(cell, False)
    data = empty.createData()
    tool = [poses_and_velocity(cell, empty, data, q, qd) for q, qd, _ in states]
    p_WT = np.array([poses[6].act(cell.tool.X_FT[:3, 3]) for poses, _ in tool]).T
    assert misses(arm.p_WT, s, p_WT) < ROUNDED
    assert misses(arm.v_WT, s, np.array([v for _, v in tool]).T) < ROUNDED
    # Second derivatives of a spline of rounded samples are off by rounding over the square of a tick.
    tau = np.array([pin.rnea(empty, data, *state) for state in states]).T
    held = arm_model(cell, True)
    loaded = np.array([pin.rnea(held, held.createData(), *state) for state in states]).T
    torques = arm.torques(empty_masses(cell))
    assert misses(torques, s, tau) < ROUNDED_TORQUE
    assert misses(torques + arm.torques([object_mass(cell)]), s, loaded) < ROUNDED_TORQUE


def test_the_bounds_are_close():
    """A bound that holds anything would hold Pinocchio's numbers too."""
    arm = ArmPieces(problems.cell(), all_pieces(random_motion(problems.cell())))
    assert arm.p_WT.r.max() < 1e-6
    assert arm.torques(empty_masses(arm.cell)).r.max() < 0.02
