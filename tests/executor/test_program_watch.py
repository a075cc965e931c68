"""What the executor reads from the primary interface: bytes as UR documents them, over a socket pair."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import pytest

from executor.robot import ProgramWatch, stop_program
from executor.robot.primary import PORT


def message(kind: int, body: bytes) -> bytes:
    return struct.pack(">iBQbB", 15 + len(body), 20, 1, -2, kind) + body


def key(word: str, program: str) -> bytes:
    title = f"PROGRAM_XXX_{word}".encode()
    return message(7, struct.pack(">iiB", 0, 0, len(title)) + title + program.encode())


def exception(text: str) -> bytes:
    return message(10, struct.pack(">ii", 2, 3) + text.encode())


OWN = key("STARTED", "rtde_control")
STATE = struct.pack(">iB", 9, 16) + b"\0\0\0\4"
EARLIER = key("STARTED", "other") + key("STOPPED", "other")


@pytest.fixture
def watch() -> Iterator[tuple[ProgramWatch, socket.socket]]:
    watch = ProgramWatch("127.0.0.1")
    watch._socket, controller = socket.socketpair()
    watch._socket.setblocking(False)
    yield watch, controller
    watch.close()
    controller.close()


@pytest.mark.parametrize(
    ("data", "foreign"),
    [
        (EARLIER + OWN + STATE, ""),  # ended before ours started
        (OWN + key("STOPPED", "rtde_control"), ""),  # the stop button
        (OWN + exception("another thread is already controlling the robot"), ""),  # our own program's error
        (OWN + key("STOPPED", "rtde_control") + STATE + key("STARTED", "mine"), "the program 'mine'"),
        (OWN + key("STOPPED", "mine") + key("STARTED", "third"), "the program 'mine'"),  # the first one
        (OWN + exception("compile_error_name_not_found:x:"), "did not compile (compile_error_name_not_found:x:)"),
        (OWN + exception("syntax_error_on_line:1:(:"), "did not compile"),
    ],
)
def test_a_foreign_program_is_one_that_comes_after_ours(
    watch: tuple[ProgramWatch, socket.socket], data: bytes, foreign: str
) -> None:
    programs, controller = watch
    for at in range(0, len(data), 7):  # however it is cut
        controller.sendall(data[at : at + 7])
        programs.poll()
    assert (foreign in programs.foreign) if foreign else programs.foreign == ""


def test_waiting_ends_with_the_news_or_the_connection(watch: tuple[ProgramWatch, socket.socket]) -> None:
    programs, controller = watch
    controller.sendall(OWN)
    programs.poll()
    threading.Timer(0.05, lambda: controller.sendall(key("STARTED", "mine"))).start()
    assert programs.wait(30.0) == "the program 'mine'"
    controller.close()
    programs.foreign = ""
    assert programs.wait(30.0) == ""


@pytest.mark.parametrize(
    "data", [b"\xff" * 40, b"\0\0\0\0\0\0", message(7, b"\0"), message(10, b""), OWN + b"\0\0\0\1\0"]
)
def test_nonsense_is_ignored_or_ends_the_connection(watch: tuple[ProgramWatch, socket.socket], data: bytes) -> None:
    programs, controller = watch
    controller.sendall(data)
    programs.poll()
    assert programs.foreign == ""


def test_without_the_interface_a_run_goes_on() -> None:
    with socket.socket() as free:
        free.bind(("127.99.1.7", PORT))  # nobody listens there
        programs = ProgramWatch("127.99.1.7")
        programs.connect()
        programs.poll()
        assert programs.wait(30.0) == ""


def test_a_stop_goes_over_the_connection_that_is_open(watch: tuple[ProgramWatch, socket.socket]) -> None:
    programs, controller = watch
    assert programs.is_connected
    programs.stop()
    assert controller.recv(100) == b"stop program\n"


@pytest.mark.parametrize("ends", [True, False])
def test_a_stop_finds_its_way_where_that_connection_has_ended(ends: bool) -> None:
    """A controller that sends states all the while: a stop whose connection is closed over them may be lost."""
    with socket.create_server(("127.99.1.8", PORT)) as listener:
        programs = ProgramWatch("127.99.1.8")
        programs.connect()
        first, _ = listener.accept()
        first.close()
        received: list[bytes] = []

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(STATE * 1000)
                received.append(connection.recv(100))
                if not ends:
                    received.append(connection.recv(100))  # nothing more; no reset either

        server = threading.Thread(target=serve)
        server.start()
        programs.poll()
        programs.stop()
        server.join(30.0)
        programs.close()
    assert b"".join(received) == b"stop program\n"


def test_without_the_interface_a_stop_does_nothing() -> None:
    stop_program("127.99.1.9")
