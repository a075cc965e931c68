"""The real-time loop: controller cycles on the grid of due times, sockets in between."""

from __future__ import annotations

import select
import time

from simulator.control_operations import control_operations
from simulator.faults import CONTROL_PORT_NAME
from simulator.interfaces import ControlServer, ServicePort
from simulator.settings import CONTROL_PORT
from simulator.simulation import Simulation


class SimulatorLoop:
    """Runs a simulation in real time, with its control port. Its clock slips where the machine stalls."""

    def __init__(self, simulation: Simulation) -> None:
        """Listens on the control port.

        Raises:
            OSError: the address is not available.
        """
        self.simulation = simulation
        self.running = True
        control = ControlServer(control_operations(simulation, self.quit))
        simulation.network.add(ServicePort(CONTROL_PORT_NAME, CONTROL_PORT, control))

    def quit(self) -> None:
        """Ends the loop after this turn."""
        self.running = False

    def run(self) -> None:
        """Runs until `quit`, then closes all sockets."""
        pacing = self.simulation.pacing
        simulation = self.simulation
        pacing.start(time.monotonic())
        try:
            while self.running:
                self._serve_until_due()
                pacing.cycle_begun(time.monotonic())
                simulation.tick()
                pacing.state_sent(time.monotonic())
                self._freeze()
        finally:
            simulation.network.close()

    def _serve_until_due(self) -> None:
        """Serves the sockets until the cycle is due; at least once, so that a late loop still serves its clients."""
        network = self.simulation.network
        pacing = self.simulation.pacing
        now = time.monotonic()
        while self.running:
            readable = select.select(network.sockets, (), (), pacing.sleep_s(now))[0]
            now = time.monotonic()
            for sock in readable:
                network.readable(sock)
            pacing.woke(now, self.simulation.controller.stream.awaits_answer)
            now = time.monotonic()
            if now >= pacing.due:
                return

    def _freeze(self) -> None:
        """Stands still if a fault requests it."""
        if self.simulation.freeze_s > 0.0:
            time.sleep(self.simulation.freeze_s)
            self.simulation.freeze_s = 0.0
            self.simulation.pacing.start(time.monotonic())
