"""Arbitrary bytes on a port are answered or end that connection; other clients are still served."""

from __future__ import annotations

import json
import socket
import struct
import time
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simulator.interfaces import wire
from simulator.interfaces.variables import INPUT_TYPES, OUTPUT_TYPES
from simulator.settings import CONTROL_PORT, DASHBOARD_PORT, PRIMARY_PORT, RTDE_PORT, SCRIPT_PORT
from simulator.simulation import Simulation
from tests.simulator.conftest import Driven, Peer, Simulator, Start, dashboard_server, make_cell

PORTS = [RTDE_PORT, SCRIPT_PORT, PRIMARY_PORT, DASHBOARD_PORT, CONTROL_PORT]
NAMES = st.lists(st.sampled_from([*OUTPUT_TYPES, *INPUT_TYPES, "nonsense", "", "é"]), max_size=60).map(
    lambda names: ",".join(names).encode()
)
PACKAGES = st.one_of(
    st.builds(lambda f, names: wire.package(79, struct.pack(">d", f) + names), st.floats(), NAMES),
    st.builds(lambda names: wire.package(73, names), NAMES),
    st.builds(lambda body: wire.package(85, body), st.binary(max_size=80)),
    st.builds(lambda kind, body: wire.package(kind, body), st.integers(0, 255), st.binary(max_size=40)),
    st.sampled_from([wire.package(83), wire.package(80), wire.package(86, b"\x00\x02"), wire.package(118)]),
    st.binary(max_size=200),
)
LINES = st.one_of(
    st.binary(max_size=100),
    st.sampled_from(
        [
            b"play\n",
            b"stop\n",
            b"unlock protective stop\n",
            b"load x\n",
            b"quit\n",
            b"end\n",
            b"def rtde_control():\n",
            b"sec x():\n",
            b"set robotmode run\n",
            b'{"op": "state"}\n',
            b'{"op": "world", "after": "x"}\n',
            b'{"op": []}\n',
            b"[" * 3000,
            b'{"op": "fault", "name": "speed_slider", "fraction": null}\n',
            b'{"op": "place_bin", "bottom_m": [1e999, 0, 0], "radius_m": "x", "rim_height_m": 1}\n',
            b'{"op": "place_bin", "bottom_m": [1, 0, 0], "radius_m": 1%s, "rim_height_m": 1}\n' % (b"0" * 400),
            b"\n",
            b"\xff\n",
        ]
    ),
)


@pytest.mark.parametrize("port", ["rtde", "script", "primary", "dashboard", "control"])
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_bytes_break_the_loop(simulation: Simulation, port: str, data: st.DataObject) -> None:
    chunks = data.draw(st.lists(PACKAGES if port == "rtde" else LINES, min_size=1, max_size=8))
    peer = Peer(simulation, port)
    other = Peer(simulation, "control")
    for chunk in chunks:
        peer.send(chunk)
    other.socket.sendall(b'{"op": "stats"}\n')
    simulation.network.readable(other.served)
    assert json.loads(other.socket.recv(1 << 16))["ok"]
    peer.close()
    other.close()


def advances(simulator: Simulator, before: float) -> bool:
    """Whether controller time advances."""
    for _ in range(100):
        if simulator.ask("state")["t"] > before:
            return True
        time.sleep(0.01)
    return False


@pytest.mark.parametrize("port", PORTS)
def test_a_running_simulator_serves_others_while_one_client_talks_nonsense(start_simulator: Start, port: int) -> None:
    simulator = start_simulator()
    with socket.create_connection((simulator.host, port)) as nonsense:
        nonsense.sendall(bytes(range(256)) * 40 + b"\n")
        before = simulator.ask("state")["t"]
        with socket.create_connection((simulator.host, RTDE_PORT)) as sock:
            sock.sendall(wire.package(86, b"\x00\x02"))
            assert sock.recv(10) == wire.package(86, b"\x01")
        assert advances(simulator, before)
    simulator.close()


def test_a_client_that_never_reads_is_dropped_or_skipped_and_nobody_waits_for_it(start_simulator: Start) -> None:
    simulator = start_simulator()
    with socket.create_connection((simulator.host, DASHBOARD_PORT)) as deaf:
        deaf.setblocking(False)
        for _ in range(500):
            with suppress(BlockingIOError, ConnectionError):
                deaf.send(b"PolyscopeVersion\n" * 500)
        assert advances(simulator, simulator.ask("state")["t"])
    simulator.close()


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60))
def test_the_dashboard_answers_every_line_with_one_line(line: str) -> None:
    answer = dashboard_server(DRIVEN).answer(line.replace("\n", " "))
    assert isinstance(answer, str) and answer


DRIVEN = Driven(make_cell())
