"""Modbus as a server: registers are read (3, 4) and written (6, 16), in frames of Modbus TCP or of RTU.

Source: Modbus application protocol 1.1b3; Modbus over serial line 1.02.
"""

from __future__ import annotations

import struct
from typing import Protocol

from simulator.interfaces import Connection, ConnectionHandler

READS = (3, 4)
WRITE_ONE = 6
WRITE = 16
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
            size = 9 + received[6] if received[1] == WRITE else 8
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
        if function not in (*READS, WRITE_ONE, WRITE) or len(pdu) < 5:
            return bytes([function | REFUSED, ILLEGAL_FUNCTION])
        first, second = struct.unpack_from(">HH", pdu, 1)
        if function in READS:
            found = self.registers.read(first, second) if 0 < second <= REGISTERS_MAX else None
            if found is not None:
                return struct.pack(f">BB{second}H", function, 2 * second, *found)
        elif function == WRITE_ONE:
            if self.registers.write(first, [second]):
                return pdu[:5]
        elif 0 < second <= REGISTERS_MAX and len(pdu) == 6 + 2 * second:
            values = [*struct.unpack_from(f">{second}H", pdu, 6)]
            if self.registers.write(first, values):
                return pdu[:5]
        return bytes([function | REFUSED, ILLEGAL_ADDRESS])


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
