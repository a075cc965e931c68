"""The tool's pose and twist in the world: against link poses, and against central differences of the pose."""

from dataclasses import replace

import numpy as np

from planner.geometry import tool_pose, tool_state
from planner.kinematics import link_poses
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix
from tests.planner.problems import cell

STEP_S = 1e-6  # of the central differences: truncation and rounding both near 1e-10


def turned_cell():
    return replace(cell(), X_WB=pose([0.3, -0.2, 0.5], rotation_vector_to_matrix([0.4, -1.1, 2.0])))


def test_the_tool_pose_is_that_of_the_flange_in_the_world_times_the_tool():
    here = turned_cell()
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (4, 5, 6))
    X_WF = link_poses(here.robot, q, here.X_WB)[..., 6, :, :]
    np.testing.assert_allclose(tool_pose(here, q), X_WF @ here.tool.X_FT, atol=1e-12)


def test_the_tool_twist_is_the_rate_of_its_pose():
    here = turned_cell()
    rng = np.random.default_rng(5)
    q, qd = rng.uniform(-2.0, 2.0, (2, 20, 6))
    state = tool_state(here, q, qd)
    before = tool_pose(here, q - STEP_S * qd)
    after = tool_pose(here, q + STEP_S * qd)
    turn = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], 1, 2)
    np.testing.assert_array_equal(state.p_WT, tool_pose(here, q)[:, :3, 3])
    np.testing.assert_allclose(state.v_WT, (after - before)[:, :3, 3] / (2 * STEP_S), atol=1e-8)
    np.testing.assert_allclose(state.V_WT[:, 3:], matrix_to_rotation_vector(turn) / (2 * STEP_S), atol=1e-8)
