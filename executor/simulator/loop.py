"""The loop: controller cycles on an absolute grid, sockets in between."""

from __future__ import annotations

import select
import time
from typing import Any

from executor.simulator.connections import Network, Port
from executor.simulator.control_port import ControlPort
from executor.simulator.controller import Controller
from executor.simulator.dashboard import Dashboard
from executor.simulator.faults import CONTROL_PORT_NAME
from executor.simulator.published import Published
from executor.simulator.rtde_server import RtdeServer
from executor.simulator.script_port import ScriptPort
from executor.simulator.settings import CONTROL_PORT, DASHBOARD_PORT, RTDE_PORT, SCRIPT_PORT, Settings
from executor.simulator.statistics import Lateness
from planner.cell import Cell

CATCH_UP_S = 0.1  # [s] a loop later than this drops the lost cycles instead of running them one after another
ANSWER_SHARE = 0.5  # [-] of a cycle: a state told later than this before the next cycle leaves a client no time


class Simulator:
    """A controller on its network address.

    A late tick is run at once, and those it has delayed right behind it, so that controller time keeps to the clock.
    After a loss of more than CATCH_UP_S the lost cycles are skipped and counted: controller time then stands behind.
    """

    def __init__(self, cell: Cell, settings: Settings, host: str) -> None:
        self.controller = Controller(cell, settings)
        self.published = Published(self.controller)
        self.rtde = RtdeServer(self.controller)
        self.lateness = Lateness()
        self.freeze_s = self.told_at = 0.0
        self.running = True
        control = ControlPort(self, self.stats, self.reset_stats, self.quit)
        services = [
            ("rtde", RTDE_PORT, self.rtde), ("script", SCRIPT_PORT, ScriptPort(self.controller)),
            ("dashboard", DASHBOARD_PORT, Dashboard(self.controller)), (CONTROL_PORT_NAME, CONTROL_PORT, control),
        ]  # fmt: skip
        self.network = Network(host, [Port(n, p, s.opened, s.arrived, s.closed) for n, p, s in services])

    def quit(self) -> None:
        """Ends the loop after this turn."""
        self.running = False

    def run(self) -> None:
        """Runs until `quit`, and closes everything."""
        dt = self.controller.dt
        due = time.monotonic() + dt
        try:
            while self.running:
                self._serve_until(due)
                now = time.monotonic()
                self.lateness.add(now - due)
                self.controller.commands.answerable = now - self.told_at >= ANSWER_SHARE * dt
                self._tick(now)
                self.told_at = time.monotonic()
                due = self._freeze() or due + dt
                lost = int((time.monotonic() - due) / dt)
                if lost * dt > CATCH_UP_S:
                    self.lateness.skipped += lost
                    due += lost * dt
        finally:
            self.network.close()

    def _serve_until(self, due: float) -> None:
        """Serves the sockets until the tick is due; once at least, so that a loop that is behind hears its clients."""
        network, now = self.network, time.monotonic()
        while self.running:
            for sock in select.select(network.sockets, (), (), max(due - now, 0.0))[0]:
                network.readable(sock, now)
            now = time.monotonic()
            if now >= due:
                return

    def _tick(self, now: float) -> None:
        self.controller.cycle()
        self.published.cycle()
        self.rtde.publish(now)
        self.network.tick(now)
        if self.controller.cycles % self.published.torque_every == 0:
            self.published.torques()

    def _freeze(self) -> float | None:
        """Stands still where a fault asks for it; returns when the next tick is due."""
        if self.freeze_s <= 0.0:
            return None
        time.sleep(self.freeze_s)
        self.freeze_s = 0.0
        return time.monotonic() + self.controller.dt

    def stats(self) -> dict[str, Any]:
        """Returns the counts for the control port."""
        return {
            "t": self.controller.t, "cycle_s": self.controller.dt,
            "commands_per_cycle": self.controller.commands.as_document(),
            "lateness": self.lateness.as_document(), "malformed_packages": self.rtde.malformed,
            "cpu_s": time.process_time(),
        }  # fmt: skip

    def reset_stats(self) -> None:
        """Starts all counts anew."""
        self.controller.commands.reset()
        self.lateness.reset()
        self.rtde.malformed = 0
