"""Timing of the arm in one run, and how far the arm was from the planned path."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.records.telemetry import Telemetry
from learning import MotionRecording, RecordingError, estimate_timing, lag_change
from planner.arrays import Array
from planner.cell import Cell
from planner.kinematics import forward
from planner.trajectory import columns_at


def arm_timing(cell: Cell, telemetry: Telemetry, mode: str, acceleration: float) -> dict[str, Any] | None:
    """Returns the timing that a run shows; None where too little moved.

    Args:
        cell: with the lag that the run was streamed with.
        telemetry: of the run.
        mode: "speedj", "servoj" or "script"; servoj is sent positions, so the planned velocity stands for its command.
        acceleration: argument of the speedj commands [rad/s^2].
    """
    if not len(telemetry):
        return None
    stamps = telemetry.scalar("timestamp_s")
    lag = cell.timing.lag_s
    command = telemetry.vector("planned_qd" if mode == "servoj" else "command")
    if mode == "servoj":  # a planned row is what should be measured, one lag after its command
        command = columns_at(stamps + lag, stamps, command)
    try:
        found = estimate_timing(MotionRecording(stamps, command, telemetry.vector("qd")), acceleration)
    except (RecordingError, np.linalg.LinAlgError):  # a run that shows no timing has an outcome all the same
        return None
    return {
        **found.as_document(),
        "mode": mode,
        "assumed_lag_s": lag,
        "lag_change_s": lag_change(found.lag_s, found.lag_std_s, lag),
    }


def path_error_m(cell: Cell, telemetry: Telemetry, p_BT: Array, late_s: float) -> float:
    """Returns the largest distance of the tool centre point from where it was planned `late_s` before [m].

    An arm that is late, or early, stays on the certified path; this is how far it left it.

    Args:
        cell: of the run.
        telemetry: of the run; not empty.
        p_BT: measured positions of the tool centre point (N, 3), of `tool_points` [m].
        late_s: by how much the arm is late [s].
    """
    clock = telemetry.scalar("clock_s")
    planned = telemetry.vector("planned_q")
    shifted = columns_at(clock - late_s, clock, planned)
    return float(np.linalg.norm(p_BT - tool_points(cell, shifted), axis=1).max())


def tool_points(cell: Cell, q: Array) -> Array:
    """Returns the tool centre point in joint positions (N, 6), (N, 3), in the arm's base [m]."""
    return forward(cell.robot, q, cell.tool.X_FT)[:, :3, 3]
