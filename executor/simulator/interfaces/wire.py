"""The RTDE package: uint16 size (header included), uint8 type, body; big-endian.

Source: Universal Robots, RTDE guide, "Protocol"; the tables are in docs/simulator.md.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

HEADER = struct.Struct(">HB")
PROTOCOL_VERSION = 2

REQUEST_PROTOCOL_VERSION = 86  # V
GET_CONTROLLER_VERSION = 118  # v
TEXT_MESSAGE = 77  # M
DATA_PACKAGE = 85  # U
SETUP_OUTPUTS = 79  # O
SETUP_INPUTS = 73  # I
START = 83  # S
PAUSE = 80  # P

PACKAGE_MAX = 65535  # [bytes] the size field is a uint16


class MalformedPackage(Exception):
    """Received bytes that are no RTDE package, or a package whose body does not fit its type."""


def package(kind: int, body: bytes = b"") -> bytes:
    """Returns the bytes of a package of type `kind`.

    Raises:
        MalformedPackage: the body does not fit the size field.
    """
    size = HEADER.size + len(body)
    if size > PACKAGE_MAX:
        raise MalformedPackage(f"a body of {len(body)} bytes does not fit a package")
    return HEADER.pack(size, kind) + body


def take_packages(buffer: bytearray) -> Iterator[tuple[int, bytes]]:
    """Yields (type, body) of every complete package at the front of `buffer`, and removes it.

    Raises:
        MalformedPackage: the size field is smaller than the header itself.
    """
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if size < HEADER.size:
            raise MalformedPackage(f"size field of {size} bytes")
        if len(buffer) < size:
            return
        body = bytes(buffer[HEADER.size : size])
        del buffer[:size]
        yield kind, body


def names_in(body: bytes) -> list[str]:
    """Returns the variable names of a set-up body: joined by commas, a trailing comma allowed.

    Raises:
        MalformedPackage: the body is not ASCII.
    """
    try:
        return [name for name in body.decode("ascii").split(",") if name]
    except UnicodeDecodeError as error:
        raise MalformedPackage("variable names are not ASCII") from error
