"""Connections under the faults of a network."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest

from simulator.interfaces import Connection, ConnectionHandler, ControlServer, Network, ServicePort
from simulator.interfaces.connections import LINE_MAX
from tests.simulator.conftest import Connect, Line, unique_address

PORT = 29871  # of no service
DELAY_S = 0.02


class Echo(ConnectionHandler):
    """Sends back what it receives."""

    def opened(self, connection: Connection) -> None:
        connection.send(b"hello ")

    def arrived(self, connection: Connection) -> None:
        connection.send(bytes(connection.received))
        connection.received.clear()


@pytest.fixture
def line(connect: Connect) -> Line:
    line = connect(Echo())
    assert line.received() == b"hello "
    return line


def test_a_stalled_connection_keeps_what_it_should_have_sent(line: Line):
    line.connection.disturbance.stalled = True
    assert line.send(b"a") == b""
    line.connection.disturbance.stalled = False
    line.connection.flush()
    assert line.received() == b"a"


def test_jitter_delays_each_by_its_own_and_keeps_the_order(line: Line):
    line.connection.disturbance.jitter_s = 0.02
    for number in range(50):
        line.connection.send(bytes([number]))
    begin = time.monotonic()
    received = b""
    while line.connection.delayed:
        line.connection.deliver_delayed()
        received += line.received()
    assert time.monotonic() - begin > 0.01
    assert received == bytes(range(50))


def test_a_disturbance_of_every_connection_holds_for_those_to_come():
    network = Network(unique_address())
    network.disturbance.drop = 1.0
    network.undisturbed = "control"
    losses = {}
    for name in ("rtde", "control"):
        ours, served = socket.socketpair()
        losses[name] = network.connect(served, ServicePort(name, PORT, Echo())).disturbance.loses()
        ours.close()
    network.close()
    assert losses == {"rtde": True, "control": False}


def test_delayed_data_is_delivered_in_order_once_due(line: Line):
    line.connection.disturbance.delay_s = DELAY_S
    line.connection.send(b"a")
    line.connection.disturbance.delay_s = 0.0
    line.connection.send(b"b")  # not past the one before it
    assert not line.connection.deliver_delayed()
    assert line.received() == b""
    time.sleep(DELAY_S)
    line.connection.deliver_delayed()
    assert line.received() == b"ab"


def test_a_line_that_is_too_long_ends_the_connection(connect: Connect):
    line = connect(ControlServer({}))
    line.connection.received += b"x" * LINE_MAX
    line.send(b"x")
    assert not line.connection.open


@pytest.fixture
def network() -> Iterator[Network]:
    network = Network(unique_address())
    network.add(ServicePort("echo", PORT, Echo()), ServicePort("other", PORT + 1, Echo()))
    yield network
    network.close()


def test_ports_refuse_while_the_controller_is_offline_and_listen_again(network: Network):
    assert len(network.sockets) == 2
    network.unlisten(keep="other")
    assert [port.name for port in network.listeners.values()] == ["other"]
    network.listen()
    assert [port.name for port in network.listeners.values()] == ["other", "echo"]


def test_a_taken_address_cannot_be_listened_on(network: Network):
    with pytest.raises(OSError, match="in use"):
        Network(network.host).add(ServicePort("again", PORT, Echo()))
