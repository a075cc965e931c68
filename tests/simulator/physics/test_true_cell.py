"""Gripper, release, base, arm geometry and camera of a truth, against closed forms and the planner's kinematics."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.flight import drag_constant, fly
from planner.kinematics import forward
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import rotation_vector_to_matrix
from simulator.physics.camera import ObservingCamera
from simulator.physics.controller_kinematics import checksums, controller_table
from simulator.physics.gripper import SimulatedGripper
from simulator.physics.kinematics import KinematicChain, pose_error, pose_of
from simulator.physics.world import World
from simulator.truth import (
    ArmDeviation,
    CameraNoise,
    DhDeviation,
    GripperOpening,
    ReleaseSpeed,
    Truth,
    truth_of,
)
from tests.simulator.conftest import Driven, make_cell

SPEEDJ = 9
OPEN = {"tool_digital_output_mask": 1, "tool_digital_output": 1}
CLOSED = {"tool_digital_output_mask": 1, "tool_digital_output": 0}


def truth(cell: Any, **parts: Any) -> Truth:
    return replace(truth_of(cell), seed=11, **parts)


def delays(opening: GripperOpening, count: int = 4000) -> np.ndarray:
    """Returns the delays of `count` openings of one gripper [s]."""
    gripper = SimulatedGripper(make_cell().gripper, 0.04, opening, 5)
    found = []
    for _ in range(count):
        gripper.output_changed(0.0, gripper.open_bits)
        found.append(gripper.take_release(math.inf))
        gripper.let_go()
        gripper.output_changed(0.0, gripper.closed_bits)
        gripper.rearm(True)
    return np.array(found)


@pytest.mark.parametrize("shape", ["gaussian", "skewed"])
def test_delay_and_jitter_are_mean_and_deviation_of_the_opening(shape: str) -> None:
    found = delays(GripperOpening(0.060, 0.004, shape))
    assert found.mean() == pytest.approx(0.060, abs=0.0002)
    assert found.std() == pytest.approx(0.004, rel=0.05)
    skewness = np.mean(((found - found.mean()) / found.std()) ** 3)
    assert skewness == pytest.approx(math.sqrt(2.0) if shape == "skewed" else 0.0, abs=0.25)


@pytest.mark.parametrize("jitter_s", [0.0, 0.003])
def test_a_quantised_gripper_adds_the_deviation_of_its_own_clock(jitter_s: float) -> None:
    found = delays(GripperOpening(0.060, jitter_s, "quantised"))
    assert found.mean() == pytest.approx(0.060, abs=0.0002)
    assert found.std() == pytest.approx(math.hypot(jitter_s, 0.010 / math.sqrt(12.0)), rel=0.05)


def test_the_delay_drifts_from_throw_to_throw() -> None:
    np.testing.assert_allclose(
        delays(GripperOpening(0.060, 0.0, drift_s_per_throw=0.0001), 50), 0.060 + 0.0001 * np.arange(50), atol=1e-12
    )


def test_outputs_have_a_delay_of_their_own() -> None:
    cell = make_cell()
    timing = replace(truth_of(cell).timing, output_delay_s=0.004)
    driven = Driven(cell, truth=truth(cell, timing=timing))
    sent_at = driven.controller.timeline.t
    driven.set(**OPEN)
    driven.cycle(3)
    assert driven.controller.workcell.outputs.changes[0] == (pytest.approx(sent_at + 0.004), 1 << 16)


def throw(release: ReleaseSpeed, count: int = 1) -> list[float]:
    """Returns speed at the release over that of the tool centre point, of `count` throws of a steadily turning arm."""
    cell = make_cell()
    driven = Driven(cell, truth=truth(cell, release=release))
    ratios = []
    for turn in itertools.islice(itertools.cycle((0.5, -0.5)), count):
        driven.write(SPEEDJ, [turn, 0.0, 0.0, 0.0, 0.0, 0.0, 40.0, 0.002])
        driven.cycle(30)
        driven.set(**OPEN)
        driven.cycle(40)
        released = driven.controller.workcell.world.releases[-1]
        x, y, _ = released["position_m"]
        ratios.append(math.hypot(*released["velocity_m_s"]) / (0.5 * math.hypot(x, y)))
        driven.write(SPEEDJ, [0.0] * 6 + [40.0, 0.002])
        driven.set(**CLOSED)
        driven.cycle(60)
    return ratios


def test_the_object_leaves_at_its_share_of_the_tools_speed() -> None:
    assert throw(ReleaseSpeed(speed_factor=0.97)) == [pytest.approx(0.97, abs=1e-9)]


def test_a_share_of_throws_clings() -> None:
    ratios = throw(ReleaseSpeed(speed_factor=0.98, cling_share=0.4, cling_speed_factor=0.95), 40)
    clung = [r == pytest.approx(0.98 * 0.95, abs=1e-9) for r in ratios]
    free = [r == pytest.approx(0.98, abs=1e-9) for r in ratios]
    assert all(a or b for a, b in zip(clung, free, strict=True))
    assert 7 <= sum(clung) <= 25  # of 40 at 0.4: within three standard deviations


def test_drag_is_the_true_objects() -> None:
    cell = make_cell()
    world = World(cell, 0.0, truth(cell, drag_coefficient=0.47))
    world.release(1, 0.0, (0.0, 0.0, 1.0, 3.0, 1.0, 2.0), 0.0)
    for k in range(1, 1000):
        world.cycle(0.002 * k, 0.002)
    drag = drag_constant(cell.object.mass_kg, cell.object.radius_m, 0.47)
    expected = fly([0.0, 0.0, 1.0], [3.0, 1.0, 2.0], 0.0, 9.81, drag)
    assert expected is not None
    np.testing.assert_allclose(world.landings[0]["position_m"], expected.landing_point, atol=1e-6)


def test_the_true_base_is_moved_and_turned_against_the_cells() -> None:
    offset = (0.004, -0.003, 0.002)
    turn = (0.01, -0.02, 0.3)
    cell = make_cell(tables="base_in_world = { position_m = [0.3, 0.2, 0.1], rotation_vector_rad = [0.0, 0.1, 0.7] }\n")
    arm = ArmDeviation(base_offset_m=offset, base_rotation_vector_rad=turn)
    driven = Driven(cell, truth=truth(cell, arm=arm))
    driven.set(**OPEN)
    driven.cycle(60)
    X_WB = np.eye(4)
    X_WB[:3, :3] = rotation_vector_to_matrix(np.array(turn)) @ cell.X_WB[:3, :3]
    X_WB[:3, 3] = cell.X_WB[:3, 3] + offset
    expected = X_WB @ forward(cell.robot, np.array(driven.arm.q), cell.tool.X_FT)
    np.testing.assert_allclose(driven.controller.workcell.world.releases[0]["position_m"], expected[:3, 3], atol=1e-9)


def deviation(size: float, draw: np.random.Generator) -> DhDeviation:
    return DhDeviation(*(tuple(draw.normal(0.0, size, 6).tolist()) for _ in range(4)))


def forward_by_matrices(chain: KinematicChain, q: np.ndarray) -> np.ndarray:
    """Returns Rz(q + theta) Tz(d) Tx(a) Rx(alpha) of six joints, each written as a 4x4 matrix."""
    k = chain.table
    X = np.eye(4)
    for theta, a, d, alpha, angle in zip(k.theta, k.a, k.d, k.alpha, q, strict=True):
        about_z = np.eye(4)
        about_x = np.eye(4)
        about_z[:3, :3] = rotation_vector_to_matrix(np.array([0.0, 0.0, angle + theta]))
        about_x[:3, :3] = rotation_vector_to_matrix(np.array([alpha, 0.0, 0.0]))
        about_z[2, 3] = d
        about_x[0, 3] = a
        X = X @ about_z @ about_x
    return X


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_an_arm_of_its_own_moves_by_its_own_table(name: str) -> None:
    draw = np.random.default_rng(4)
    chain = KinematicChain(controller_table(robot(name), deviation(0.01, draw)))
    for q, qd in draw.uniform(-3.0, 3.0, (10, 2, 6)):
        pose, twist = chain.motion(q.tolist(), qd.tolist())
        np.testing.assert_allclose(np.reshape(pose, (3, 4)), forward_by_matrices(chain, q)[:3], atol=1e-12)
        J, _ = chain.jacobian(q.tolist())
        np.testing.assert_allclose(twist, J @ qd, atol=1e-11)
        h = 1e-6
        ahead, behind = (forward_by_matrices(chain, q + s * h * qd)[:3, 3] for s in (1.0, -1.0))
        np.testing.assert_allclose(twist[:3], (ahead - behind) / (2.0 * h), atol=1e-7)


def test_the_controller_tells_its_own_table_and_another_arm_has_other_checksums() -> None:
    published = controller_table(robot("ur5e"))
    assert not published.theta.any()
    np.testing.assert_allclose([published.a, published.d, published.alpha],
                               [robot("ur5e").a, robot("ur5e").d, robot("ur5e").alpha])  # fmt: skip
    change = DhDeviation(d_m=(0.0, 0.0, 0.0, 0.001, 0.0, 0.0))
    other = controller_table(robot("ur5e"), change)
    assert other.d[3] == published.d[3] + 0.001
    told = checksums(other)
    assert [a == b for a, b in zip(checksums(published), told, strict=True)] == [True] * 3 + [False] + [True] * 2
    assert all(0 <= checksum < 2**32 for checksum in told)


def test_the_controller_solves_poses_with_its_own_table() -> None:
    cell = make_cell()
    arm = ArmDeviation(dh_deviation=deviation(0.003, np.random.default_rng(2)))
    driven = Driven(cell, truth=truth(cell, arm=arm))
    context = driven.controller.context
    chain = driven.arm.chain
    far = [0.8, -1.2, 1.1, -1.3, -1.2, 0.4]
    goal = chain.forward(far, context.tcp)
    found = context.solve(pose_of(goal))
    assert found is not None
    assert max(map(abs, pose_error(goal, chain.forward(found, context.tcp)))) < 1e-9


def test_the_camera_errs_by_its_deviation_and_its_outliers() -> None:
    camera = ObservingCamera(CameraNoise(0.003, 0.1, 0.2), 3)
    landing = {"object": 1, "surface": "floor", "position_m": [1.0, -2.0, 0.1]}
    seen = np.array([camera.observe(landing)["position_m"] for _ in range(4000)]) - landing["position_m"]
    np.testing.assert_array_equal(seen[:, 2], 0.0)
    size = np.hypot(seen[:, 0], seen[:, 1])
    # both errors are Rayleigh: a share of outliers beyond 15 mm of 0.1 exp(-0.015^2 / (2 (0.2^2 + 0.003^2)))
    assert np.mean(size > 0.015) == pytest.approx(0.1, abs=0.015)
    np.testing.assert_allclose(seen[size < 0.015, :2].std(axis=0), 0.003, rtol=0.05)
    np.testing.assert_allclose(seen[size > 0.015, :2].std(axis=0), 0.2, rtol=0.12)
