"""The twin's Modbus, byte by byte: what clients other than Fling's send, and what they are refused."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from simulator.grippers.modbus import ModbusServer, RegisterMap, RtuFraming, TcpFraming


class EightRegisters(RegisterMap):
    """Eight registers from 0 on."""

    def __init__(self) -> None:
        self.values = list(range(8))

    def read(self, first: int, count: int) -> list[int] | None:
        return self.values[first : first + count] if first + count <= 8 else None

    def write(self, first: int, values: list[int]) -> bool:
        if first + len(values) > 8:
            return False
        self.values[first : first + len(values)] = values
        return True


def exchange(server: ModbusServer, request: bytes) -> bytes:
    """Returns what a server answers to a request that arrives byte by byte."""
    sent = bytearray()
    connection = SimpleNamespace(received=bytearray(), send=sent.extend)
    for byte in request:
        connection.received.append(byte)
        server.arrived(connection)
    assert not connection.received
    return bytes(sent)


@pytest.mark.parametrize(
    ("request_pdu", "answer_pdu"),
    [
        ("03 0002 0002", "03 04 0002 0003"),
        ("04 0007 0001", "04 02 0007"),
        ("06 0001 00ff", "06 0001 00ff"),
        ("10 0003 0002 04 0009 0008", "10 0003 0002"),
        ("17 0000 0003 0001 0002 04 000a 000b", "17 06 0000 000a 000b"),  # written first
        ("17 0000 0003 0007 0002 04 000a 000b", "97 02"),
        ("03 0007 0002", "83 02"),
        ("03 0000 0000", "83 02"),
        ("10 0003 0002 02 0009", "90 02"),
        ("17 0000 0003", "97 02"),
        ("2b 0e01 0000", "ab 01"),
    ],
)
def test_requests_over_tcp(request_pdu: str, answer_pdu: str) -> None:
    pdu = bytes.fromhex(request_pdu)
    request = b"\x12\x34\x00\x00" + (1 + len(pdu)).to_bytes(2, "big") + b"\x09" + pdu
    answer = exchange(ModbusServer(TcpFraming(), EightRegisters(), 9), request)
    expected = bytes.fromhex(answer_pdu)
    assert answer == b"\x12\x34\x00\x00" + (1 + len(expected)).to_bytes(2, "big") + b"\x09" + expected


# source: Robotiq, instruction manual of the 2F-85, examples of Modbus RTU
CLOSE = bytes.fromhex("09 10 03 E8 00 03 06 09 00 00 FF FF FF 42 29")
STATUS = bytes.fromhex("09 03 07 D0 00 03 04 0E")


@pytest.mark.parametrize("noise", [b"", b"\x00\xff\x13"])
def test_the_makers_own_frames(noise: bytes) -> None:
    framing = RtuFraming()
    received = bytearray(noise + CLOSE + STATUS)
    assert framing.take(received) == (b"", 9, CLOSE[1:-2])
    assert framing.take(received) == (b"", 9, STATUS[1:-2])
    assert not received


def test_both_at_once_over_the_serial_line() -> None:
    framing = RtuFraming()
    request = framing.frame(b"", 9, bytes.fromhex("17 0000 0001 0000 0001 02 0005"))
    assert exchange(ModbusServer(framing, EightRegisters(), 9), request) == framing.frame(b"", 9, b"\x17\x02\x00\x05")


def test_another_slave_is_not_there() -> None:
    framing = RtuFraming()
    request = framing.frame(b"", 8, bytes.fromhex("03 0000 0001"))
    assert exchange(ModbusServer(framing, EightRegisters(), 9), request) == b""
