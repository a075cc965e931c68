"""What a TCP socket still has to deliver when it is closed, or its process dies.

The kernel goes on for minutes by itself: once the cable is in again, a gripper would open at rest, after its run has
ended and was told as held. Source: tcp(7), socket(7), SO_LINGER.
"""

from __future__ import annotations

import fcntl
import socket
import struct
import termios
import time

DELIVERED_WITHIN_S = 0.5  # [s] Linux sends a lone package that was lost again after some 200 ms (TCP_RTO_MIN)
LINGER = struct.Struct("ii")  # source: socket(7), struct linger: on, seconds
POLL_S = 0.002


def discard_at_close(connection: socket.socket) -> None:
    """Has the kernel drop what is not delivered when the last process closes the socket; the peer sees a reset."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 0))


def undelivered(connection: socket.socket) -> int:
    """Returns how many bytes the peer has not acknowledged.

    Raises:
        OSError, ValueError: it is not connected any more, or closed.
    """
    return struct.unpack("i", fcntl.ioctl(connection, termios.TIOCOUTQ, b"\0" * 4))[0]


def close_in_order(connection: socket.socket, within_s: float = DELIVERED_WITHIN_S) -> bool:
    """Prepares an orderly close, once all is delivered; otherwise what is not stays to be dropped.

    Args:
        connection: a socket after `discard_at_close`.
        within_s: longest wait [s].

    Returns:
        Whether all is delivered.
    """
    end = time.monotonic() + within_s
    try:
        while undelivered(connection) and time.monotonic() < end:
            time.sleep(POLL_S)
        if undelivered(connection):
            return False
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(0, 0))
    except (OSError, ValueError):  # closed meanwhile: nothing of it goes out any more
        return False
    return True
