"""Modbus as a server: registers are read (3, 4), written (6, 16), or both (23), in frames of Modbus TCP or of RTU.

Source: Modbus application protocol 1.1b3; Modbus over serial line 1.02.
"""

from __future__ import annotations

import struct
from typing import Protocol

from simulator.interfaces import Connection, ConnectionHandler

READS = (3, 4)
WRITE_ONE = 6
WRITE = 16
READ_WRITE = 23
REFUSED = 0x80
ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
BROADCAST = 0
REGISTERS_MAX = 123  # in one request


class RegisterMap(Protocol):
    """The registers of a device."""

    def read(self, first: int, count: int) -> list[int] | None:
        """Returns registers; None where there are no such."""
        ...

    def write(self, first: int, values: list[int]) -> bool:
        """Takes registers; returns whether there are such."""
        ...


class Framing(Protocol):
    """How requests and answers are told apart on a stream."""

    def take(self, received: bytearray) -> tuple[bytes, int, bytes] | None:
        """Takes a request off the front; returns what its answer repeats, slave and request; None: not complete."""
        ...

    def frame(self, repeats: bytes, slave: int, pdu: bytes) -> bytes:
        """Returns the frame of an answer."""
        ...


class TcpFraming:
    """A head of seven bytes: transaction, protocol 0, number of bytes that follow, slave."""

    def take(self, received: bytearray) -> tuple[bytes, int, bytes] | None:
        """Takes a request."""
        if len(received) < 8:
            return None
        transaction, _, length = struct.unpack_from(">HHH", received)
        if len(received) < 6 + length:
            return None
        slave = received[6]
        pdu = bytes(received[7 : 6 + length])
        del received[: 6 + length]
        return struct.pack(">H", transaction), slave, pdu

    def frame(self, repeats: bytes, slave: int, pdu: bytes) -> bytes:
        """Returns an answer."""
        return repeats + struct.pack(">HHB", 0, 1 + len(pdu), slave) + pdu


class RtuFraming:
    """Slave, request, and two bytes that check them. What is no request is skipped, byte by byte."""

    def take(self, received: bytearray) -> tuple[bytes, int, bytes] | None:
        """Takes a request."""
        while len(received) >= 8:
            count_at = {WRITE: 6, READ_WRITE: 10}.get(received[1])  # the byte that counts those which follow
            if count_at is not None and len(received) <= count_at:
                return None
            size = 8 if count_at is None else count_at + 3 + received[count_at]
            if len(received) < size:
                return None
            if _crc(received[: size - 2]) == received[size - 2 : size]:
                slave = received[0]
                pdu = bytes(received[1 : size - 2])
                del received[:size]
                return b"", slave, pdu
            del received[0]
        return None

    def frame(self, repeats: bytes, slave: int, pdu: bytes) -> bytes:
        """Returns an answer."""
        body = bytes([slave]) + pdu
        return body + _crc(body)


class ModbusServer(ConnectionHandler):
    """Answers for one slave; others are not there, and requests to them stay without an answer."""

    def __init__(self, framing: Framing, registers: RegisterMap, slave_id: int) -> None:
        self.framing = framing
        self.registers = registers
        self.slave_id = slave_id

    def arrived(self, connection: Connection) -> None:
        """Answers every complete request."""
        while (request := self.framing.take(connection.received)) is not None:
            repeats, slave, pdu = request
            if slave in (self.slave_id, BROADCAST) and pdu:
                connection.send(self.framing.frame(repeats, slave, self._answer(pdu)))

    def _answer(self, pdu: bytes) -> bytes:
        function = pdu[0]
        if function not in (*READS, WRITE_ONE, WRITE, READ_WRITE) or len(pdu) < 5:
            return bytes([function | REFUSED, ILLEGAL_FUNCTION])
        first, second = struct.unpack_from(">HH", pdu, 1)
        if function == WRITE_ONE:
            done = self.registers.write(first, [second])
        elif function == WRITE:
            done = self._write(pdu, 1)
        else:  # what is written takes effect before the rest is read
            done = function in READS or self._write(pdu, 5)
            found = self.registers.read(first, second) if done and 0 < second <= REGISTERS_MAX else None
            if found is not None:
                return struct.pack(f">BB{second}H", function, 2 * second, *found)
            done = False
        return pdu[:5] if done else bytes([function | REFUSED, ILLEGAL_ADDRESS])

    def _write(self, pdu: bytes, at: int) -> bool:
        """Writes the registers that a request lists from its byte `at` on; returns whether it could."""
        if len(pdu) < at + 5:
            return False
        first, count = struct.unpack_from(">HH", pdu, at)
        if not 0 < count <= REGISTERS_MAX or len(pdu) != at + 5 + 2 * count:
            return False
        return self.registers.write(first, [*struct.unpack_from(f">{count}H", pdu, at + 5)])


def _crc(data: bytes | bytearray) -> bytes:
    """Returns CRC-16/MODBUS, low byte first."""
    remainder = 0xFFFF
    for value in data:
        remainder ^= value
        for _ in range(8):
            bit = remainder & 1
            remainder >>= 1
            if bit:
                remainder ^= 0xA001
    return bytes([remainder & 0xFF, remainder >> 8])
