"""What the daemon tells the store about its robot while it lives: the live state and one telemetry row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.monitor import RobotState
from executor.telemetry import Telemetry


def robot_document(state: RobotState | None, reasons: list[str]) -> dict[str, Any]:
    """Returns the live state for `GET /cells/{name}/state`; `refusals` says in words what stands in the way."""
    if state is None:
        return {"connected": False, "refusals": reasons}
    return {
        "connected": True, "refusals": reasons, "timestamp_s": state.timestamp_s,
        "positions": list(state.q), "velocities": list(state.qd), "robot_mode": state.robot_mode,
        "safety_status_bits": state.safety_bits, "runtime_state": state.runtime_state, "speed_scaling": state.speed,
        "digital_output_bits": state.outputs, "payload_kg": state.payload_kg,
        "tcp_offset": None if state.tcp_offset is None else list(state.tcp_offset),
    }  # fmt: skip


def row_document(row: NDArray[np.float64]) -> dict[str, Any]:
    """Returns one row of telemetry for the events of an execution."""
    telemetry = Telemetry(row[None])
    return {
        "clock_s": float(telemetry.scalar("clock_s")[0]),
        "positions": telemetry.vector("q")[0].tolist(), "velocities": telemetry.vector("qd")[0].tolist(),
        "planned_positions": telemetry.vector("planned_q")[0].tolist(),
        "planned_velocities": telemetry.vector("planned_qd")[0].tolist(),
        "missed_ticks": int(telemetry.scalar("missed_ticks")[0]),
    }  # fmt: skip
