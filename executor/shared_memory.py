"""Memory shared by the daemon and the streaming process, one block an execution.

The streaming process writes its state, its pulse and one telemetry row a tick; the daemon writes the abort flag and its
own pulse, and offers jobs that are to replace the running one. Every field is one aligned 8-byte number with one
writer: neither side waits for the other. The memory is an anonymous file inherited by the child; it vanishes with its
last owner.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from math import nan

HEADER_BYTES = 4096
TEXT_AT = 1024  # [bytes] offset of the reason in the header
TEXT_BYTES = 1024
SWITCHED_AT = 2048  # [bytes] offset of when the outputs of passages were switched, to the header's end
SWITCHES_MAX = (HEADER_BYTES - SWITCHED_AT) // 8  # outputs that one execution can switch; a plan's are 160 at most
OFFER_BYTES = 3 << 20  # of a job that is offered: 24 s at 500 Hz
PLACES = 2  # behind the rows, for such jobs: the stream may go by one while the next is offered

# States of the streaming process.
STARTING, APPROACHING, STREAMING, BRAKING, STOPPING, DONE, FAULT = range(7)

# Header fields. The daemon writes 16, 17, 19 and 20, the streaming process the others.
STATE, PULSE, ROWS, OUTCOME, MISSED, REALTIME, TEXT_LENGTH = range(7)
OUTPUT_SENT_S = 7
OUTPUT_LATE_S = 8
TIMESTAMP_AT_ZERO = 9
IN_CALL = 10
FURTHEST = 11  # the last of APPROACHING and STREAMING that was entered; 0 before
OUTPUT_CLOSED_S = 12
STAYED_CLOSED = 13
SHUT_AT_S = 14  # controller's times between which the fingers of a gripper began to open
MOVED_BY_S = 15
ABORT = 16
DAEMON_PULSE = 17
STOPPED_S = 18  # plan time at which a brake ended the switching of a plan's outputs
OFFERED = 19  # number of the newest job that was offered; 0: none was
OFFERED_PLACE = 20  # where that is
ANSWERED = 21  # number of the newest one that was answered
TAKEN = 22  # number of the one that the stream goes by; 0: the job that it was started with
READY_AT_S = 23  # when the arm stood at the plan's start, the gripper closed [s, monotonic]; 0: it did not
GRIP = 24  # what was seen of the grip before the motion: one of the next four
GRIP_UNSEEN, GRIP_HELD, GRIP_EMPTY, GRIP_REOPENED = range(4)  # found closed and empty; closed on nothing, opened again

# Columns of a telemetry row: the scalars, then the vectors of six.
SCALARS = (
    "clock_s",
    "timestamp_s",
    "host_s",
    "safety_bits",
    "runtime_state",
    "speed_scaling",
    "digital_outputs",
    "digital_inputs",
    "missed_ticks",
    "call_s",
)
VECTORS = ("planned_q", "planned_qd", "command", "q", "qd", "current")
ROW = struct.Struct(f"{len(SCALARS) + 6 * len(VECTORS)}d")


class SharedMemory:
    """The shared memory of one execution.

    Attributes:
        fd: descriptor of the anonymous file; the child inherits it.
        capacity: number of rows it holds; later rows are dropped, and counted in `ROWS` only.
        fields: the header fields above, as numbers.
        switched: when each output of a job's passages was switched, on the plan's clock [s]; NaN for never.
    """

    def __init__(self, fd: int, capacity: int) -> None:
        self.fd = fd
        self.capacity = capacity
        memory = mmap.mmap(fd, _size(capacity))
        self.memory: mmap.mmap | None = memory
        self.fields: memoryview[float] | list[float] = memoryview(memory)[:TEXT_AT].cast("d")
        self.switched: memoryview[float] | list[float] = memoryview(memory)[SWITCHED_AT:HEADER_BYTES].cast("d")

    @classmethod
    def create(cls, capacity: int) -> SharedMemory:
        """Returns fresh memory with room for `capacity` rows."""
        fd = os.memfd_create("fling-shared-memory")
        os.ftruncate(fd, _size(capacity))
        made = cls(fd, capacity)
        for i in range(len(made.switched)):
            made.switched[i] = nan
        return made

    @classmethod
    def attach(cls, fd: int) -> SharedMemory:
        """Returns the memory behind an inherited descriptor."""
        return cls(fd, (os.fstat(fd).st_size - _size(0)) // ROW.size)

    def write_text(self, text: str) -> None:
        """Writes the reason, cut to the length of its field."""
        assert self.memory is not None
        data = text.encode()[:TEXT_BYTES]
        self.memory[TEXT_AT : TEXT_AT + len(data)] = data
        self.fields[TEXT_LENGTH] = len(data)

    def text(self) -> str:
        """Returns the reason."""
        assert self.memory is not None
        return self.memory[TEXT_AT : TEXT_AT + int(self.fields[TEXT_LENGTH])].decode(errors="replace")

    def offer(self, job: bytes, place: int) -> None:
        """Offers a job of up to `OFFER_BYTES` to the streaming process, at a place where it goes by none."""
        memory = self.memory
        if memory is None:
            return
        at = _size(self.capacity) - (PLACES - place) * OFFER_BYTES
        memory[at : at + len(job)] = job
        self.fields[OFFERED_PLACE] = place
        self.fields[OFFERED] += 1.0  # last: what is offered is complete

    def offered(self) -> memoryview:
        """Returns the memory of the job that is offered."""
        assert self.memory is not None
        at = _size(self.capacity) - (PLACES - int(self.fields[OFFERED_PLACE])) * OFFER_BYTES
        return memoryview(self.memory)[at : at + OFFER_BYTES]

    def add_row(self, values: Sequence[float]) -> None:
        """Appends one row; the count rises after the row is complete."""
        row = int(self.fields[ROWS])
        if row < self.capacity and self.memory is not None:
            ROW.pack_into(self.memory, HEADER_BYTES + row * ROW.size, *values)
        self.fields[ROWS] = row + 1

    def row_bytes(self, first: int = 0) -> bytes:
        """Returns the complete rows from `first` on, packed; none once the memory is given back."""
        last = min(int(self.fields[ROWS]), self.capacity)
        memory = self.memory
        return b"" if memory is None else memory[HEADER_BYTES + first * ROW.size : HEADER_BYTES + last * ROW.size]

    def close(self) -> None:
        """Gives the memory and its descriptor back; the fields keep their last values, and the rows are gone.

        The mapping itself ends with the last reader that is just at it in another thread.
        """
        self.fields = list(self.fields)
        self.switched = list(self.switched)
        self.memory = None
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def _size(capacity: int) -> int:
    """Returns the bytes of a memory with room for so many rows."""
    return HEADER_BYTES + capacity * ROW.size + PLACES * OFFER_BYTES
