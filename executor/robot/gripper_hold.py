"""A second way to the gripper's output, for the daemon: hold the object when the streaming process cannot.

The output is set by a secondary program over the secondary client interface: it runs beside whatever plays, and needs
no RTDE input, which one client alone may own. Source: Universal Robots, URScript manual, secondary programs.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Sequence

from executor.grippers import PROGRAM
from executor.stream_job import StreamJob
from executor.undelivered import close_in_order, discard_at_close
from planner.grippers import SET_OUTPUT

PORT = 30002
CONNECT_S = 0.5  # [s] a controller answers within milliseconds; without this interface a run goes on


class GripperHold:
    """A connection that is opened before the run, so that one packet is enough."""

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket: socket.socket | None = None

    def connect(self) -> None:
        """Connects; without this interface nothing can be held."""
        with contextlib.suppress(OSError):
            self._socket = socket.create_connection((self.host, PORT), CONNECT_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            discard_at_close(self._socket)
            self._socket.setblocking(False)

    def drain(self) -> None:
        """Discards the states that the controller sends here ten times a second; never waits."""
        if self._socket is not None:
            with contextlib.suppress(BlockingIOError, OSError):
                while self._socket.recv(65536):
                    pass

    def hold(self, job: StreamJob) -> bool:
        """Closes a run's gripper again; returns whether that was sent."""
        levels = [(job.output, job.output_index, not job.output_level)]
        if job.second is not None:
            levels.append((job.second.output, job.second.index, not job.second.open_level))
        return self._set(levels)

    def end_blowing(self, job: StreamJob) -> bool:
        """Ends what a run's second output does for a while, if it does; returns whether that was sent."""
        second = job.second
        if second is None or second.lasts_s is None:
            return False
        return self._set([(second.output, second.index, not second.open_level)])

    def _set(self, levels: Sequence[tuple[str, int, bool]]) -> bool:
        if self._socket is None:
            return False
        lines = [f"  {SET_OUTPUT[output]}({index}, {level})" for output, index, level in levels]
        script = "\n".join([f"sec {PROGRAM}():", *lines, "end", ""])
        try:
            return self._socket.send(script.encode()) == len(script)
        except OSError:
            return False

    def close(self) -> None:
        """Closes the connection, if any."""
        if self._socket is not None:
            close_in_order(self._socket)
            self._socket.close()
            self._socket = None
