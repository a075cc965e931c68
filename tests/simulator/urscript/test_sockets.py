"""The sockets that a script opens, against a server of this process; the controller is driven cycle by cycle."""

from __future__ import annotations

import errno
import math
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress

import pytest

from simulator.program.runner import STOPPED
from tests.simulator.conftest import Driven, make_cell

CYCLES = 3000  # longer than any script here
DT = 0.002


class ListeningServer:
    """A server, and the connection to it that a script opened."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.setblocking(False)
        self.port = self.listener.getsockname()[1]
        self.connection: socket.socket | None = None
        self.received = b""

    def poll(self) -> None:
        """Accepts, and reads what has arrived."""
        with suppress(BlockingIOError):
            if self.connection is None:
                self.connection, _ = self.listener.accept()
                self.connection.setblocking(False)
            self.received += self.connection.recv(65536)

    def close(self) -> None:
        if self.connection is not None:
            self.connection.close()
        self.listener.close()


class Scripted(Driven):
    """A controller that runs a script beside a server, which it serves in every cycle."""

    def __init__(self, server: ListeningServer) -> None:
        super().__init__(make_cell())
        self.server = server

    def run(self, body: str, sent: bytes = b"", cycles: int = CYCLES) -> float:
        """Runs a body after the socket is open, the server sends this at once; returns the time it took [s]."""
        opens = f'  opened = socket_open("127.0.0.1", {self.server.port})\n'
        lines = "".join(f"  {line}\n" for line in body.splitlines())
        self.controller.runner.upload(f"def program():\n{opens}{lines}end\n")
        while self.controller.runner.due:
            self.cycle()
        begin = self.controller.timeline.t
        while self.controller.runner.playing and cycles:
            self.cycle()
            self.server.poll()
            if self.server.connection is not None and sent:
                self.server.connection.sendall(sent)
                sent = b""
            cycles -= 1
        return self.controller.timeline.t - begin

    def floats(self, count: int) -> list[float]:
        return self.out_doubles(count)


@pytest.fixture
def server() -> Iterator[ListeningServer]:
    server = ListeningServer()
    yield server
    server.close()


@pytest.fixture
def controller(server: ListeningServer) -> Iterator[Scripted]:
    scripted = Scripted(server)
    yield scripted
    scripted.controller.runner.stop("the test is over")


def test_everything_that_is_sent_arrives_in_its_form(controller: Scripted, server: ListeningServer):
    controller.run(
        """sent = socket_send_int(-2) and socket_send_byte(300)
socket_send_string("abc")
socket_send_string([1, 2.5])
socket_send_line("line")
socket_set_var("count", 7)
write_output_boolean_register(0, opened and sent)
sleep(0.01)"""
    )
    server.poll()
    assert controller.controller.registers.bit_out[0]
    assert server.received == struct.pack(">i", -2) + b"\x2cabc[1, 2.5]line\nSET count 7\n"


READS = [
    ("socket_read_binary_integer(3)", struct.pack(">3i", 5, -6, 2**31 - 1), [3, 5, -6, 2**31 - 1]),
    ("socket_read_byte_list(2)", b"\x05\xff", [2, 5, 255]),
    ("socket_read_ascii_float(2)", b"( 1.5, -2e3 )", [2, 1.5, -2000.0]),
    ('[to_num(socket_read_string(prefix="<", suffix=">"))]', b"x<42>y", [42]),
    ("[to_num(socket_read_line())]", b"7\r\n8\n", [7]),
    ('[socket_get_var("count")]', b"count 12\n", [12]),
]


@pytest.mark.parametrize(("expression", "sent", "values"), READS)
def test_what_the_server_sends_is_read(controller: Scripted, expression: str, sent: bytes, values: list[float]):
    writes = "".join(f"\nwrite_output_float_register({i}, values[{i}])" for i in range(len(values)))
    taken = controller.run(f"values = {expression}{writes}", sent)
    assert controller.floats(len(values)) == values
    assert taken < 0.05


def test_a_read_waits_for_the_rest_and_leaves_what_comes_after(controller: Scripted):
    sent = struct.pack(">3i", 1, 2, 3)
    body = """first = socket_read_binary_integer(1, timeout=0)
