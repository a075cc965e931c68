"""The Robot API of PolyScope X, endpoint by endpoint, as UR's client library asks for them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from simulator.interfaces.http_request import HttpRequest
from simulator.interfaces.robot_api_server import BASE, RobotApiServer
from simulator.settings import ControllerIdentity, SimulatorSettings
from simulator.simulation import Simulation
from tests.simulator.conftest import Connect, Peer, ProgramParts, make_cell, unique_address

NEWEST = (10, 14, 0)
ARM_RUNS = {"mode": "RUNNING", "message": "OK"}


class Api:
    """A Robot API without a network; `parts` are the program and the safety state behind it."""

    def __init__(self, version: tuple[int, int, int] = NEWEST, programs: Path | None = None) -> None:
        self.parts = ProgramParts()
        identity = ControllerIdentity(version, 123456, "20235500001", "UR5")
        self.server = RobotApiServer(identity, self.parts.stops, programs)

    def get(self, path: str) -> tuple[int, dict[str, Any]]:
        return self.server.answer(HttpRequest("GET", BASE + path, b"", True))

    def put(self, path: str, document: Any) -> tuple[int, dict[str, Any]]:
        return self.server.answer(HttpRequest("PUT", BASE + path, json.dumps(document).encode(), True))

    def act(self, action: str) -> int:
        """Asks for an action on the robot; returns the status."""
        return self.put("/robotstate/v1/state", {"action": action})[0]

    def program(self, action: str) -> int:
        return self.put("/program/v1/state", {"action": action})[0]

    def told(self, path: str, key: str = "mode") -> str:
        status, document = self.get(path)
        assert status == 200
        return document[key]


def test_power_is_cycled_as_the_client_library_does() -> None:
    api = Api()
    modes = []
    for action in ("POWER_OFF", "POWER_ON", "BRAKE_RELEASE", "POWER_OFF"):
        assert api.act(action) == 200
        modes.append(api.told("/robotstate/v1/robotmode"))
    assert modes == ["POWER_OFF", "IDLE", "RUNNING", "POWER_OFF"]


def test_a_protective_stop_is_unlocked_at_once() -> None:
    api = Api()
    api.parts.stops.protective("by the program")
    assert api.told("/robotstate/v1/safetymode") == "PROTECTIVE_STOP"
    assert api.act("UNLOCK_PROTECTIVE_STOP") == 200
    assert api.told("/robotstate/v1/safetymode") == "NORMAL"


@pytest.mark.parametrize("action", ["POWER_ON", "BRAKE_RELEASE", "UNLOCK_PROTECTIVE_STOP"])
def test_what_the_state_does_not_allow_is_a_conflict(action: str) -> None:
    api = Api()
    status, document = api.put("/robotstate/v1/state", {"action": action})
    assert (status, document["details"]) == (409, "The robot is RUNNING")


def test_an_emergency_stop_is_not_powered_away() -> None:
    api = Api()
    api.parts.stops.emergency()
    status, document = api.put("/robotstate/v1/state", {"action": "POWER_ON"})
    assert (status, document["details"]) == (409, "The robot is POWER_OFF and EMERGENCY_STOP")


def test_a_program_is_loaded_played_paused_resumed_and_stopped(tmp_path: Path) -> None:
    (tmp_path / "wait_program.script").write_text("def wait_program():\n  sleep(9)\nend\n")
    api = Api(programs=tmp_path)
    assert api.told("/program/v1/loaded", "name") == "Default program"
    assert api.program("play") == 409  # nothing is loaded
    assert api.put("/program/v1/loaded", {"name": "other"})[0] == 404
    assert api.put("/program/v1/loaded", {"name": "wait_program"})[0] == 200
    assert api.told("/program/v1/loaded", "name") == "wait_program"
    states = []
    for action in ("play", "pause", "resume", "stop"):
        assert api.program(action) == 200
        api.parts.cycle(30)
        states.append(api.told("/program/v1/state", "state"))
    assert states == ["PLAYING", "PAUSED", "PLAYING", "STOPPED"]


def test_local_control_forbids_every_change_and_tells_all_the_same() -> None:
    api = Api()
    api.parts.runner.remote_control = False
    assert api.told("/system/v1/controlmode") == "LOCAL"
    assert [api.act("POWER_OFF"), api.program("stop")] == [403, 403]
    assert api.get("/robotstate/v1/robotmode") == (200, ARM_RUNS)


def test_the_controller_is_told_from_its_newest_version_on() -> None:
    api = Api()
    assert api.get("/system/v1/information")[1]["serialNumber"] == "20235500001"
    assert api.told("/versions/v1", "marketingVersion") == "10.14.0"
    assert api.get("/openapi.json")[1]["info"]["version"] == "5.0.107"


@pytest.mark.parametrize(
    ("version", "api_version", "absent"),
    [
        ((10, 11, 0), "2.0.0", ["/robotstate/v1/robotmode", "/system/v1/controlmode", "/program/v1/loaded"]),
        ((10, 12, 0), "3.1.4", ["/system/v1/information", "/versions/v1"]),
    ],
)
def test_an_older_version_has_less(version: tuple[int, int, int], api_version: str, absent: list[str]) -> None:
    api = Api(version)
    assert api.get("/openapi.json")[1]["info"]["version"] == api_version
    assert [api.get(path)[0] for path in absent] == [404] * len(absent)
    assert api.act("POWER_OFF") == 200


@pytest.mark.parametrize("body", [b"", b"{", b"[1]", b'{"action": "DANCE"}', b"{}", b"\xff", b"[" * 30_000])
def test_what_is_no_action_is_refused(body: bytes) -> None:
    api = Api()
    assert api.server.answer(HttpRequest("PUT", f"{BASE}/robotstate/v1/state/", body, True))[0] == 422
    assert api.get("/robotstate/v1/robotmode") == (200, ARM_RUNS)


def test_other_paths_and_methods_are_not_there() -> None:
    api = Api()
    assert api.get("/robotstate/v1/state")[0] == 405
    assert api.get("/nowhere")[0] == 404
    assert api.server.answer(HttpRequest("GET", "/robotstate/v1/robotmode", b"", True))[0] == 404


def test_requests_come_in_pieces_and_several_on_one_connection(connect: Connect) -> None:
    line = connect(Api().server)
    get = f"GET {BASE}/robotstate/v1/robotmode?x=1 HTTP/1.1\r\nHost: h\r\n\r\n".encode()
    assert line.send(get[:30]) == b""
    answer = line.send(get[30:] + get)
    assert answer.count(b"HTTP/1.1 200 OK\r\n") == 2
    assert answer.endswith(json.dumps({"message": "OK", "mode": "RUNNING"}).encode())


@pytest.mark.parametrize(
    "sent",
    [
        b"hello\r\n\r\n",
        b"x" * 20_000,
        b"PUT / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
        b"PUT / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"PUT / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
    ],
)
def test_what_is_no_http_ends_the_connection(connect: Connect, sent: bytes) -> None:
    line = connect(Api().server)
    assert line.send(sent) == b""
    assert not line.connection.open


def test_a_controller_of_polyscope_x_has_no_dashboard() -> None:
    simulation = Simulation(make_cell(polyscope="10.14.0"), SimulatorSettings(), unique_address())
    assert {"robot_api", "primary", "rtde"} <= {port.name for port in simulation.network.ports}
    assert "dashboard" not in {port.name for port in simulation.network.ports}
    peer = Peer(simulation, "robot_api")
    ask = f"GET {BASE}/system/v1/controlmode HTTP/1.1\r\nConnection: close\r\n\r\n".encode()
    assert b'"mode": "REMOTE"' in peer.send(ask)
    assert not peer.connection.open
    peer.close()
    simulation.network.close()
