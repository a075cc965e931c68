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
from executor.simulator.pace import Pace
from executor.simulator.published import Published
from executor.simulator.rtde_server import RtdeServer
from executor.simulator.script_port import ScriptPort
from executor.simulator.settings import CONTROL_PORT, DASHBOARD_PORT, RTDE_PORT, SCRIPT_PORT, Settings
from planner.cell import Cell


class Simulator:
    """A controller on its network address. Its clock stands still where this machine does, see `pace`."""

    def __init__(self, cell: Cell, settings: Settings, host: str) -> None:
        self.controller = Controller(cell, settings)
        self.published = Published(self.controller)
        self.rtde = RtdeServer(self.controller)
        self.pace = Pace(self.controller.dt)
        self.freeze_s = 0.0
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
        pace = self.pace
        pace.start(time.monotonic())
        try:
            while self.running:
                self._serve_until_due()
                now = time.monotonic()
                pace.begins(now)
                self._tick(now)
                pace.told(time.monotonic())
                self._freeze()
        finally:
            self.network.close()

    def _serve_until_due(self) -> None:
        """Serves the sockets until the tick is due; once at least, so that a loop that is behind hears its clients."""
        network, pace, now = self.network, self.pace, time.monotonic()
        while self.running:
            readable = select.select(network.sockets, (), (), pace.rest(now))[0]
            now = time.monotonic()
            for sock in readable:
                network.readable(sock, now)
            pace.woke(now, self.controller.commands.awaits_answer)
            now = time.monotonic()
            if now >= pace.due:
                return

    def _tick(self, now: float) -> None:
        self.controller.cycle()
        self.published.cycle()
        self.rtde.publish(now)
        self.network.tick(now)
        if self.controller.cycles % self.published.torque_every == 0:
            self.published.torques()

    def _freeze(self) -> None:
        """Stands still where a fault asks for it."""
        if self.freeze_s > 0.0:
            time.sleep(self.freeze_s)
            self.freeze_s = 0.0
            self.pace.start(time.monotonic())

    def stats(self) -> dict[str, Any]:
        """Returns the counts for the control port."""
        return {
            "t": self.controller.t, "cycle_s": self.controller.dt,
            "commands_per_cycle": self.controller.commands.as_document(),
            "lateness": self.pace.lateness.as_document(), "slips": self.pace.slips.as_document(),
            "malformed_packages": self.rtde.malformed,
            "cpu_s": time.process_time(),
        }  # fmt: skip

    def reset_stats(self) -> None:
        """Starts all counts anew."""
        self.controller.commands.reset()
        self.pace.lateness.reset()
        self.pace.slips.reset()
        self.rtde.malformed = 0
