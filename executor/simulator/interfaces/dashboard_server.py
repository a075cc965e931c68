"""The dashboard port: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series"; ur_rtde 1.6.5 compares some answers word for word.
"""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.interfaces.connections import Connection, ConnectionHandler
from executor.simulator.program import PAUSED, PLAYING, Stops
from executor.simulator.settings import ControllerIdentity

GREETING = "Connected: Universal Robots Dashboard Server"
LOCKED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
)
LOCAL = "Command is not allowed due to safety reasons: the robot is not in remote control"
SAFETY_MODES = {1: "NORMAL", 3: "PROTECTIVE_STOP", 5: "SAFEGUARD_STOP", 7: "ROBOT_EMERGENCY_STOP"}
ROBOT_MODES = {3: "POWER_OFF", 5: "IDLE", 7: "RUNNING"}
PROGRAM_STATES = {PLAYING: "PLAYING", PAUSED: "PAUSED"}
_POWER = {"power on", "power off", "brake release", "unlock protective stop", "restart safety", "shutdown"}
REMOTE_ONLY = frozenset({"play", "stop", "pause", "load", *_POWER})


class DashboardServer(ConnectionHandler):
    """Answers the dashboard's commands from safety state and program; no arm is needed."""

    def __init__(self, identity: ControllerIdentity, stops: Stops) -> None:
        runner, safety = stops.runner, stops.safety
        self.identity, self.runner = identity, runner
        self.answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": self._polyscope,
            "get serial number": lambda: identity.serial_number,
            "get robot model": lambda: identity.model,
            "is in remote control": lambda: str(runner.remote_control).lower(),
            "robotmode": lambda: f"Robotmode: {ROBOT_MODES[safety.robot_mode]}",
            "safetymode": lambda: f"Safetymode: {SAFETY_MODES[safety.mode]}",
            "safetystatus": lambda: f"Safetystatus: {SAFETY_MODES[safety.mode]}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(runner.playing).lower()}",
            "get loaded program": lambda: "No program loaded",
            "isprogramsaved": lambda: "True",
            "get operational mode": lambda: "NONE",
            "play": lambda: "Starting program" if runner.resume() else "Failed to execute: play",
            "stop": after(lambda: runner.stop("dashboard: stop"), "Stopped"),
            "pause": lambda: "Pausing program" if runner.pause() else "Failed to execute: pause",
            "power on": after(safety.power_on, "Powering on"),
            "power off": after(stops.power_loss, "Powering off"),
            "brake release": after(safety.release_brakes, "Brake releasing"),
            "unlock protective stop": lambda: "Protective stop releasing" if stops.unlock() else LOCKED,
            "restart safety": after(stops.restart_safety, "Restarting safety"),
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


def after(action: Callable[[], object], answer: str) -> Callable[[], str]:
    """Returns a function that carries out an action and returns the answer."""

    def act() -> str:
        action()
        return answer

    return act
