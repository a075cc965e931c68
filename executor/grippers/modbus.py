"""Modbus, as far as grippers need it: holding registers are read (3) and written (16), by TCP or in RTU frames.

Source: Modbus application protocol 1.1b3; Modbus over serial line 1.02, RTU framing and its check.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

READ = 3
WRITE = 16
FAILED = 0x80  # added to the function of a request that was refused
POLYNOMIAL = 0xA001
TCP_HEAD = struct.Struct(">HHHB")  # transaction, 0, bytes that follow, slave


def read(first: int, count: int) -> bytes:
    """Returns the request to read `count` registers."""
    return struct.pack(">BHH", READ, first, count)


def write(first: int, values: Sequence[int]) -> bytes:
    """Returns the request to write registers."""
    return struct.pack(f">BHHB{len(values)}H", WRITE, first, len(values), 2 * len(values), *values)


def registers_of(pdu: bytes) -> list[int]:
    """Returns the registers in an answer to `read`; none in any other answer."""
    if len(pdu) < 2 or pdu[0] != READ or len(pdu) != 2 + pdu[1]:
        return []
    return list(struct.unpack(f">{pdu[1] // 2}H", pdu[2:]))


def checksum(frame: bytes | bytearray) -> bytes:
    """Returns the two bytes that end an RTU frame."""
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ POLYNOMIAL if crc & 1 else crc >> 1
    return struct.pack("<H", crc)


def rtu(slave: int, pdu: bytes) -> bytes:
    """Returns an RTU frame."""
    frame = bytes([slave]) + pdu
    return frame + checksum(frame)


def tcp(transaction: int, slave: int, pdu: bytes) -> bytes:
    """Returns a frame of Modbus TCP."""
    return TCP_HEAD.pack(transaction & 0xFFFF, 0, 1 + len(pdu), slave) + pdu


def take_rtu(received: bytearray) -> bytes | None:
    """Takes an answer off the front of what was received on a serial line; None while it is not complete.

    What no answer begins with is dropped: after a disturbance the next answer is found again.
    """
    while len(received) >= 5:
        function = received[1]
        size = 5 if function & FAILED else 8 if function == WRITE else 5 + received[2]
        if function & ~FAILED not in (READ, WRITE):
            del received[0]
        elif len(received) < size:
            return None
        elif checksum(received[: size - 2]) != received[size - 2 : size]:
            del received[0]
        else:
            pdu = bytes(received[1 : size - 2])
            del received[:size]
            return pdu
    return None


def take_tcp(received: bytearray) -> bytes | None:
    """Takes an answer off the front of what was received by TCP; None while it is not complete."""
    if len(received) < TCP_HEAD.size:
        return None
    size = TCP_HEAD.size - 1 + TCP_HEAD.unpack_from(received)[2]
    if len(received) < size:
        return None
    pdu = bytes(received[TCP_HEAD.size : size])
    del received[:size]
    return pdu
