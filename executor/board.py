"""The board: shared memory between the daemon and the streaming process.

The streaming process writes its state, its pulse and one row of telemetry a tick; the daemon writes the abort flag and
its own pulse. Every field is one aligned 8-byte number with one writer, so neither side ever waits for the other.
The memory is an anonymous file whose descriptor the child inherits: it has no name and vanishes with its last owner.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence

HEADER_BYTES = 4096
TEXT_AT = 1024  # [bytes] where the reason stands in the header
TEXT_BYTES = 1024

# What the streaming process is doing.
STARTING, CONNECTED, APPROACHING, STREAMING, BRAKING, STOPPING, DONE, FAULT = range(8)

# Words of the header, the child's first; 16 and up are the daemon's.
STATE, PULSE, ROWS, OUTCOME, MISSED, REALTIME, TEXT_LENGTH = range(7)
OUTPUT_SENT_S, OUTPUT_LATE_S, TIMESTAMP_AT_ZERO, IN_CALL = 7, 8, 9, 10
ABORT, DAEMON_PULSE = 16, 17

VECTORS = ("planned_q", "planned_qd", "command", "q", "qd", "current")  # six numbers each
SCALARS = (
    "clock_s",
    "timestamp_s",
    "host_s",
    "safety_bits",
    "runtime_state",
    "speed_scaling",
    "digital_outputs",
    "missed_ticks",
    "call_s",
)
ROW = struct.Struct(f"{len(SCALARS) + 6 * len(VECTORS)}d")  # scalars, then vectors


class Board:
    """One board for one execution.

    Attributes:
        fd: descriptor of the anonymous file; the child inherits it.
        capacity: rows it can hold; later ones are dropped and counted in `ROWS` alone.
    """

    def __init__(self, fd: int, capacity: int) -> None:
        self.fd, self.capacity = fd, capacity
        self.memory = mmap.mmap(fd, HEADER_BYTES + capacity * ROW.size)
        self.words = memoryview(self.memory)[:TEXT_AT].cast("d")

    @classmethod
    def create(cls, capacity: int) -> Board:
        """Returns a fresh board with room for `capacity` rows."""
        fd = os.memfd_create("fling-board")
        os.ftruncate(fd, HEADER_BYTES + capacity * ROW.size)
        return cls(fd, capacity)

    @classmethod
    def attach(cls, fd: int) -> Board:
        """Returns the board behind an inherited descriptor."""
        return cls(fd, (os.fstat(fd).st_size - HEADER_BYTES) // ROW.size)

    def write_text(self, text: str) -> None:
        """Writes the reason; longer than the field it is cut."""
        data = text.encode()[:TEXT_BYTES]
        self.memory[TEXT_AT : TEXT_AT + len(data)] = data
        self.words[TEXT_LENGTH] = len(data)

    def text(self) -> str:
        """Returns the reason."""
        return self.memory[TEXT_AT : TEXT_AT + int(self.words[TEXT_LENGTH])].decode(errors="replace")

    def add_row(self, values: Sequence[float]) -> None:
        """Appends one row; the count is raised after the row is whole."""
        row = int(self.words[ROWS])
        if row < self.capacity:
            ROW.pack_into(self.memory, HEADER_BYTES + row * ROW.size, *values)
        self.words[ROWS] = row + 1

    def row_bytes(self, first: int = 0) -> bytes:
        """Returns the finished rows from `first` on, packed."""
        last = min(int(self.words[ROWS]), self.capacity)
        return self.memory[HEADER_BYTES + first * ROW.size : HEADER_BYTES + last * ROW.size]

    def close(self) -> None:
        """Lets go of the memory."""
        self.words.release()
        self.memory.close()
        os.close(self.fd)
