"""The connection that switches outputs, against the packages of the RTDE guide written out by hand."""

from __future__ import annotations

import math
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest

from executor.streaming import controller_inputs
from executor.streaming.controller_inputs import ControllerInputs
from executor.streaming.rtde_connection import SILENT_S, RtdeConnection
from executor.streaming.state_checks import StreamFault
from tests.waiting import until

HOST = "127.0.82.40"
TIME = struct.pack(">HBBd", 12, 85, 1, 10.0)  # the controller's time


class OutputsPort(threading.Thread):
    """Answers set-ups: recipe 1 to the first, 2 to the next …; keeps the data packages that follow."""

    def __init__(self, types: dict[str, str]) -> None:
        super().__init__(daemon=True)
        self.types = types
        self.server = socket.create_server((HOST, 0))
        self.asked: list[str] = []
        self.data: list[bytes] = []
        self.client: socket.socket | None = None
        self.before = struct.pack(">HB", 5, 77) + b"hi"  # what comes before each answer: a message nobody asked for

    def run(self) -> None:
        self.client, _ = self.server.accept()
        with self.client, self.client.makefile("rb") as stream:
            while len(head := stream.read(3)) == 3:
                size, kind = struct.unpack(">HB", head)
                self.take(kind, stream.read(size - 3))

    def take(self, kind: int, body: bytes) -> None:
        if kind == 85:
            self.data.append(body)
            return
        answer = b"\x01"
        if kind == 73:
            self.asked.append(body.decode())
            types = [self.types.get(name, "UINT8") for name in self.asked[-1].split(",")]
            answer = bytes([len(self.asked)]) + ",".join(types).encode()
        assert self.client is not None
        self.client.sendall(self.before + struct.pack(">HB", 3 + len(answer), kind) + answer)


@contextmanager
def controller(monkeypatch: pytest.MonkeyPatch, **types: str) -> Iterator[OutputsPort]:
    there = OutputsPort(types)
    monkeypatch.setattr(controller_inputs, "RTDE_PORT", there.server.getsockname()[1])
    there.start()
    with there.server:
        yield there
        there.join(60.0)


def test_what_is_written_is_what_the_guide_says(monkeypatch: pytest.MonkeyPatch) -> None:
    with controller(monkeypatch) as there:
        inputs = ControllerInputs(HOST, 500.0, keeps_alive=True)
        assert inputs.set_output("tool_digital", 1, True)
        assert inputs.set_output("standard_digital", 7, False)
        assert inputs.set_register(18, -2)
        assert inputs.set_register(19, 3)
        inputs._socket.close()
        there.join(60.0)
        third = ["standard_digital_output_mask,standard_digital_output"]
        third += ["configurable_digital_output_mask,configurable_digital_output"]
        third += ["tool_digital_output_mask,tool_digital_output"]
        assert there.asked == [*third, "input_int_register_18", "input_int_register_19"]
        assert there.data == [b"\x03\x02\x02", b"\x01\x80\x00", b"\x04\xff\xff\xff\xfe", b"\x05\x00\x00\x00\x03"]


def test_outputs_that_another_client_owns_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        controller(monkeypatch, tool_digital_output="IN_USE"),
        pytest.raises(ValueError, match="tool_digital_output is in use by another client"),
    ):
        ControllerInputs(HOST, 500.0)


def test_a_connection_that_the_controller_ends_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    with controller(monkeypatch) as there:
        inputs = ControllerInputs(HOST, 500.0)
        assert not inputs.heard()
        assert there.client is not None
        there.client.sendall(TIME)  # is not read as its end
        until(inputs.heard)
        assert not inputs.heard()
        there.client.shutdown(socket.SHUT_RDWR)
        with pytest.raises(ConnectionError, match="the controller closed it"):
            until(inputs.heard)
        inputs._socket.close()


def test_what_comes_before_an_answer_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller sends its time from the answer to the start on, and may do so before it."""
    with controller(monkeypatch) as there:
        there.before = TIME
        ControllerInputs(HOST, 500.0)._socket.close()


def test_nobody_there_is_an_error() -> None:
    with pytest.raises(OSError, match="refused"):
        ControllerInputs("127.0.82.41", 500.0)


class Listened:
    """A connection for outputs over which the controller sends while `sends`."""

    sends = True

    def heard(self) -> bool:
        return self.sends


@pytest.mark.parametrize("dt", [0.002, 0.008])
def test_its_silence_is_counted_in_states(dt: float) -> None:
    connection = RtdeConnection.__new__(RtdeConnection)  # without a controller
    connection.job = cast(Any, SimpleNamespace(dt=dt))
    there = cast(Any, Listened())
    for _ in range(100):
        connection._listen(there, is_new=True)
    there.sends = False
    for _ in range(100):  # the controller compiles a program: no state comes either
        connection._listen(there, is_new=False)
    states = math.ceil(SILENT_S / dt)
    for _ in range(states - 1):
        connection._listen(there, is_new=True)
    there.sends = True
    connection._listen(there, is_new=True)
    there.sends = False
    for _ in range(states - 1):
        connection._listen(there, is_new=True)
    with pytest.raises(StreamFault, match=r"silent for (36|40) ms, while states came") as fault:
        connection._listen(there, is_new=True)
    assert fault.value.outcome == "link_lost"
