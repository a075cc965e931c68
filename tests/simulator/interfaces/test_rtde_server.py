"""The RTDE server on a plain dictionary of values: no controller, no arm."""

from __future__ import annotations

import struct

import pytest

from simulator.clock import Timeline
from simulator.interfaces import InputValues, RtdeServer, wire
from simulator.settings import ControllerIdentity
from tests.simulator.conftest import Connect, Line

IDENTITY = ControllerIdentity((5, 11, 1), 7, "123", "UR5")


class Fake:
    """A server with two output variables; `taken` are the inputs it handed on."""

    def __init__(self) -> None:
        self.timeline = Timeline(0.002)
        self.values: dict[str, list[float]] = {"timestamp": [0.0], "actual_q": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]}
        self.taken: list[InputValues] = []
        self.server = RtdeServer(IDENTITY, self.timeline, self.values, self.taken.append)

    def publish(self, cycles: int) -> None:
        for _ in range(cycles):
            self.timeline.cycles += 1
            self.values["timestamp"] = [self.timeline.t]
            self.server.publish()


@pytest.fixture
def fake() -> Fake:
    return Fake()


def packages(data: bytes) -> list[tuple[int, bytes]]:
    return list(wire.take_packages(bytearray(data)))


def set_up(line: Line, frequency: float, names: bytes) -> None:
    assert line.send(wire.package(wire.REQUEST_PROTOCOL_VERSION, b"\x00\x02"))
    assert packages(line.send(wire.package(wire.SETUP_OUTPUTS, struct.pack(">d", frequency) + names)))[0][1][0] == 1
    assert packages(line.send(wire.package(wire.START))) == [(wire.START, b"\x01")]


def test_the_identity_is_the_version_that_clients_read(fake: Fake, connect: Connect):
    line = connect(fake.server)
    assert packages(line.send(wire.package(118))) == [(118, struct.pack(">IIII", 5, 11, 1, 7))]


def test_values_are_sent_as_they_stand_in_the_dictionary(fake: Fake, connect: Connect):
    line = connect(fake.server)
    set_up(line, 500.0, b"timestamp,actual_q")
    fake.publish(1)
    assert packages(line.received()) == [(wire.DATA_PACKAGE, struct.pack(">B7d", 1, 0.002, 0, 1, 2, 3, 4, 5))]


def test_each_client_has_its_own_frequency(fake: Fake, connect: Connect):
    fast = connect(fake.server)
    slow = connect(fake.server)
    set_up(fast, 500.0, b"timestamp")
    set_up(slow, 125.0, b"timestamp")
    fake.publish(12)
    assert (len(packages(fast.received())), len(packages(slow.received()))) == (12, 3)


def test_inputs_are_handed_on_and_owned_until_the_connection_ends(fake: Fake, connect: Connect):
    names = wire.package(wire.SETUP_INPUTS, b"input_int_register_3,speed_slider_mask")
    first = connect(fake.server)
    second = connect(fake.server)
    assert packages(first.send(names)) == [(73, b"\x01INT32,UINT32")]
    assert packages(second.send(names)) == [(73, b"\x00IN_USE,IN_USE")]
    first.send(wire.package(wire.DATA_PACKAGE, struct.pack(">BiI", 1, -5, 1)))
    assert fake.taken == [InputValues([(3, -5)], [], {"speed_slider_mask": 1})]
    fake.server.closed(first.connection)
    assert packages(second.send(names)) == [(73, b"\x01INT32,UINT32")]


def test_malformed_packages_are_counted_and_a_malformed_size_ends_the_connection(fake: Fake, connect: Connect):
    line = connect(fake.server)
    assert line.send(wire.package(200, b"x") + wire.package(wire.DATA_PACKAGE, b"\x01")) == b""
    assert line.connection.open
    line.send(b"\x00\x01\x00")
    assert not line.connection.open
    assert fake.server.malformed == 3
    assert all(text.startswith("RTDE: malformed") for _, text in fake.timeline.events)


def test_the_role_is_read_from_the_set_up(fake: Fake, connect: Connect):
    receive = connect(fake.server)
    control = connect(fake.server)
    set_up(receive, 500.0, b"timestamp")
    for name in (b"input_int_register_0", b"input_int_register_1"):
        control.send(wire.package(wire.SETUP_INPUTS, name))
    assert [session.role for session in fake.server.sessions.values()] == ["receive", "io"]
    set_up(control, 500.0, b"timestamp")
    assert [session.role for session in fake.server.sessions.values()] == ["receive", "control"]
    receive.send(wire.package(wire.SETUP_INPUTS, b"input_bit_register_127"))  # kept by a client that receives
    assert [session.role for session in fake.server.sessions.values()] == ["receive", "control"]
    control.send(wire.package(wire.SETUP_INPUTS, b"tool_digital_output_mask,tool_digital_output"))
    assert [session.role for session in fake.server.sessions.values()] == ["receive", "io"]  # whether it hears or not


def test_a_share_of_data_packages_is_lost_both_ways(fake: Fake, connect: Connect):
    line = connect(fake.server)
    set_up(line, 500.0, b"timestamp")
    line.send(wire.package(wire.SETUP_INPUTS, b"input_int_register_0"))
    line.connection.disturbance.drop = 0.5
    fake.publish(200)
    for _ in range(200):
        line.send(wire.package(wire.DATA_PACKAGE, struct.pack(">Bi", 1, 9)))
    session = fake.server.sessions[line.connection]
    assert session.packages_out + session.skipped == 200
    assert 60 < session.packages_out < 140
    assert 60 < len(fake.taken) < 140
