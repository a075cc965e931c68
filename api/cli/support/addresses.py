"""Addresses that a command needs: whether they are free, and who uses them."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterable

import click

# source: docs/simulator.md
SIMULATOR_PORTS = (29900, 29901, 29980, 29999, 30001, 30002, 30003, 30004, 30011, 30012, 30013, 30020)
ANY = ("0.0.0.0", "::")
COMMAND_WORDS = 4  # of a process in a message: enough to recognise it


def require_free(host: str, ports: Iterable[int], what: str, advice: str) -> None:
    """Checks that nobody listens on these ports.

    Args:
        host: address to listen on.
        ports: on it.
        what: needs them, such as "the service".
        advice: what else to do than to stop who uses them.

    Raises:
        click.ClickException: an address is used, or is none of this machine; says by whom and what to do.
    """
    for port in ports:
        reason = _refusal(host, port)
        if reason is not None:
            raise click.ClickException(f"{what} cannot listen on {host}:{port}: {reason}; {advice}")


def _refusal(host: str, port: int) -> str | None:
    """Returns why one cannot listen on an address, None where one can."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        return error.strerror or str(error)
    try:
        socket.create_server(address[:2], family=family).close()
        return None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return f"it is used by {_user_of(str(address[0]), port)}"
        return error.strerror or str(error)


def _user_of(address: str, port: int) -> str:
    """Returns the process that listens on a port, as far as this user may know."""
    import psutil

    try:
        for connection in psutil.net_connections("tcp"):
            if connection.status != psutil.CONN_LISTEN or not connection.laddr or connection.pid is None:
                continue
            ip, number = connection.laddr
            if number == port and ip in (address, *ANY):
                command = " ".join(psutil.Process(connection.pid).cmdline()[:COMMAND_WORDS])
                return f"process {connection.pid} ({command}): stop it"
    except psutil.Error:
        pass
    return "another process: stop it"
