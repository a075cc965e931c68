"""The functions of URScript that talk to a server over a socket.

Source of names, parameters and answers: Universal Robots, "The URScript Programming Language".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Generator
from typing import Any

from simulator.program import motions
from simulator.urscript.context import ScriptContext
from simulator.urscript.signatures import Signature, signature
from simulator.urscript.values import number, written

CONNECT_S = 2.0  # [s] chosen: a server that does not answer for so long is not there
READ_S = 2.0  # [s] source: URScript manual, the default timeout of every read
VALUES_MAX = 30  # source: URScript manual, values that one call reads
INTEGER_BYTES = 4
SOCKET = "socket_name=socket_0"  # source: URScript manual, the default name

Take = Callable[[bytearray], Any]  # removes and returns what is asked for; None while it is not complete
Waiting = Generator[None, None, Any]


def _open(c: ScriptContext, address: Any, port: Any, name: Any) -> Waiting:
    sock = c.sockets.start(str(address), int(number(port)))
    connected = False
    try:
        for _ in range(motions.cycles(CONNECT_S, c.arm.dt)):
            finished = sock is None or c.sockets.finished(sock, str(name))
            if finished is not None:
                connected = sock is not None and finished
                return connected
            yield
        return False
    finally:  # also where the thread is ended meanwhile
        if sock is not None and not connected:
            sock.close()


def _read(c: ScriptContext, name: Any, timeout: Any, take: Take) -> Waiting:
    """Returns what `take` finds; None once the time is up, or the other side is gone. No time: until there is some."""
    left = motions.cycles(number(timeout), c.arm.dt)
    while True:
        received = c.sockets.received(str(name))
        found = None if received is None else take(received)
        if found is not None:
            return found
        yield  # also without a socket: a loop that reads takes its time
        left -= 1
        if received is None or left == 0:
            return None


def _count(value: Any) -> int:
    count = int(number(value))
    if not 1 <= count <= VALUES_MAX:
        raise ValueError(f"from 1 to {VALUES_MAX} values can be read")
    return count


def _front(data: bytearray, count: int) -> bytes | None:
    """Removes and returns the first bytes, if there are so many."""
    if len(data) < count:
        return None
    found = bytes(data[:count])
    del data[:count]
    return found


def _read_integers(c: ScriptContext, n: Any, name: Any, timeout: Any) -> Waiting:
    count = _count(n)
    found = yield from _read(c, name, timeout, lambda data: _front(data, INTEGER_BYTES * count))
    return [0] + [-1] * count if found is None else [count, *struct.unpack(f">{count}i", found)]


def _read_bytes(c: ScriptContext, n: Any, name: Any, timeout: Any) -> Waiting:
    count = _count(n)
    found = yield from _read(c, name, timeout, lambda data: _front(data, count))
    return [0] + [-1] * count if found is None else [count, *found]


def _read_floats(c: ScriptContext, n: Any, name: Any, timeout: Any) -> Waiting:
    """Reads `(1.5, 2.0)`; what is before the bracket is skipped."""
    count = _count(n)
    found = yield from _read(c, name, timeout, lambda data: _until(data, b")"))
    try:
        values = [float(part) for part in (found or b"").decode("ascii").rpartition("(")[2].split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        return [0.0] + [math.nan] * count
    return [count, *values]


def _until(data: bytearray, end: bytes) -> bytes | None:
    """Removes everything up to an end, and returns it without the end."""
    at = data.find(end)
    if at < 0:
        return None
    found = bytes(data[:at])
    del data[: at + len(end)]
    return found


def _read_text(c: ScriptContext, name: Any, prefix: Any, suffix: Any, interpret_escape: Any, timeout: Any) -> Waiting:
    before = _encoded(prefix, interpret_escape)
    after = _encoded(suffix, interpret_escape)

    def take(data: bytearray) -> bytes | None:
        begin = data.find(before)
        end = data.find(after, begin + len(before)) if after else len(data)
        if not data or begin < 0 or end < 0:
            return None
        found = bytes(data[begin + len(before) : end])
        del data[: end + len(after)]
        return found

    found = yield from _read(c, name, timeout, take)
    return _decoded(found)


def _encoded(text: Any, interpret_escape: Any) -> bytes:
    data = str(text).encode("utf-8")
    if interpret_escape is True or interpret_escape == "True":
        for escaped, byte in ((rb"\n", b"\n"), (rb"\r", b"\r"), (rb"\t", b"\t")):
            data = data.replace(escaped, byte)
    return data


def _decoded(data: bytes | None) -> str:
    return (data or b"").decode("utf-8", "replace")


def _read_line(c: ScriptContext, name: Any, timeout: Any) -> Waiting:
    found = yield from _read(c, name, timeout, lambda data: _until(data, b"\n"))
    return _decoded(found).rstrip("\r")


def _get_variable(c: ScriptContext, variable: Any, name: Any) -> Waiting:
    """Asks `GET name`, and reads the answer `name value`."""
    c.sockets.send(str(name), f"GET {variable}\n".encode())
    answer = yield from _read_line(c, name, READ_S)
    word, _, value = answer.strip().partition(" ")
    try:
        return int(value) if word == variable else 0
    except ValueError:
        return 0


def _set_variable(c: ScriptContext, variable: Any, value: Any, name: Any) -> bool:
    return c.sockets.send(str(name), f"SET {variable} {int(number(value))}\n".encode())


def _send_integer(c: ScriptContext, value: Any, name: Any) -> bool:
    return c.sockets.send(str(name), struct.pack(">I", int(number(value)) % 2**32))


def _send_byte(c: ScriptContext, value: Any, name: Any) -> bool:
    return c.sockets.send(str(name), bytes([int(number(value)) % 256]))


def _send_text(c: ScriptContext, text: Any, name: Any, end: str) -> bool:
    return c.sockets.send(str(name), (_plain(text) + end).encode("utf-8"))


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else written(value)


SOCKET_FUNCTIONS: dict[str, Signature] = {
    "socket_open": signature(f"address port {SOCKET}", _open, waits=True),
    "socket_close": signature(SOCKET, lambda c, name: c.sockets.close(str(name))),
    "socket_read_binary_integer": signature(f"number {SOCKET} timeout={READ_S}", _read_integers, waits=True),
    "socket_read_ascii_float": signature(f"number {SOCKET} timeout={READ_S}", _read_floats, waits=True),
    "socket_read_byte_list": signature(f"number {SOCKET} timeout={READ_S}", _read_bytes, waits=True),
    "socket_read_string": signature(
        f"{SOCKET} prefix= suffix= interpret_escape=False timeout={READ_S}", _read_text, waits=True
    ),
    "socket_read_line": signature(f"{SOCKET} timeout={READ_S}", _read_line, waits=True),
    "socket_get_var": signature(f"name {SOCKET}", _get_variable, waits=True),
    "socket_set_var": signature(f"name value {SOCKET}", _set_variable),
    "socket_send_int": signature(f"value {SOCKET}", _send_integer),
    "socket_send_byte": signature(f"value {SOCKET}", _send_byte),
    "socket_send_string": signature(f"str {SOCKET}", lambda c, text, name: _send_text(c, text, name, "")),
    "socket_send_line": signature(f"str {SOCKET}", lambda c, text, name: _send_text(c, text, name, "\n")),
}
