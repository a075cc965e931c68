"""Each driver against its gripper's twin, over a socket: closed, open, deaf, silent, late, without its object."""

from __future__ import annotations

import math
import os
import select
import socket
import struct
import time
from collections.abc import Iterator
from importlib import import_module

import pytest

from executor import shared_memory as shm
from executor.grippers import GripperConnection, GripperUnavailable
from executor.grippers.drivers import DRIVERS
from executor.streaming.gripper_port import SocketPort
from planner.grippers import KINDS, MODELS
from tests.gripper_twins import TwinOnWire, until

ONROBOT = 'kind = "onrobot"\njitter_s = 0.003\nport = 5020\nmodel = '
TABLES = {
    "socket": 'kind = "robotiq"\nmodel = "2f85"\nopen_width_m = 0.07\n',
    "serial": 'kind = "robotiq"\nmodel = "hande"\ntransport = "tool_serial"\n',
    "fingers": f'{ONROBOT}"rg2"\nopen_width_m = 0.08\n',
    "vacuum": f'{ONROBOT}"vg10"\n',
    "http": 'kind = "http"\njitter_s = 0.01\nopen_url = "http://HOST:8085/o"\nclose_url = "http://HOST:8085/c"\n',
}
REPORTING = ["socket", "serial", "fingers", "vacuum"]
NOTED_S = 0.005  # [s] two ticks: from the time that one notes to what it receives, and from the release to a motion
WITH_FINGERS = ["socket", "serial", "fingers"]


@pytest.fixture
def twin(request: pytest.FixtureRequest) -> Iterator[TwinOnWire]:
    made = TwinOnWire(TABLES[request.param])
    yield made
    made.close()


@pytest.fixture
def port(twin: TwinOnWire) -> Iterator[SocketPort]:
    """What the stream has once the daemon found the gripper ready, told to close."""
    connection = GripperConnection(twin.link, twin.host)
    made = SocketPort(twin.job(os.dup(connection.fileno())))
    connection.close()
    made.tell(False)
    until(lambda: made.is_open() is False, made.cycle)
    yield made
    made.close()


def test_every_kind_but_those_of_outputs_has_a_driver_and_a_twin() -> None:
    linked = {name for name, kind in KINDS.items() if not kind.is_wired}
    reached = {(model.kind, transport) for model in MODELS.values() for transport in model.transports}
    assert set(DRIVERS) == reached | {(name, "") for name in linked if KINDS[name].call}
    assert {kind for kind, _ in DRIVERS} == linked
    for name in linked - {"script"}:  # the simulated controller itself runs that
        assert callable(import_module(f"simulator.grippers.{name}").twin)


@pytest.mark.parametrize("twin", TABLES, indirect=True)
def test_it_closes_opens_and_closes_again(twin: TwinOnWire, port: SocketPort) -> None:
    assert port.is_open() is False
    port.tell(True)
    until(lambda: twin.gripper.holds is None, port.cycle)
    until(port.is_open, port.cycle)
    if twin.link.stroke_m:
        until(lambda: not twin.gripper.is_busy, port.cycle)
        assert twin.gripper.width_m == pytest.approx(twin.link.open_width_m, abs=2e-4)
    port.tell(False)
    until(lambda: port.is_open() is False, port.cycle)
    until(lambda: twin.gripper.holds == 2 and not twin.gripper.is_busy, port.cycle)
    assert port.is_open() is False
    assert port.problem() is None


