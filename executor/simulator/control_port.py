"""The control port: one JSON object a line in, one a line out. Truth, counts and faults; no robot has it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from executor.simulator.connections import Connection
from executor.simulator.faults import BadRequest, Simulation, cause

LINE_MAX = 65536  # [bytes] a longer line is no request: the connection is closed
Document = dict[str, Any]


class ControlPort:
    """Answers requests {"op": ...}."""

    def __init__(
        self,
        simulation: Simulation,
        stats: Callable[[], Document],
        reset_stats: Callable[[], None],
        quit_loop: Callable[[], None],
    ) -> None:
        self.simulation = simulation
        self.reset_stats, self.quit_loop = reset_stats, quit_loop
        self.answers: dict[str, Callable[[Document], Document]] = {
            "state": lambda request: state(simulation),
            "world": lambda request: world(simulation, int(request.get("after", 0))),
            "stats": lambda request: stats(),
            "reset_stats": self._reset_stats,
            "events": lambda request: {"events": list(simulation.controller.events)},
            "fault": self._fault,
            "quit": self._quit,
        }

    def opened(self, connection: Connection) -> None:
        """The client speaks first."""

    def closed(self, connection: Connection) -> None:
        """Nothing is kept of a client."""

    def arrived(self, connection: Connection) -> None:
        """Answers every whole line."""
        while connection.open and b"\n" in connection.received:
            line, _, rest = bytes(connection.received).partition(b"\n")
            connection.received[:] = rest
            connection.send(json.dumps(self.answer(line)).encode() + b"\n", time.monotonic())
        if len(connection.received) > LINE_MAX:
            connection.open = False

    def answer(self, line: bytes) -> Document:
        """Returns the answer to one request: {"ok": true, ...} or {"ok": false, "error": text}."""
        try:
            request = json.loads(line)
            if not isinstance(request, dict) or str(request.get("op")) not in self.answers:
                raise BadRequest(f"op must be one of {', '.join(self.answers)}")
            return {"ok": True, **self.answers[request["op"]](request)}
        except (ValueError, TypeError, RecursionError, BadRequest) as error:
            return {"ok": False, "error": str(error)}

    def _reset_stats(self, request: Document) -> Document:
        self.reset_stats()
        return {}

    def _fault(self, request: Document) -> Document:
        parameters = {key: value for key, value in request.items() if key not in ("op", "name")}
        cause(self.simulation, request.get("name"), parameters)
        return {}

    def _quit(self, request: Document) -> Document:
        self.quit_loop()
        return {}


def state(simulation: Simulation) -> Document:
    """Returns the truth about the controller and its arm."""
    c = simulation.controller
    program = c.execution.program
    return {
        "t": c.t, "moved_at": c.moved_at, "cell": c.cell.name,
        "cell_sha256": c.cell.sha256, "polyscope": c.cell.sim.polyscope,
        "target_q": c.arm.q, "target_qd": c.arm.qd, "q": c.arm.true_q, "qd": c.arm.true_qd,
        "measured_q": c.arm.measured_q, "measured_qd": c.arm.measured_qd,
        "runtime_state": c.execution.runtime, "program": program.name if program else None,
        "threads": list(program.threads) if program else [],
        "safety_mode": c.safety.mode, "safety_bits": c.safety.bits, "safety_reason": c.safety.reason,
        "robot_mode": c.safety.robot_mode, "remote_control": c.execution.remote_control,
        "speed_slider": c.slider, "speed_scaling": c.speed_scaling,
        "digital_outputs": c.digital.bits, "output_changes": list(c.output_changes)[-20:],
        "gripper_open": c.gripper.open, "gripper_holds": c.gripper.holds, "gripper_stuck": c.gripper.stuck,
        "connections": [
            {"role": s.role, "packages_in": s.packages_in, "packages_out": s.packages_out, "skipped": s.skipped}
            for s in simulation.rtde.sessions.values()
        ],
    }  # fmt: skip


def world(simulation: Simulation, after: int) -> Document:
    """Returns releases and landings of objects numbered above `after`, and what is in the air."""
    w = simulation.controller.world
    return {
        "t": simulation.controller.t,
        "releases": [r for r in w.releases if r["object"] > after],
        "landings": [r for r in w.landings if r["object"] > after],
        "in_flight": [{"object": f.number, "position_m": f.state[:3], "velocity_m_s": f.state[3:]} for f in w.flights],
        "gripper_holds": simulation.controller.gripper.holds,
    }
