"""Client of the Robot API of PolyScope X, which takes the dashboard's place from 10.11 on.

Source: Universal Robots, the OpenAPI page of the robot (`/universal-robots/robot-api/docs`), and UR's client library
2.14, `DashboardClientImplX`: paths, actions, and the version of the API that has them.
"""

from __future__ import annotations

import json
from http.client import HTTPConnection, HTTPException, HTTPMessage
from typing import Any
from urllib.parse import urlsplit

from executor.robot.operation import ActionRefused, ControlMode
from executor.undelivered import close_in_order, discard_at_close
from store import RobotAction

PORTS = (80, 29980)  # the second one is the simulator's, where it may not listen on the first (docs/simulator.md)
BASE = "/universal-robots/robot-api"
TIMEOUT_S = 0.5  # [s] a controller answers within milliseconds; heartbeats wait for this
ACTION_TIMEOUT_S = 20.0  # [s] an action answers once it is done: an arm powers on within 10 s or so
ANSWER_BYTES = 1 << 20  # [byte] a longer answer is none
CONTROL_MODES: dict[str, ControlMode] = {"REMOTE": "remote", "LOCAL": "local"}
ABSENT = 404
REDIRECTS = (307, 308)  # some paths have moved from one version to the next; source: UR's client library


class RobotApiClient:
    """One connection, opened when first needed and reopened after a failure. Not safe for two threads."""

    name = "Robot API"

    def __init__(self, host: str) -> None:
        self.host = host
        self._connection: HTTPConnection | None = None

    def connect(self) -> None:
        """Looks for the API on its ports.

        Raises:
            OSError: it is on none of them.
        """
        for port in PORTS:
            self.close()
            self._connection = HTTPConnection(self.host, port, timeout=TIMEOUT_S)
            try:
                if self._ask("GET", "/openapi.json")[0] == 200:
                    return
            except OSError:
                continue
        self.close()
        raise ConnectionError(f"no Robot API at {self.host}")

    def control_mode(self) -> ControlMode:
        """Returns who controls the robot; "unknown" before 10.12, which does not tell.

        Raises:
            OSError: no answer in time.
        """
        return CONTROL_MODES.get(str(self._told("/system/v1/controlmode", "mode")), "unknown")

    def serial_number(self) -> str | None:
        """Returns the robot's serial number; None before 10.14, which does not tell it.

        Raises:
            OSError: no answer in time.
        """
        found = self._told("/system/v1/information", "serialNumber")
        return found if isinstance(found, str) else None

    def act(self, action: RobotAction) -> None:
        """Operates the robot: the action is sent once, and dropped where it has not arrived.

        Raises:
            OSError: no answer in time.
            ActionRefused: the controller refuses it.
        """
        self.control_mode()  # over a connection that lives
        status, answer = self._send_once("PUT", "/robotstate/v1/state", {"action": action.upper()}, ACTION_TIMEOUT_S)
        if not 200 <= status < 300:
            words = [str(answer[key]) for key in ("message", "details", "detail") if answer.get(key)]
            raise ActionRefused(f"the Robot API refuses it ({status}): {'; '.join(words) or 'no reason given'}")

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._connection is not None:
            self._hang_up(self._connection)
            self._connection = None

    @staticmethod
    def _dial(connection: HTTPConnection) -> None:
        connection.connect()
        discard_at_close(connection.sock)

    @staticmethod
    def _hang_up(connection: HTTPConnection) -> None:
        if connection.sock is not None:
            close_in_order(connection.sock, 0.0)
        connection.close()

    def _told(self, path: str, key: str) -> object:
        """Returns a field of an answer; None where this version has no such path."""
        status, answer = self._ask("GET", path)
        if status not in (200, ABSENT):
            raise ConnectionError(f"the Robot API answers {status} to {path}")
        return answer.get(key)

    def _ask(self, method: str, path: str) -> tuple[int, dict[str, Any]]:
        """Returns status and document of an answer; asks once more where a kept connection has ended meanwhile."""
        is_kept = self._connection is not None and self._connection.sock is not None
        try:
            return self._send_once(method, path)
        except ConnectionError:
            if not is_kept:
                raise
        return self._send_once(method, path)

    def _send_once(
        self, method: str, path: str, document: dict[str, str] | None = None, timeout_s: float = TIMEOUT_S
    ) -> tuple[int, dict[str, Any]]:
        """Returns status and document of an answer; where there is none, what has not arrived is dropped."""
        if self._connection is None:
            self.connect()
        connection = self._connection
        assert connection is not None
        try:
            return self._exchange(connection, method, path, document, timeout_s)
        except OSError:
            self._hang_up(connection)
            raise

    def _exchange(
        self, connection: HTTPConnection, method: str, path: str, document: dict[str, str] | None, timeout_s: float
    ) -> tuple[int, dict[str, Any]]:
        """Returns status and document of an answer, following one redirection."""
        status, headers, text = self._send(connection, method, BASE + path, document, timeout_s)
        if status in REDIRECTS:
            moved = urlsplit(headers.get("location", "")).path
            status, _, text = self._send(connection, method, moved, document, timeout_s)
        try:
            found = json.loads(text) if text else {}
        except ValueError as error:
            raise ConnectionError(f"the Robot API answers with no JSON to {path}") from error
        return status, found if isinstance(found, dict) else {}

    def _send(
        self, connection: HTTPConnection, method: str, path: str, document: dict[str, str] | None, timeout_s: float
    ) -> tuple[int, HTTPMessage, bytes]:
        body = None if document is None else json.dumps(document)
        headers = {} if body is None else {"Content-Type": "application/json"}
        connection.timeout = timeout_s
        if connection.sock is not None:
            connection.sock.settimeout(timeout_s)
        try:
            if connection.sock is None:
                self._dial(connection)
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read(ANSWER_BYTES)
        except HTTPException as error:  # also a connection that ended without an answer
            raise ConnectionError(f"no answer of the Robot API: {error!r}") from error
