"""The order that a waiting streaming process is given: descriptors over a socket, as unix(7) passes them."""

from __future__ import annotations

import socket
import struct
from dataclasses import dataclass

PULSE = struct.Struct("=q")
DESCRIPTORS_MAX = 3


@dataclass(frozen=True)
class StreamOrder:
    """What a streaming process needs for its one execution.

    Attributes:
        job: descriptor of the file that holds the job.
        memory: descriptor of the memory that it shares with the daemon.
        gripper: descriptor of the connection to a gripper; -1: none.
        pulse: thread of the daemon that writes the pulse.
    """

    job: int
    memory: int
    gripper: int
    pulse: int

    def send(self, channel: socket.socket) -> None:
        """Sends it.

        Raises:
            OSError: nobody is there to take it.
        """
        descriptors = [self.job, self.memory, *([self.gripper] if self.gripper >= 0 else [])]
        socket.send_fds(channel, [PULSE.pack(self.pulse)], descriptors)

    @classmethod
    def wait(cls, channel: socket.socket) -> StreamOrder | None:
        """Waits for the order at the other end; None where that ended without one."""
        data, descriptors, _, _ = socket.recv_fds(channel, PULSE.size, DESCRIPTORS_MAX)
        if len(data) < PULSE.size or len(descriptors) < DESCRIPTORS_MAX - 1:
            return None
        job, memory, *gripper = descriptors
        return cls(job, memory, gripper[0] if gripper else -1, PULSE.unpack(data)[0])
