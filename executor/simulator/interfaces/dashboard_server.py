"""The dashboard port: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series"; ur_rtde compares the answers word for word (rtde.md §9).
"""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.interfaces.connections import Connection, ConnectionHandler
from executor.simulator.program import PAUSED, PLAYING, ProgramRunner, Stops
from executor.simulator.settings import ControllerIdentity

GREETING = "Connected: Universal Robots Dashboard Server"
LOCKED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)
LOCAL = "Command is not allowed due to safety reasons: the robot is not in remote control"
PROGRAM_STATES = {PLAYING: "PLAYING", PAUSED: "PAUSED"}
_POWER = {"power on", "power off", "brake release", "unlock protective stop", "restart safety", "shutdown"}
REMOTE_ONLY = frozenset({"play", "stop", "pause", "load", *_POWER})


class DashboardServer(ConnectionHandler):
    """Answers the dashboard's commands from safety state and program; no arm is needed."""

    def __init__(self, identity: ControllerIdentity, runner: ProgramRunner, stops: Stops) -> None:
        self.identity, self.runner, self.stops, self.safety = identity, runner, stops, stops.safety
        self.answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": self._polyscope,
            "get serial number": lambda: identity.serial_number,
            "get robot model": lambda: identity.model,
            "is in remote control": lambda: str(runner.remote_control).lower(),
            "robotmode": lambda: f"Robotmode: {self.safety.robot_mode_name}",
            "safetymode": lambda: f"Safetymode: {self.safety.mode_name}",
            "safetystatus": lambda: f"Safetystatus: {self.safety.mode_name}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(runner.playing).lower()}",
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
        """Greets the client."""
        connection.send(f"{GREETING}\n".encode())

    def arrived(self, connection: Connection) -> None:
        """Answers every complete line."""
        for line in connection.take_lines():
            text = line.decode("ascii", "replace").strip()
            connection.send(f"{self.answer(text)}\n".encode("ascii", "replace"))
            if text.lower() in ("quit", "shutdown"):
                connection.flush()
                connection.open = False

    def answer(self, line: str) -> str:
        """Returns the answer to one command line."""
        command = line.lower()
        word, _, rest = line.partition(" ")
        if not self.runner.remote_control and (command in REMOTE_ONLY or word.lower() in REMOTE_ONLY):
            return LOCAL
        if command in self.answers:
            return self.answers[command]()
        if word.lower() in self.with_argument:
            return self.with_argument[word.lower()](rest)
        return f"could not understand: '{line}'"

    def _polyscope(self) -> str:
        major, minor, bugfix = self.identity.version
        return f"URSoftware {major}.{minor}.{bugfix}.{self.identity.build} (Jan 01 2024)"

    def _program_state(self) -> str:
        name = self.runner.program.name if self.runner.program else "No program"
        return f"{PROGRAM_STATES.get(self.runner.runtime, 'STOPPED')} {name}"

    def _play(self) -> str:
        return "Starting program" if self.runner.resume() else "Failed to execute: play"

    def _stop(self) -> str:
        self.runner.stop("dashboard: stop")
        return "Stopped"

    def _pause(self) -> str:
        return "Pausing program" if self.runner.pause() else "Failed to execute: pause"

    def _power_on(self) -> str:
        self.safety.power_on()
        return "Powering on"

    def _brake_release(self) -> str:
        self.safety.release_brakes()
        return "Brake releasing"

    def _power_off(self) -> str:
        self.stops.power_loss()
        return "Powering off"

    def _unlock(self) -> str:
        return "Protective stop releasing" if self.stops.unlock() else LOCKED

    def _restart_safety(self) -> str:
        self.stops.restart_safety()
        return "Restarting safety"
