"""The station: one cell, its settings, and the daemon's own eyes and line to the controller."""

from __future__ import annotations

from dataclasses import dataclass

from executor.dashboard import Dashboard
from executor.monitor import Monitor
from executor.preflight import refusals
from executor.settings import Settings
from planner.cell import Cell


@dataclass
class Station:
    """What all executions of one executor share; the dashboard is one thread's own."""

    cell: Cell
    settings: Settings
    monitor: Monitor
    dashboard: Dashboard

    @classmethod
    def of(cls, cell: Cell, settings: Settings, monitor: Monitor | None = None) -> Station:
        """Returns a station with a dashboard of its own; monitors may be shared."""
        return cls(cell, settings, monitor or Monitor(cell.link.host), Dashboard(cell.link.host))

    def remote(self) -> str | None:
        """Returns what the dashboard says about remote control; None where it does not answer."""
        try:
            return self.dashboard.ask("is in remote control")
        except OSError:
            return None

    def refusals(self) -> list[str]:
        """Returns every reason not to move now, in words."""
        return refusals(self.cell, self.monitor.fresh(), self.remote())

    def close(self) -> None:
        """Closes the dashboard."""
        self.dashboard.close()
