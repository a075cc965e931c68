"""Pose and twist of a cell's tool centre point in the world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.cell import Cell
from planner.kinematics import forward, jacobian


class ToolState(NamedTuple):
    """Pose and twist of the tool centre point in the world.

    Attributes:
        X_WT: pose (..., 4, 4).
        V_WT: twist (..., 6), linear [m/s], then angular [rad/s].
    """

    X_WT: Array
    V_WT: Array

    @property
    def p_WT(self) -> Array:
        """Position (..., 3) [m]."""
        return self.X_WT[..., :3, 3]

    @property
    def v_WT(self) -> Array:
        """Linear velocity (..., 3) [m/s]."""
        return self.V_WT[..., :3]


def tool_pose(cell: Cell, q: Array) -> Array:
    """Returns the tool pose X_WT (..., 4, 4) at joint positions `q` (..., 6) [rad]."""
    return cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)


def tool_state(cell: Cell, q: Array, qd: Array) -> ToolState:
    """Returns pose and twist of the tool at joint states `q` [rad], `qd` [rad/s], both (..., 6)."""
    V_BT = np.einsum("...ij,...j->...i", jacobian(cell.robot, q, cell.tool.X_FT), qd)
    R_BW = cell.X_WB[:3, :3].T
    return ToolState(tool_pose(cell, q), np.concatenate([V_BT[..., :3] @ R_BW, V_BT[..., 3:] @ R_BW], axis=-1))
