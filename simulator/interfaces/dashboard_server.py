"""The dashboard port: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series"; ur_rtde 1.6.5 compares some answers word for word.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.interfaces.stored_programs import StoredPrograms
from simulator.program import PAUSED, PLAYING, Stops, messages
from simulator.settings import ControllerIdentity

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
INSTALLATION = "default.installation"  # the only one there is
OPERATIONAL_MODES = ("MANUAL", "AUTOMATIC")
NO_MODE = "NONE"
USER_ROLES = ("PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED")
CB3_ONLY = frozenset({"getuserrole", "setuserrole"})
E_SERIES_ONLY = frozenset(
    {"safetystatus", "is in remote control", "get operational mode", "clear operational mode", "set operational mode"}
)


class DashboardServer(ConnectionHandler):
    """Answers the dashboard's commands from safety state and program; no arm is needed."""

    def __init__(self, identity: ControllerIdentity, stops: Stops, programs: Path | None = None) -> None:
        """`programs` is the folder of the programs that can be loaded; None: there are none."""
        self.identity = identity
        self.runner = stops.runner
        self.safety = stops.safety
        self.stops = stops
        self.programs = StoredPrograms(programs)
        self.operational_mode = NO_MODE
        self.user_role = "NONE"
        self.reports = 0
        self.answers = self._questions() | self._actions()
        self.with_argument: dict[str, Callable[[str], str]] = {
            "load installation": self._load_installation,
            "load": self._load,
            "popup": self._popup,
            "addtolog": self._add_to_log,
            "setuserrole": self._set_user_role,
            "set operational mode": self._set_operational_mode,
            "generate flight report": lambda kind: self._report("Flight Report generated with id: {}"),
            "generate support file": self._support_file,
        }
        absent = CB3_ONLY if identity.version[0] > 3 else E_SERIES_ONLY
        for command in absent & (self.answers.keys() | self.with_argument.keys()):
            self.answers.pop(command, None)
            self.with_argument.pop(command, None)

    def _questions(self) -> dict[str, Callable[[], str]]:
        identity = self.identity
        runner = self.runner
        safety = self.safety
        return {
            "polyscopeversion": self._polyscope,
            "version": lambda: ".".join(map(str, (*identity.version, identity.build))),
            "get serial number": lambda: identity.serial_number,
            "get robot model": lambda: identity.model,
            "is in remote control": lambda: str(runner.in_remote_control).lower(),
            "robotmode": lambda: f"Robotmode: {ROBOT_MODES[safety.robot_mode]}",
            "safetymode": lambda: f"Safetymode: {SAFETY_MODES[safety.mode]}",
            "safetystatus": lambda: f"Safetystatus: {SAFETY_MODES[safety.mode]}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(runner.playing).lower()}",
            "get loaded program": self._loaded,
            "isprogramsaved": lambda: f"true {self.programs.name}" if self.programs.name else "True",
            "get operational mode": lambda: self.operational_mode,
            "getuserrole": lambda: self.user_role,
        }

    def _actions(self) -> dict[str, Callable[[], str]]:
        runner = self.runner
        stops = self.stops
        safety = self.safety
        return {
            "play": self._play,
            "stop": after(lambda: runner.stop("dashboard: stop"), "Stopped"),
            "pause": lambda: "Pausing program" if runner.pause() else "Failed to execute: pause",
            "power on": after(safety.power_on, "Powering on"),
            "power off": after(stops.power_loss, "Powering off"),
            "brake release": after(safety.release_brakes, "Brake releasing"),
            "unlock protective stop": lambda: "Protective stop releasing" if stops.unlock() else LOCKED,
            "restart safety": after(stops.restart_safety, "Restarting safety"),
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "clear operational mode": self._clear_operational_mode,
            "savelog": lambda: "Log saved to disk",
            "shutdown": lambda: "Shutting down",
            "quit": lambda: "Disconnected",
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
        if not self.runner.remote_control and (command in REMOTE_ONLY or command.partition(" ")[0] in REMOTE_ONLY):
            return LOCAL
        if command in self.answers:
            return self.answers[command]()
        for name, function in self.with_argument.items():
            if command == name or command.startswith(f"{name} "):
                return function(line[len(name) :].strip())
        return f"could not understand: '{line}'"

    def _polyscope(self) -> str:
        major, minor, bugfix = self.identity.version
        return f"URSoftware {major}.{minor}.{bugfix}.{self.identity.build} (Jan 01 2024)"

    # -- programs
    def _program_state(self) -> str:
        name = self.programs.name or (self.runner.program.name if self.runner.program else "No program")
        return f"{PROGRAM_STATES.get(self.runner.runtime, 'STOPPED')} {name}"

    def _loaded(self) -> str:
        return f"Loaded program: {self.programs.loaded}" if self.programs.loaded else "No program loaded"

    def _load(self, path: str) -> str:
        if not self.programs.load(path):
            return f"File not found: {path}"
        self.runner.stop(f"dashboard: load {path}")
        return f"Loading program: {path}"

    def _play(self) -> str:
        if self.runner.resume():
            return "Starting program"
        if not self.programs.text or not self.safety.may_move or self.runner.program is not None:
            return "Failed to execute: play"
        self.runner.upload(self.programs.text)
        return "Starting program"

    def _load_installation(self, name: str) -> str:
        return f"Loading installation: {name}" if name == INSTALLATION else f"File not found: {name}"

    # -- messages, modes, reports
    def _popup(self, text: str) -> str:
        self.runner.board.post(messages.Popup("Popup", text, False, False, False))
        return "showing popup"

    def _add_to_log(self, text: str) -> str:
        self.runner.timeline.note(f"log: {text}")
        return "Added log message"

    def _set_user_role(self, role: str) -> str:
        if role.upper() not in USER_ROLES:
            return f"Failed setting user role: {role}"
        self.user_role = role.upper()
        return f"Setting user role: {role}"

    def _set_operational_mode(self, mode: str) -> str:
        if mode.upper() not in OPERATIONAL_MODES:
            return f"Failed setting operational mode: {mode}"
        self.operational_mode = mode.upper()
        return f"Operational mode '{self.operational_mode}' is set"

    def _clear_operational_mode(self) -> str:
        self.operational_mode = NO_MODE
        return f"No longer controlling the operational mode. Current operational mode: '{NO_MODE}'."

    def _support_file(self, folder: str) -> str:
        return f"Completed successfully: {folder}/{self._report('support_{}.zip')}"

    def _report(self, answer: str) -> str:
        """Returns the answer with the number of the report; there is no file."""
        self.reports += 1
        return answer.format(self.reports)


def after(action: Callable[[], object], answer: str) -> Callable[[], str]:
    """Returns a function that carries out an action and returns the answer."""

    def act() -> str:
        action()
        return answer

    return act