@pytest.mark.parametrize("number", [3, None], ids=["object", "nothing"])
@pytest.mark.parametrize("kind", REPORTING)
def test_it_tells_whether_it_closed_on_an_object(kind: str, number: int | None) -> None:
    """The twin is open and empty, and its closing takes an object or nothing."""
    twin = TwinOnWire(TABLES[kind], lambda t: number)
    try:
        connection = GripperConnection(twin.link, twin.host)
        made = SocketPort(twin.job(os.dup(connection.fileno())))
        connection.close()
        assert made.holds() is not True
        made.tell(False)
        until(lambda: not twin.gripper.open and not twin.gripper.is_busy, made.cycle)
        until(lambda: made.holds() is (number is not None), made.cycle)
        for _ in range(20):
            made.cycle()
            assert made.holds() is (number is not None)
        assert made.not_holding() == f"the gripper at {twin.host}:{twin.link.port} reports no object"
        made.close()
    finally:
        twin.close()


@pytest.mark.parametrize("twin", ["http"], indirect=True)
def test_a_call_does_not_tell_of_an_object(twin: TwinOnWire, port: SocketPort) -> None:
    assert port.holds() is None


@pytest.mark.parametrize("twin", WITH_FINGERS, indirect=True)
def test_one_that_is_stuck_reports_that_it_stays_closed(twin: TwinOnWire, port: SocketPort) -> None:
    until(lambda: not twin.gripper.is_busy, port.cycle)
    until(port.is_closed, port.cycle)
    twin.gripper.stuck = True
    port.tell(True)
    for _ in range(50):
        until(lambda: True, port.cycle)
        port.cycle()
    assert port.is_open() is False
    assert port.problem() is None


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_its_fingers_tell_between_which_times_it_let_go(twin: TwinOnWire, port: SocketPort) -> None:
    connection = port._connection

    def cycle() -> None:
        connection.stamp = time.monotonic()
        port.cycle()

    until(port.is_closed, cycle)
    port.tell(True)
    until(lambda: twin.gripper.holds is None, cycle)
    until(port.is_open, cycle)
    until(lambda: not twin.gripper.is_busy, cycle)
    shut_at = connection.memory.fields[shm.SHUT_AT_S]
    moved_by = connection.memory.fields[shm.MOVED_BY_S]
    if not twin.link.stroke_m:
        assert math.isnan(moved_by)  # the vacuum is gone before the object is
        return
    assert shut_at - NOTED_S < twin.left_at < moved_by + NOTED_S, (shut_at - twin.left_at, moved_by - twin.left_at)
    assert moved_by < connection.stamp


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_another_client_that_opens_it_is_seen(twin: TwinOnWire, port: SocketPort) -> None:
    other = GripperConnection(twin.link, twin.host)
    other._socket.sendall(other.driver.tell(True))
    until(port.is_open, port.cycle)
    other.close()


@pytest.mark.parametrize("twin", WITH_FINGERS, indirect=True)
def test_a_lost_object_is_released_early(twin: TwinOnWire, port: SocketPort) -> None:
    until(lambda: port._driver.fingers._gripped, port.cycle)
    twin.gripper.rearm = lambda stands: None
    twin.gripper.lose()
    until(port.problem, port.cycle)
    outcome, reason = port.problem()
    assert (outcome, "lost the object" in reason) == ("released_early", True)


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_a_silent_one_is_a_problem(twin: TwinOnWire, port: SocketPort) -> None:
    for connection, _ in twin.network.connections.values():
        connection.disturbance.stalled = True
    twin.network.changed()
    until(port.problem, port.cycle)
    outcome, reason = port.problem()
    assert outcome == "not_released"
    assert f"{twin.host}:{twin.link.port} has not answered for" in reason


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_one_that_goes_is_a_problem(twin: TwinOnWire, port: SocketPort) -> None:
    for connection, _ in [*twin.network.connections.values()]:
        connection.open = False
    until(port.problem, port.cycle)
    assert "closed the connection" in port.problem()[1] or "is lost" in port.problem()[1]


