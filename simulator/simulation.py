"""The simulation: a controller with its services on the network, advanced tick by tick."""

from __future__ import annotations

import socket
import time
from typing import Any

from planner.cell import Cell
from simulator.client_interfaces import ClientInterfaces
from simulator.clock import CyclePacing, LatenessHistogram, SlipCounts
from simulator.controller import Controller
from simulator.grippers import gripper_ports
from simulator.interfaces import (
    CameraServer,
    DashboardServer,
    InterpreterServer,
    Network,
    RobotApiServer,
    RobotFacts,
    RtdeServer,
    ServicePort,
)
from simulator.output_values import OutputValues
from simulator.physics import told_checksums
from simulator.settings import (
    CAMERA_PORT,
    DASHBOARD_PORT,
    INTERPRETER_PORT,
    POLYSCOPE_X_MAJOR,
    ROBOT_API_PORT,
    ROBOT_API_SINCE,
    ROBOT_API_SPARE_PORT,
    RTDE_PORT,
    SimulatorSettings,
)
from simulator.truth import Truth

CB3_GENERATION = 3  # major version of its software


class Simulation:
    """All parts of one simulated controller, on the ports that a real one has.

    Attributes:
        freeze_s: fault: time for which controller and world are about to stand still [s].
    """

    def __init__(self, cell: Cell, settings: SimulatorSettings, host: str, truth: Truth | None = None) -> None:
        """Listens on `host`.

        Raises:
            OSError: an address is not available.
        """
        self.controller = c = Controller(cell, settings, truth)
        self.output_values = OutputValues(c)
        self.pacing = CyclePacing(c.timeline.dt, settings.stall_tolerant)
        self.freeze_s = 0.0
        values = self.output_values.values
        derived = self.output_values.derived
        self.rtde = RtdeServer(c.identity, c.timeline, values, c.take_inputs, derived)
        table = c.arm.chain.table
        facts = RobotFacts(cell.robot, table, told_checksums(cell.robot, table))
        self.client_interfaces = ClientInterfaces(c, values, derived, facts)
        self.network = Network(host)
        self.network.add(ServicePort("rtde", RTDE_PORT, self.rtde), *self.client_interfaces.ports)
        self.network.add(*gripper_ports(cell.gripper, c.workcell.gripper, host))
        if c.workcell.feeder is not None:
            self.network.add(ServicePort("camera", CAMERA_PORT, CameraServer(c.look_at_feeder)))
        if c.identity.version[0] < POLYSCOPE_X_MAJOR:
            dashboard = DashboardServer(c.identity, c.stops, settings.programs)
            self.network.add(ServicePort("dashboard", DASHBOARD_PORT, dashboard))
        elif c.identity.version >= ROBOT_API_SINCE:
            robot_api = RobotApiServer(c.identity, c.stops, settings.programs)
            self.network.add(ServicePort("robot_api", robot_api_port(host), robot_api))
        if c.identity.version[0] > CB3_GENERATION:
            server = InterpreterServer(c.context.interpreter)
            self.network.add(ServicePort("interpreter", INTERPRETER_PORT, server))

    def tick(self) -> None:
        """Runs one controller cycle and sends its state."""
        self.controller.cycle()
        self.output_values.cycle()
        self.rtde.publish()
        self.client_interfaces.publish()
        self.network.tick()
        if self.controller.timeline.cycles % self.output_values.torque_every == 0:
            self.output_values.torques()

    def stats(self) -> dict[str, Any]:
        """Returns the counts of a client's commands and of this process's timing."""
        timeline = self.controller.timeline
        return {
            "t": timeline.t,
            "cycle_s": timeline.dt,
            "commands_per_cycle": dict(self.controller.stream.counts),
            "lateness": self.pacing.lateness.as_document(),
            "slips": dict(vars(self.pacing.slips)),
            "malformed_packages": self.rtde.malformed,
            "cpu_s": time.process_time(),
        }

    def reset_stats(self) -> None:
        """Restarts all counts."""
        self.controller.stream.reset()
        self.pacing.lateness, self.pacing.slips = LatenessHistogram(), SlipCounts()
        self.rtde.malformed = 0


def robot_api_port(host: str) -> int:
    """Returns the port on which this process can offer the Robot API: that of a robot, else the spare one."""
    try:
        socket.create_server((host, ROBOT_API_PORT)).close()
    except OSError:
        return ROBOT_API_SPARE_PORT
    return ROBOT_API_PORT
