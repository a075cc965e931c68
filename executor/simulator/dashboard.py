"""The dashboard port: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series"; ur_rtde compares the answers word for word (rtde.md §9).
"""

from __future__ import annotations

import time
from collections.abc import Callable

from executor.simulator import safety
from executor.simulator.connections import Connection
from executor.simulator.controller import Controller
from executor.simulator.execution import PAUSED, PLAYING

GREETING = "Connected: Universal Robots Dashboard Server"
LINE_MAX = 65536  # [bytes] a longer line is no command: the connection is closed
LOCKED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)
LOCAL = "Command is not allowed due to safety reasons: the robot is not in remote control"
PROGRAM_STATES = {PLAYING: "PLAYING", PAUSED: "PAUSED"}
REMOTE_ONLY = frozenset({"play", "stop", "pause", "power on", "power off", "brake release", "unlock protective stop",
                         "restart safety", "shutdown", "load"})  # fmt: skip
REMOTE_SINCE = (5, 6)  # source: dashboard manual, "is in remote control"


class Dashboard:
    """Answers the dashboard's commands."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": self._polyscope,
            "get serial number": lambda: controller.settings.serial_number,
            "get robot model": lambda: controller.cell.robot.name.upper().rstrip("E"),
            "is in remote control": lambda: str(controller.execution.remote_control).lower(),
            "robotmode": lambda: f"Robotmode: {safety.ROBOT_MODE_NAMES[controller.safety.robot_mode]}",
            "safetymode": lambda: f"Safetymode: {safety.MODE_NAMES[controller.safety.mode]}",
            "safetystatus": lambda: f"Safetystatus: {safety.MODE_NAMES[controller.safety.mode]}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(controller.execution.playing).lower()}",
            "get loaded program": lambda: "No program loaded",
            "isprogramsaved": lambda: "True",
            "get operational mode": lambda: "NONE",
            "play": self._play,
            "stop": self._stop,
            "pause": self._pause,
            "power on": self._power_on,
            "power off": self._power_off,
            "brake release": self._brake_release,
            "unlock protective stop": self._unlock,
            "restart safety": self._restart_safety,
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "shutdown": lambda: "Shutting down",
            "quit": lambda: "Disconnected",
        }
        self.with_argument: dict[str, Callable[[str], str]] = {
            "popup": lambda text: "showing popup",
            "addtolog": lambda text: "Added log message",
            "setuserrole": lambda text: f"Setting user role: {text}",
            "load": lambda text: f"File not found: {text}",
        }

    def opened(self, connection: Connection) -> None:
        """Greets."""
        connection.send(f"{GREETING}\n".encode(), time.monotonic())

    def closed(self, connection: Connection) -> None:
        """Nothing is kept of a client."""

    def arrived(self, connection: Connection) -> None:
        """Answers every whole line."""
        while connection.open and b"\n" in connection.received:
            line, _, rest = bytes(connection.received).partition(b"\n")
            connection.received[:] = rest
            text = line.decode("ascii", "replace").strip()
            connection.send(f"{self.answer(text)}\n".encode("ascii", "replace"), time.monotonic())
            if text.lower() in ("quit", "shutdown"):
                connection.flush()
                connection.open = False
        if len(connection.received) > LINE_MAX:
            connection.open = False

    def answer(self, line: str) -> str:
        """Returns the answer to one command line."""
        command = line.lower()
        word, _, rest = line.partition(" ")
        if not self.controller.execution.remote_control and (command in REMOTE_ONLY or word.lower() in REMOTE_ONLY):
            return LOCAL
        if command in self.answers:
            return self.answers[command]()
        if word.lower() in self.with_argument:
            return self.with_argument[word.lower()](rest)
        return f"could not understand: '{line}'"

    def _polyscope(self) -> str:
        major, minor, bugfix = self.controller.version
        return f"URSoftware {major}.{minor}.{bugfix}.{self.controller.settings.build} (Jan 01 2024)"

    def _program_state(self) -> str:
        execution = self.controller.execution
        name = execution.program.name if execution.program else "No program"
        return f"{PROGRAM_STATES.get(execution.runtime, 'STOPPED')} {name}"

    def _play(self) -> str:
        return "Starting program" if self.controller.execution.resume() else "Failed to execute: play"

    def _stop(self) -> str:
        self.controller.execution.stop("dashboard: stop")
        return "Stopped"

    def _pause(self) -> str:
        return "Pausing program" if self.controller.execution.pause() else "Failed to execute: pause"

    def _power_on(self) -> str:
        if not self.controller.safety.stopped and self.controller.safety.robot_mode < safety.ROBOT_IDLE:
            self.controller.safety.robot_mode = safety.ROBOT_IDLE
        return "Powering on"

    def _brake_release(self) -> str:
        if not self.controller.safety.stopped and self.controller.safety.robot_mode == safety.ROBOT_IDLE:
            self.controller.safety.robot_mode = safety.ROBOT_RUNNING
        return "Brake releasing"

    def _power_off(self) -> str:
        self.controller.stops.power_loss()
        return "Powering off"

    def _unlock(self) -> str:
        state = self.controller.safety
        if state.mode == safety.MODE_PROTECTIVE_STOP:
            if self.controller.t - state.stopped_at < self.controller.settings.protective_stop_lock_s:
                return LOCKED
            state.clear()
        return "Protective stop releasing"

    def _restart_safety(self) -> str:
        self.controller.stops.power_loss()
        self.controller.safety.clear()
        return "Restarting safety"
