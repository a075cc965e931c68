"""The packages of RTDE, against those of the guide written out by hand."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from executor.rtde_packages import DATA, Recipe, RtdePackages, package

VERSION_TAKEN = b"\x00\x04V\x01"
VERSION_ASKED = b"\x00\x05V\x00\x02"


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    here, there = socket.socketpair()
    with here, there:
        here.settimeout(20.0)
        there.settimeout(20.0)
        yield here, there


def asked(there: socket.socket) -> bytes:
    """Returns what has been sent since the request for the protocol's version."""
    return there.recv(65536).removeprefix(VERSION_ASKED)


def test_packages_are_those_of_the_guide(pair: tuple[socket.socket, socket.socket]) -> None:
    here, there = pair
    there.sendall(VERSION_TAKEN + b"\x00\x11O\x01VECTOR6D,BOOL" + b"\x00\x09I\x02UINT8" + b"\x00\x04S\x01")
    packages = RtdePackages(here)
    assert packages.set_up_outputs(["actual_q", "input_bit_register_64"], 500.0) == Recipe(1, ["VECTOR6D", "BOOL"])
    assert packages.set_up_inputs(["tool_digital_output"]) == Recipe(2, ["UINT8"])
    packages.start()
    sent = b"\x00\x29O\x40\x7f\x40\x00\x00\x00\x00\x00actual_q,input_bit_register_64"
    assert asked(there) == sent + b"\x00\x16Itool_digital_output" + b"\x00\x03S"
    assert package(DATA, b"\x02\x01") == b"\x00\x05U\x02\x01"


def test_packages_in_pieces_are_whole_ones(pair: tuple[socket.socket, socket.socket]) -> None:
    """Others that lie between are passed over; what follows in the same piece is the next."""
    here, there = pair
    there.sendall(VERSION_TAKEN)
    packages = RtdePackages(here)
    for piece in (b"\x00", b"\x06U\x01a", b"b\x00\x05Mhi\x00\x04U"):
        there.sendall(piece)
    assert packages.receive(DATA) == b"\x01ab"
    there.sendall(b"\x02\x00\x03U\x00")
    assert packages.receive(DATA) == b"\x02"
    assert packages.receive(DATA) == b""


@pytest.mark.parametrize(
    "answer", [b"\x00\x03I", b"\x00\x04I\x01", b"\x00\x0fI\x01UINT8,UINT8", b"\x00\x06I\x01\xff\xfe"]
)
def test_an_answer_that_is_not_one_type_a_name_is_an_error(
    pair: tuple[socket.socket, socket.socket], answer: bytes
) -> None:
    here, there = pair
    there.sendall(VERSION_TAKEN + answer)
    packages = RtdePackages(here)
    with pytest.raises(ValueError, match="to the set-up of tool_digital_output_mask, tool_digital_output, x"):
        packages.set_up_inputs(["tool_digital_output_mask", "tool_digital_output", "x"])


def test_what_is_no_rtde_is_told(pair: tuple[socket.socket, socket.socket]) -> None:
    here, there = pair
    there.sendall(b"\x00\x04V\x00")
    with pytest.raises(ValueError, match="does not speak version 2"):
        RtdePackages(here)
    there.sendall(VERSION_TAKEN + b"\x00\x04S\x00" + b"\x00\x02U")
    packages = RtdePackages(here)
    with pytest.raises(ValueError, match="does not start to publish"):
        packages.start()
    with pytest.raises(ValueError, match="shorter than its header"):
        packages.receive(DATA)
    there.shutdown(socket.SHUT_WR)
    with pytest.raises(ConnectionError, match="closed the connection"):
        RtdePackages(here)
