"""A TCP connection of the controller with its buffers, and the network faults that can be requested of it."""

from __future__ import annotations

import random
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

READ_MAX = 65536  # [bytes]
UNSENT_MAX = 1 << 20  # [bytes] a client that has left this much unread is dropped
LINE_MAX = 65536  # [bytes] a longer line is no request: the connection is closed
RESET = struct.pack("ii", 1, 0)  # SO_LINGER: close with RST instead of FIN


@dataclass
class Disturbance:
    """Network faults of a connection.

    Attributes:
        stalled: whether nothing is read or written.
        delay_s: of everything [s].
        jitter_s: largest further delay; what comes later never overtakes [s].
        drop: share of lost packages.
        draw: source of chance.
    """

    stalled: bool = False
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop: float = 0.0
    draw: random.Random = field(default_factory=lambda: random.Random(0))

    @property
    def delays(self) -> bool:
        """Whether anything is delayed."""
        return self.delay_s > 0.0 or self.jitter_s > 0.0

    def loses(self) -> bool:
        """Draws whether the present package is lost."""
        return self.drop > 0.0 and self.draw.random() < self.drop


class Connection:
    """One accepted socket with its buffers."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket = sock
        self.received, self.unsent = bytearray(), bytearray()
        self.delayed: deque[tuple[float, bytes, bool]] = deque()  # (due [s, monotonic], data, whether incoming)
        self.disturbance = Disturbance()
        self.open = True
        self.backoff = self.waits = 0  # flushes to leave out after a full buffer, and those still to leave out

    def send(self, data: bytes) -> None:
        """Sends as much as the socket takes; `flush` sends the rest."""
        if self.disturbance.delays or self.delayed:
            self._delay(data, incoming=False)
        else:
            self.unsent += data
            self.flush()

    def flush(self) -> None:
        """Sends data left over from earlier calls."""
        if not self.unsent or self.disturbance.stalled or not self.open:
            return
        if self.waits > 0:
            self.waits -= 1
            return
        try:
            del self.unsent[: self.socket.send(self.unsent)]
        except (BlockingIOError, InterruptedError):
            self.open = len(self.unsent) < UNSENT_MAX
            self.waits = self.backoff
        except OSError:
            self.open = False

    def read(self) -> bool:
        """Reads the data that has arrived; returns whether there is something new in `received`."""
        try:
            data = self.socket.recv(READ_MAX)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:
            data = b""
        if not data:
            self.open = False
        elif self.disturbance.delays:
            self._delay(data, incoming=True)
        else:
            self.received += data
            return True
        return False

    def _delay(self, data: bytes, incoming: bool) -> None:
        disturbance = self.disturbance
        due = time.monotonic() + disturbance.delay_s + disturbance.draw.uniform(0.0, disturbance.jitter_s)
        self.delayed.append((max(due, self.delayed[-1][0]) if self.delayed else due, data, incoming))

    def deliver_delayed(self) -> bool:
        """Delivers delayed data that is due; returns whether some of it was incoming."""
        arrived = False
        now = time.monotonic()
        while self.delayed and self.delayed[0][0] <= now and self.open:
            _, data, incoming = self.delayed.popleft()
            if incoming:
                self.received += data
                arrived = True
            else:
                self.unsent += data
                self.flush()
        return arrived

    def expect_deaf_client(self, buffer: int, backoff: int) -> None:
        """Makes a client that does not read cost next to nothing.

        Args:
            buffer: what the kernel keeps for it [bytes]; more would be out of date anyway.
            backoff: flushes to leave out once that is full.
        """
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, buffer)
        self.backoff = backoff

    def take_lines(self) -> Iterator[bytes]:
        """Yields every complete line received and removes it; closes the connection if the rest is too long."""
        while self.open and b"\n" in self.received:
            line, _, rest = bytes(self.received).partition(b"\n")
            self.received[:] = rest
            yield line
        if len(self.received) > LINE_MAX:
            self.open = False

    def close(self, reset: bool = False) -> None:
        """Closes the socket, with RST instead of FIN if `reset`."""
        self.open = False
        if reset:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self.socket.close()


class ConnectionHandler:
    """Handles the connections of a port; by default nothing happens when one opens or ends."""

    def opened(self, connection: Connection) -> None:
        """Handles a new connection."""

    def arrived(self, connection: Connection) -> None:
        """Handles new data in `connection.received`."""
        raise NotImplementedError

    def closed(self, connection: Connection) -> None:
        """Handles the end of a connection."""
