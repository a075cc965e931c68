"""Power, brakes and control mode: by whichever interface a controller offers, or by a person.

The servers here answer as UR documents its own: the dashboard manual, and what UR's client library expects of the
Robot API. They are not the simulator's.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from typing import Any

import pytest

from executor.robot import ActionRefused, Console, dashboard, robot_api
from executor.robot.dashboard import DashboardClient
from tests.waiting import until

HOSTS = (f"127.0.43.{number}" for number in count(1))
PREFIX = "/universal-robots/robot-api"
NEW = {  # GET paths of PolyScope 10.14
    "/openapi.json": {"info": {"version": "5.0.107"}},
    "/system/v1/controlmode": {"mode": "REMOTE", "message": "ok"},
    "/system/v1/information": {"serialNumber": "20251234567", "robotType": "UR7e"},
}
OLD = {"/openapi.json": {"info": {"version": "2.0.0"}}}
DASHBOARD = {
    "is in remote control": "true",
    "get serial number": "20235500001",
    "power on": "Powering on",
    "unlock protective stop": "Cannot unlock protective stop until 5s after occurrence.",
}


class RobotApi(ThreadingHTTPServer):
    """A Robot API; `asked` are its PUTs, `verdict` is what they are answered."""

    def __init__(self, host: str, port: int, paths: dict[str, Any]) -> None:
        super().__init__((host, port), ApiHandler)
        self.paths = paths
        self.asked: list[tuple[str, Any]] = []
        self.connections: list[socket.socket] = []
        self.verdict: tuple[int, Any] = (200, {"message": "ok"})
        self.is_json = True


class ApiHandler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    @property
    def api(self) -> RobotApi:
        assert isinstance(self.server, RobotApi)
        return self.server

    def setup(self) -> None:
        super().setup()
        self.api.connections.append(self.connection)

    def log_message(self, format: str, *args: object) -> None:
        return

    def do_GET(self) -> None:
        found = self.api.paths.get(self.path.removeprefix(PREFIX))
        self._answer(*((404, {"detail": "Not Found"}) if found is None else (200, found)))

    def do_PUT(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.api.paths is OLD and not self.path.endswith("/"):
            self._answer(307, {}, f"http://{self.headers['Host']}{self.path}/")
            return
        self.api.asked.append((self.path.removeprefix(PREFIX), body))
        self._answer(*self.api.verdict)

    def _answer(self, status: int, document: Any, location: str = "") -> None:
        is_html = self.command == "PUT" and not self.api.is_json
        body = b"<html>" if is_html else json.dumps(document).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        if location:
            self.send_header("Location", location)
        self.end_headers()
        self.wfile.write(body)


@contextmanager
def robot_api_of(paths: dict[str, Any], host: str = "") -> Iterator[tuple[str, RobotApi]]:
    host = host or next(HOSTS)
    with RobotApi(host, robot_api.PORTS[1], paths) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield host, server
        server.shutdown()
        for connection in server.connections:
            with suppress(OSError):  # its client has closed it
                connection.shutdown(socket.SHUT_RDWR)


@contextmanager
def dashboard_of(answers: dict[str, str], host: str = "") -> Iterator[str]:
    """A dashboard that answers some lines."""
    host = host or next(HOSTS)

    def serve(listener: socket.socket) -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=talk, args=(connection,), daemon=True).start()

    def talk(connection: socket.socket) -> None:
        with connection, connection.makefile("rwb") as stream:
            stream.write(b"Connected: Universal Robots Dashboard Server\n")
            stream.flush()
            for line in stream:
                text = line.decode().strip()
                stream.write(answers.get(text, f"could not understand: '{text}'").encode() + b"\n")
                stream.flush()

    with socket.create_server((host, 29999)) as listener:
        threading.Thread(target=serve, args=(listener,), daemon=True).start()
        yield host
        listener.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def console() -> Iterator[Console]:
    found = Console("")
    yield found
    found.close()


def test_the_dashboard_is_asked_where_it_answers(console: Console) -> None:
    with dashboard_of(DASHBOARD) as console.host:
        assert (console.control_mode(), console.serial_number()) == ("remote", "20235500001")
        assert console.act("power_on") == "dashboard"
        with pytest.raises(ActionRefused, match="the dashboard refuses it: Cannot unlock protective stop until 5s"):
            console.act("unlock_protective_stop")


def test_an_old_dashboard_tells_neither_control_mode_nor_serial_number(console: Console) -> None:
    with dashboard_of({}) as console.host:
        assert (console.control_mode(), console.serial_number()) == ("unknown", None)


def test_the_robot_api_is_asked_where_there_is_no_dashboard(console: Console) -> None:
    with robot_api_of(NEW) as (console.host, server):
        assert (console.control_mode(), console.serial_number()) == ("remote", "20251234567")
        for action in ("power_on", "brake_release", "unlock_protective_stop", "power_off"):
            assert console.act(action) == "Robot API"
    paths = {path for path, _ in server.asked}
    assert paths == {"/robotstate/v1/state"}
    actions = [body["action"] for _, body in server.asked]
    assert actions == ["POWER_ON", "BRAKE_RELEASE", "UNLOCK_PROTECTIVE_STOP", "POWER_OFF"]


def test_an_old_robot_api_moves_its_paths_and_tells_less(console: Console) -> None:
    with robot_api_of(OLD) as (console.host, server):
        assert (console.control_mode(), console.serial_number()) == ("unknown", None)
        assert console.act("power_on") == "Robot API"
    assert server.asked == [("/robotstate/v1/state/", {"action": "POWER_ON"})]


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ((403, {"message": "Forbidden"}), r"\(403\): Forbidden"),
        ((409, {"message": "no", "details": "not in PROTECTIVE_STOP"}), r"\(409\): no; not in PROTECTIVE_STOP"),
        ((500, []), r"\(500\): no reason given"),
    ],
)
def test_a_refusal_of_the_robot_api_is_told_in_its_words(
    console: Console, verdict: tuple[int, Any], words: str
) -> None:
    with robot_api_of(NEW) as (console.host, server):
        server.verdict = verdict
        with pytest.raises(ActionRefused, match=words):
            console.act("unlock_protective_stop")


def test_where_nothing_answers_a_person_is_told_what_to_do(console: Console) -> None:
    console.host = next(HOSTS)
    assert (console.control_mode(), console.serial_number()) == (None, None)
    with pytest.raises(ActionRefused, match="on the pendant: open the robot's state at the bottom left"):
        console.act("brake_release")


def test_a_web_server_that_is_no_robot_api_counts_for_nothing(console: Console) -> None:
    with robot_api_of({"/index.html": {}}) as (console.host, _):
        assert console.control_mode() is None


def test_an_interface_that_went_away_is_looked_for_again(console: Console) -> None:
    with robot_api_of(NEW) as (host, _):
        console.host = host
        assert console.control_mode() == "remote"
    assert console.control_mode() is None
    with dashboard_of(DASHBOARD, host):
        assert console.act("power_on") == "dashboard"  # a person waits: at once


@contextmanager
def dull_dashboard(hangs_up: bool) -> Iterator[tuple[str, list[str]]]:
    """A dashboard that answers one question and nothing else, or hangs up instead; yields its address and the lines."""
    host = next(HOSTS)
    heard: list[str] = []

    def talk(connection: socket.socket) -> None:
        with connection, suppress(ConnectionError):
            connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
            for line in connection.makefile("rb"):
                heard.append(line.decode().strip())
                if heard[-1] == dashboard.QUESTION:
                    connection.sendall(b"Robotmode: RUNNING\n")
                elif hangs_up:
                    connection.shutdown(socket.SHUT_RDWR)

    def serve(listener: socket.socket) -> None:
        with suppress(OSError):
            while True:
                threading.Thread(target=talk, args=(listener.accept()[0],), daemon=True).start()

    with socket.create_server((host, 29999)) as listener:
        threading.Thread(target=serve, args=(listener,), daemon=True).start()
        yield host, heard
        listener.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("hangs_up", [False, True])
def test_an_action_is_sent_once(monkeypatch: pytest.MonkeyPatch, hangs_up: bool) -> None:
    """The arm must not get power once somebody was told that it did not."""
    monkeypatch.setattr(dashboard, "TIMEOUT_S", 0.2)
    with dull_dashboard(hangs_up) as (host, heard):
        client = DashboardClient(host)
        client.connect()
        with pytest.raises(OSError, match=r"timed out|closed"):
            client.act("brake_release")
        until(lambda: heard == [dashboard.QUESTION, "brake release"])


def test_a_stop_is_asked_for_again_where_a_kept_connection_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dashboard, "TIMEOUT_S", 0.2)
    with dull_dashboard(hangs_up=False) as (host, heard):
        client = DashboardClient(host)
        client.connect()
        with pytest.raises(TimeoutError):
            client.ask("stop")
        until(lambda: heard == ["stop", "stop"])


@pytest.mark.parametrize("verdict", [(502, "no gateway"), (200, "")])
def test_an_action_of_the_robot_api_is_sent_once(console: Console, verdict: tuple[int, str]) -> None:
    with robot_api_of(NEW) as (console.host, server):
        console.control_mode()
        server.verdict = verdict
        server.is_json = False
        with pytest.raises(ActionRefused, match="no JSON"):
            console.act("unlock_protective_stop")
        assert len(server.asked) == 1


@pytest.mark.parametrize("client_of", [DashboardClient, robot_api.RobotApiClient])
def test_what_has_not_arrived_is_dropped(monkeypatch: pytest.MonkeyPatch, client_of: Any) -> None:
    """Its connections are reset as they close, unless all has been acknowledged."""
    dropped: list[socket.socket] = []
    module = dashboard if client_of is DashboardClient else robot_api
    monkeypatch.setattr(module, "discard_at_close", dropped.append)
    with dashboard_of(DASHBOARD) as host, robot_api_of(NEW, host):
        client = client_of(host)
        client.connect()
        client.act("power_on")
        assert len(dropped) == 1
        client.close()
