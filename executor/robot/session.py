"""The session with one robot: cell, settings, live state and dashboard, shared by all executions of an executor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from executor.robot.dashboard import DashboardClient
from executor.robot.monitor import Monitor, RobotState
from executor.settings import ExecutorSettings
from planner.cell import Cell


@dataclass
class RobotSession:
    """Cell, settings and connections. Each thread needs a session of its own; they may share a monitor."""

    cell: Cell
    settings: ExecutorSettings
    monitor: Monitor
    dashboard: DashboardClient

    @classmethod
    def open(cls, cell: Cell, settings: ExecutorSettings, monitor: Monitor | None = None) -> RobotSession:
        """Returns a session with a dashboard of its own, and with `monitor` or a new one."""
        return cls(cell, settings, monitor or Monitor(cell.link.host), DashboardClient(cell.link.host))

    def remote_control(self) -> str | None:
        """Returns the dashboard's answer about remote control; None without an answer."""
        try:
            return self.dashboard.ask("is in remote control")
        except OSError:
            return None

    def close(self) -> None:
        """Closes the dashboard."""
        self.dashboard.close()


def robot_document(state: RobotState | None, refusals: list[str]) -> dict[str, Any]:
    """Returns the live state as `GET /cells/{name}/state` shows it; `refusals` are the reasons not to move."""
    if state is None:
        return {"connected": False, "refusals": refusals}
    return {
        "connected": True,
        "refusals": refusals,
        "timestamp_s": state.timestamp_s,
        "positions": list(state.q),
        "velocities": list(state.qd),
        "robot_mode": state.robot_mode,
        "safety_status_bits": state.safety_bits,
        "runtime_state": state.runtime_state,
        "speed_scaling": state.speed,
        "digital_output_bits": state.outputs,
        "payload_kg": state.payload_kg,
        "tcp_offset": None if state.tcp_offset is None else list(state.tcp_offset),
    }