second = socket_read_binary_integer(2, "socket_0", 0.1)
third = socket_read_binary_integer(1, timeout=0.1)
write_output_float_register(0, first[1])
write_output_float_register(1, second[2])
write_output_float_register(2, third[0])
write_output_float_register(3, third[1])"""
    taken = controller.run(body, sent)
    assert controller.floats(4) == [1, 3, 0, -1]
    assert taken == pytest.approx(0.1, abs=0.02)  # the third waited in vain


@pytest.mark.parametrize(
    ("expression", "values"),
    [
        ("socket_read_binary_integer(2, timeout=0.05)", [0, -1, -1]),
        ("socket_read_byte_list(2, timeout=0.05)", [0, -1, -1]),
        ("socket_read_ascii_float(2, timeout=0.05)", [0, math.nan, math.nan]),
    ],
)
def test_nothing_comes_in_time(controller: Scripted, expression: str, values: list[float]):
    writes = "".join(f"\nwrite_output_float_register({i}, values[{i}])" for i in range(len(values)))
    taken = controller.run(f"values = {expression}{writes}")
    assert controller.floats(len(values)) == pytest.approx(values, nan_ok=True)
    assert taken == pytest.approx(0.05, abs=0.02)


def test_the_arm_moves_while_another_thread_waits_for_a_socket(controller: Scripted):
    body = """thread reads():
  socket_read_binary_integer(1, timeout=0)
end
run reads()
speedj([0.3, 0, 0, 0, 0, 0], 10, 0.2)
write_output_float_register(0, get_target_joint_speeds()[0])"""
    taken = controller.run(body)
    assert controller.floats(1) == [0.3]
    assert taken == pytest.approx(0.2, abs=0.02)


def test_a_reader_learns_of_the_other_sides_end_and_its_loop_holds_up_nobody(
    controller: Scripted, server: ListeningServer
):
    controller.run("while True:\n  socket_read_binary_integer(1, timeout=0)\nend", cycles=50)
    assert server.connection is not None
    server.connection.close()
    program = controller.controller.runner.program
    assert program is not None
    controller.cycle(10)
    assert program.spent < 10
    assert controller.controller.runner.playing


def test_nobody_listens(controller: Scripted, server: ListeningServer):
    server.listener.close()
    controller.run("write_output_boolean_register(0, not opened and not socket_send_int(1))")
    assert controller.controller.registers.bit_out[0]


@pytest.mark.parametrize(
    "wrong",
    [
        'socket_open("example.org", 80)',
        "socket_read_binary_integer(31)",
        'socket_open("127.0.0.1", "x")',
    ],
)
def test_what_cannot_be_ends_the_program(controller: Scripted, wrong: str):
    controller.run(f"{wrong}\nwrite_output_float_register(0, 1)")
    assert controller.controller.runner.runtime == STOPPED
    assert controller.floats(1) == [0.0]


@pytest.mark.parametrize("end", ["its end", "a stop", "another program", "socket_close"])
def test_a_socket_ends_with_its_program(controller: Scripted, server: ListeningServer, end: str):
    body = {"its end": "sleep(0.02)", "socket_close": "socket_close()\nsleep(10)"}.get(end, "sleep(10)")
    controller.run(body, cycles=40)
    if end == "a stop":
        controller.controller.stops.emergency()
    elif end == "another program":
        controller.controller.runner.upload("sleep(1)\n")
    assert server.connection is not None
    server.connection.setblocking(True)
    server.connection.settimeout(1.0)
    assert server.connection.recv(1) == b""


@pytest.mark.parametrize("address", ["127.0.0.1 foo", "127.1", "1", "::1"])
def test_an_address_that_is_not_numeric_is_an_error_and_nothing_is_looked_up(
    controller: Scripted, server: ListeningServer, monkeypatch: pytest.MonkeyPatch, address: str
):
    def connect_ex(*_: object) -> int:
        raise AssertionError("connects to what is no address")

    monkeypatch.setattr(socket.socket, "connect_ex", connect_ex)
    controller.controller.runner.upload(f'socket_open("{address}", {server.port})\n')
    controller.cycle(100)
    assert controller.controller.runner.runtime == STOPPED
    assert f"{address!r} is no numeric IPv4 address" in str(controller.controller.timeline.events)


@pytest.mark.parametrize("refused", ["__init__", "connect_ex"])
def test_a_system_that_gives_no_socket_is_not_connected(
    controller: Scripted, monkeypatch: pytest.MonkeyPatch, refused: str
):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(socket.socket, refused, refuse)
    controller.run("write_output_boolean_register(0, not opened)")
    monkeypatch.undo()
    assert controller.controller.registers.bit_out[0]


@pytest.mark.parametrize("read", ["socket_read_line(timeout=0)", 'socket_read_string(prefix="<", timeout=0)'])
def test_what_nobody_reads_is_held_back_from_its_sender(controller: Scripted, server: ListeningServer, read: str):
    controller.run(read, cycles=50)
    assert server.connection is not None
    for _ in range(100):
        with suppress(BlockingIOError):
            server.connection.send(b"x" * 65536)
        controller.cycle()
    program = controller.controller.runner.program
    assert program is not None
    assert len(program.context.sockets.by_name["socket_0"].received) <= 2 * 65536
