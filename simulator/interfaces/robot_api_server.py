"""The Robot API of PolyScope X: what takes the dashboard's place from 10.11 on, over HTTP.

Source: Universal Robots, the OpenAPI page of the robot itself (`/universal-robots/robot-api/docs`), and its use by
UR's client library 2.14 (`DashboardClientImplX`, its table of versions, `tests/test_dashboard_client_x.cpp`). Not
documented, and chosen here: the texts of messages, and what a safeguard stop is called.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.interfaces.http_request import HttpRequest, answer_requests
from simulator.interfaces.stored_programs import StoredPrograms
from simulator.program import PAUSED, PLAYING, ProgramRunner, Stops
from simulator.settings import ControllerIdentity

BASE = "/universal-robots/robot-api"
API_VERSIONS = (  # PolyScope X -> Robot API; source: UR's client library, but for the first, which is chosen
    ((10, 14), (5, 0, 107)),
    ((10, 12), (3, 1, 4)),
    ((10, 11), (2, 0, 0)),
)
WITH_STATES = (3, 1, 4)
WITH_INFORMATION = (5, 0, 107)
FIRST = (0, 0, 0)
ROBOT_MODES = {3: "POWER_OFF", 5: "IDLE", 7: "RUNNING"}
SAFETY_MODES = {1: "NORMAL", 3: "PROTECTIVE_STOP", 5: "PROTECTIVE_STOP", 7: "EMERGENCY_STOP"}
PROGRAM_STATES = {PLAYING: "PLAYING", PAUSED: "PAUSED"}
DEFAULT_PROGRAM = "Default program"  # source: UR's client library, test get_loaded_program

Answer = tuple[int, dict[str, Any]]


@dataclass(frozen=True)
class Endpoint:
    """One method of one path: the first version of the API that has it, and what answers its request."""

    since: tuple[int, int, int]
    answer: Callable[[dict[str, Any]], Answer]


class RobotApiServer(ConnectionHandler):
    """Answers the Robot API from safety state and program; no arm is needed."""

    def __init__(self, identity: ControllerIdentity, stops: Stops, programs: Path | None = None) -> None:
        """`programs` is the folder of the programs that can be loaded; None: there are none."""
        self.identity = identity
        self.runner: ProgramRunner = stops.runner
        self.safety = stops.safety
        self.stops = stops
        self.programs = StoredPrograms(programs)
        self.version = next((api for first, api in API_VERSIONS if identity.version[:2] >= first), FIRST)
        self.endpoints = {key: end for key, end in self._endpoints().items() if end.since <= self.version}

    def _endpoints(self) -> dict[tuple[str, str], Endpoint]:
        """Returns what answers each method and path."""
        identity = self.identity
        marketing = ".".join(map(str, identity.version))
        information = {"serialNumber": identity.serial_number, "robotType": identity.model}
        versions = {"marketingVersion": marketing, "baselineVersion": f"{marketing}.{identity.build}"}
        own = {"info": {"title": "Robot API", "version": ".".join(map(str, self.version))}}
        return {
            ("GET", "/openapi.json"): _telling(FIRST, lambda: {"openapi": "3.1.0", **own, "paths": self._paths()}),
            ("PUT", "/robotstate/v1/state"): Endpoint(FIRST, self._change_robot),
            ("GET", "/program/v1/state"): _telling(FIRST, lambda: {"state": self._program_state()}),
            ("PUT", "/program/v1/state"): Endpoint(FIRST, self._change_program),
            ("PUT", "/program/v1/load"): Endpoint(FIRST, lambda asked: self._load(asked.get("programName"))),
            ("PUT", "/program/v1/loaded"): Endpoint(WITH_STATES, lambda asked: self._load(asked.get("name"))),
            ("GET", "/program/v1/loaded"): _telling(
                WITH_STATES, lambda: {"name": self.programs.loaded or DEFAULT_PROGRAM}
            ),
            ("GET", "/robotstate/v1/robotmode"): _telling(
                WITH_STATES, lambda: {"mode": ROBOT_MODES[self.safety.robot_mode]}
            ),
            ("GET", "/robotstate/v1/safetymode"): _telling(
                WITH_STATES, lambda: {"mode": SAFETY_MODES[self.safety.mode]}
            ),
            ("GET", "/system/v1/controlmode"): _telling(
                WITH_STATES, lambda: {"mode": "REMOTE" if self.runner.in_remote_control else "LOCAL"}
            ),
            ("GET", "/system/v1/operationalmode"): _telling(WITH_STATES, lambda: {"mode": "AUTOMATIC"}),
            ("GET", "/system/v1/information"): _telling(WITH_INFORMATION, lambda: information),
            ("GET", "/versions/v1"): _telling(WITH_INFORMATION, lambda: versions),
        }

    def _paths(self) -> dict[str, Any]:
        paths: dict[str, Any] = {}
        for method, path in self.endpoints:
            paths.setdefault(path, {})[method.lower()] = {}
        return paths

    def arrived(self, connection: Connection) -> None:
        """Answers every complete request."""
        answer_requests(connection, self.answer)

    def answer(self, request: HttpRequest) -> Answer:
        """Returns status and document of the answer to a request."""
        path = request.path.rstrip("/")
        endpoint = self.endpoints.get((request.method, path.removeprefix(BASE))) if path.startswith(BASE) else None
        if endpoint is None:
            is_known = any(BASE + other == path for _, other in self.endpoints)
            return (405, {"detail": "Method Not Allowed"}) if is_known else (404, {"detail": "Not Found"})
        if request.method == "GET":
            return endpoint.answer({})
        asked = request.document()
        if asked is None:
            return invalid("the body is no JSON object")
        if not self.runner.in_remote_control:
            return 403, {"message": "Forbidden", "details": "The robot is not in remote control mode"}
        return endpoint.answer(asked)

    def _program_state(self) -> str:
        return PROGRAM_STATES.get(self.runner.runtime, "STOPPED")

    def _change_robot(self, asked: dict[str, Any]) -> Answer:
        """Carries out an action on the robot, where its state allows it."""
        safety = self.safety
        mode = ROBOT_MODES[safety.robot_mode]
        stopped = f" and {SAFETY_MODES[safety.mode]}" if safety.stopped else ""
        allowed: dict[str, tuple[bool, Callable[[], object]]] = {
            "POWER_ON": (not safety.stopped and mode == "POWER_OFF", safety.power_on),
            "BRAKE_RELEASE": (not safety.stopped and mode != "RUNNING", safety.release_brakes),
            "POWER_OFF": (True, self.stops.power_loss),
            "UNLOCK_PROTECTIVE_STOP": (safety.mode == 3, lambda: self.stops.unlock(at_once=True)),
            "RESTART_SAFETY": (True, self.stops.restart_safety),
        }
        action = str(asked.get("action"))
        if action not in allowed:
            return invalid(f"action must be one of {', '.join(allowed)}")
        is_allowed, act = allowed[action]
        if not is_allowed:
            return 409, {"message": f"{action} is not possible", "details": f"The robot is {mode}{stopped}"}
        act()
        return 200, {"message": f"{action} succeeded"}

    def _change_program(self, asked: dict[str, Any]) -> Answer:
        """Plays, pauses, resumes or stops the program."""
        runner = self.runner
        actions: dict[str, Callable[[], bool]] = {
            "play": self._play,
            "pause": runner.pause,
            "resume": runner.resume,
            "stop": self._stop,
        }
        action = str(asked.get("action"))
        if action not in actions:
            return invalid(f"action must be one of {', '.join(actions)}")
        if not actions[action]():
            return 409, {"message": f"{action} is not possible", "details": f"The program is {self._program_state()}"}
        return 200, {"state": self._program_state(), "message": f"{action} succeeded"}

    def _play(self) -> bool:
        if not self.programs.text or not self.safety.may_move or self.runner.program is not None:
            return False
        self.runner.upload(self.programs.text)
        return True

    def _stop(self) -> bool:
        self.runner.stop("Robot API: stop")
        return True

    def _load(self, name: object) -> Answer:
        """Loads a program by its name, which has no extension."""
        if not isinstance(name, str):
            return invalid("the name of a program is missing")
        if not self.programs.load(name):
            return 404, {"message": f"Program {name!r} not found"}
        self.runner.stop(f"Robot API: load {name}")
        return 200, {"message": f"Program {name!r} loaded"}


def _telling(since: tuple[int, int, int], document: Callable[[], dict[str, Any]]) -> Endpoint:
    """Returns an endpoint that tells something; each answer has a message, as the API's do."""
    return Endpoint(since, lambda asked: (200, {"message": "OK", **document()}))


def invalid(reason: str) -> Answer:
    """Returns the answer to a request of the wrong shape."""
    return 422, {"detail": [{"loc": ["body"], "msg": reason, "type": "value_error"}]}
