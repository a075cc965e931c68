"""The connection to a gripper: the daemon opens it and checks the gripper, the streaming process inherits it.

So it is open before the run, with nothing left to wait for, and a gripper that takes one client has one. If the
streaming process dies, the daemon can still close the gripper over it.
"""

from __future__ import annotations

import contextlib
import socket
import statistics
import time

from executor.grippers.drivers import driver_of
from executor.undelivered import close_in_order, discard_at_close
from planner.grippers import GripperLink

CONNECT_S = 1.0  # [s] a gripper on the controller's network answers within milliseconds
ANSWER_S = 1.0  # [s] longest wait for an answer before a run
LATE_S = 0.05  # [s] a gripper that usually answers later cannot be watched through a launch, which takes some 200 ms
HOLD_CONNECT_S = 0.02  # [s] on the controller's network it takes a millisecond; the arm has to be stopped, too
SAMPLES = 5  # answers that are timed
READ_MAX = 65536  # [bytes]


class GripperUnavailable(Exception):
    """The gripper cannot be used; the text says why."""


class GripperConnection:
    """One connection to one gripper.

    Attributes:
        driver: of the gripper; what it says is of the time before the run.
    """

    def __init__(self, link: GripperLink, controller: str) -> None:
        """Connects, and checks that the gripper is ready.

        Args:
            link: to the gripper.
            controller: address of the controller, where the link gives no other.

        Raises:
            GripperUnavailable: it does not answer, answers too late, or is not ready.
        """
        self.driver = driver_of(link)
        host = link.host or controller
        self._where = f"the gripper at {host}:{link.port}"
        try:
            self._socket = socket.create_connection((host, link.port), CONNECT_S)
        except OSError as error:
            raise GripperUnavailable(f"{self._where} does not answer: {error}") from error
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            discard_at_close(self._socket)
            self._peer = self._socket.getpeername()[:2]  # a number: looking up a name again may take seconds
            self._check()
            self._socket.setblocking(False)
        except (OSError, GripperUnavailable) as error:
            self._socket.close()
            words = str(error) if isinstance(error, GripperUnavailable) else f"does not answer: {error}"
            raise GripperUnavailable(f"{self._where} {words}") from error

    def fileno(self) -> int:
        """Returns the descriptor, for the streaming process to inherit; -1 once it is closed."""
        return self._socket.fileno()

    def hold(self) -> bool:
        """Tells the gripper to close; returns whether that was sent.

        Without waiting, but for a gripper that closes connections by itself: if it has closed this one, another is
        opened, as the streaming process has done.
        """
        request = self.driver.tell(False)
        try:
            if self._is_closed():
                if not self.driver.reconnects:
                    return False
                self._socket.close()
                self._socket = socket.create_connection(self._peer, HOLD_CONNECT_S)
                discard_at_close(self._socket)
            return self._socket.send(request) == len(request)
        except OSError:
            return False

    def _is_closed(self) -> bool:
        """Returns whether the gripper has closed the connection."""
        try:
            while self._socket.recv(READ_MAX):
                pass
        except BlockingIOError:
            return False
        except OSError:
            return True
        return True

    def close(self) -> None:
        """Closes the connection; a command that has not arrived by then is dropped."""
        close_in_order(self._socket)
        with contextlib.suppress(OSError):
            self._socket.close()

    def _check(self) -> None:
        driver = self.driver
        for request in driver.preparation():
            self._answer_s(request)
        if reason := driver.unready():
            raise GripperUnavailable(f"cannot be used: {reason}")
        if not driver.question():
            return
        usual_s = statistics.median(self._answer_s(driver.question()) for _ in range(SAMPLES))
        if usual_s > LATE_S:
            raise GripperUnavailable(f"answers after {1e3 * usual_s:.0f} ms: a throw needs {1e3 * LATE_S:.0f} ms")

    def _answer_s(self, request: bytes) -> float:
        """Sends a request; returns how long its answer took [s]."""
        began = time.monotonic()
        self._socket.settimeout(ANSWER_S)
        self._socket.sendall(request)
        received = bytearray()
        while not self.driver.take(received):
            if time.monotonic() - began > ANSWER_S:
                raise GripperUnavailable("does not answer")
            data = self._socket.recv(READ_MAX)
            if not data:
                raise GripperUnavailable("closed the connection")
            received += data
        return time.monotonic() - began