@pytest.mark.parametrize("twin", ["socket"], indirect=True)
def test_one_that_was_reset_before_the_stream_began_is_a_problem(twin: TwinOnWire) -> None:
    connection = GripperConnection(twin.link, twin.host)
    for accepted, _ in [*twin.network.connections.values()]:
        accepted.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # RST, not FIN
        accepted.open = False
    poll = select.poll()
    poll.register(connection.fileno(), select.POLLHUP)
    until(lambda: poll.poll(0))
    port = SocketPort(twin.job(os.dup(connection.fileno())))
    connection.close()
    outcome, reason = port.problem()
    assert (outcome, "is lost" in reason) == ("not_released", True)
    port.close()


@pytest.mark.parametrize("twin", ["http"], indirect=True)
def test_a_server_may_end_an_idle_connection(twin: TwinOnWire, port: SocketPort) -> None:
    before = {*twin.network.connections}
    for connection, _ in [*twin.network.connections.values()]:
        connection.open = False
    until(lambda: {*twin.network.connections} - before, port.cycle)
    port.tell(True)
    until(lambda: twin.gripper.holds is None, port.cycle)
    until(port.is_open, port.cycle)
    assert port.problem() is None


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_the_daemon_holds_the_object_over_the_same_connection(twin: TwinOnWire) -> None:
    connection = GripperConnection(twin.link, twin.host)
    assert connection.hold()
    until(lambda: twin.gripper.goal_m == 0.0)
    connection.close()


@pytest.mark.parametrize("twin", TABLES, indirect=True)
def test_what_the_daemon_tells_over_a_closed_connection_arrives_or_is_not_sent(twin: TwinOnWire) -> None:
    """A server of HTTP closes what is idle; the daemon's own end of it is not the one that the stream opened anew."""
    connection = GripperConnection(twin.link, twin.host)
    port = SocketPort(twin.job(os.dup(connection.fileno())))
    port.tell(True)
    until(lambda: twin.gripper.open, port.cycle)
    port.close()
    for each, _ in [*twin.network.connections.values()]:
        each.open = False
    select.select([connection.fileno()], [], [], 60.0)
    until(connection._is_closed)
    assert connection.hold() is (twin.link.kind == "http")
    if twin.link.kind == "http":
        until(lambda: not twin.gripper.open)
    connection.close()


@pytest.mark.parametrize("twin", TABLES, indirect=True)
def test_one_that_is_not_there_is_unavailable(twin: TwinOnWire) -> None:
    twin.close()
    with pytest.raises(GripperUnavailable, match="does not answer"):
        GripperConnection(twin.link, twin.host)


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_one_that_says_nothing_is_unavailable(twin: TwinOnWire) -> None:
    twin.network.ports[0].mute = True
    with pytest.raises(GripperUnavailable, match="does not answer"):
        GripperConnection(twin.link, twin.host)


@pytest.mark.parametrize("twin", REPORTING, indirect=True)
def test_one_that_answers_late_is_unavailable(twin: TwinOnWire, monkeypatch: pytest.MonkeyPatch) -> None:
    connect = twin.network.connect

    def late(*arguments):
        connection = connect(*arguments)
        connection.disturbance.delay_s = 0.08
        return connection

    monkeypatch.setattr(twin.network, "connect", late)
    with pytest.raises(GripperUnavailable, match=r"answers after 1\d\d ms"):
        GripperConnection(twin.link, twin.host)


@pytest.mark.parametrize("twin", ["socket"], indirect=True)
def test_one_that_is_not_activated_is_unavailable(twin: TwinOnWire) -> None:
    with twin.connect() as pendant:
        pendant.sendall(b"SET ACT 0\n")
        assert pendant.recv(64) == b"ack"
    with pytest.raises(GripperUnavailable, match="activate it on the pendant"):
        GripperConnection(twin.link, twin.host)


@pytest.mark.parametrize("twin", ["fingers"], indirect=True)
def test_a_compute_box_without_the_gripper_refuses(twin: TwinOnWire) -> None:
    twin.network.ports[0].handler.registers.read = lambda first, count: None
    with pytest.raises(GripperUnavailable, match="Modbus exception 2"):
        GripperConnection(twin.link, twin.host)
