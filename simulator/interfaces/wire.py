"""The RTDE package: uint16 size (header included), uint8 type, body; big-endian.

Source: Universal Robots, RTDE guide, "Protocol".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

HEADER = struct.Struct(">HB")
PROTOCOL_VERSIONS = (1, 2)

REQUEST_PROTOCOL_VERSION = 86  # V
GET_CONTROLLER_VERSION = 118  # v
TEXT_MESSAGE = 77  # M
DATA_PACKAGE = 85  # U
SETUP_OUTPUTS = 79  # O
SETUP_INPUTS = 73  # I
START = 83  # S
PAUSE = 80  # P

WARNING = 2
ERROR = 1  # levels of a text message; 0 is an exception, 3 an information
TEXT_SOURCE = "RTDE"  # chosen: what a text message of the controller names as its source
TEXT_MAX = 255  # [bytes] the length of a text is one byte in protocol 2

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


def text_message(protocol: int, text: str, level: int) -> bytes:
    """Returns a text message package: level and text, in protocol 2 text, source and level."""
    message = text.encode("ascii", "replace")[:TEXT_MAX]
    source = TEXT_SOURCE.encode()
    if protocol == 1:
        return package(TEXT_MESSAGE, bytes([level]) + message)
    return package(TEXT_MESSAGE, bytes([len(message)]) + message + bytes([len(source)]) + source + bytes([level]))


def text_in(protocol: int, body: bytes) -> str:
    """Returns the text of a client's text message.

    Raises:
        MalformedPackage: the body is empty, or shorter than its lengths say.
    """
    if not body or (protocol > 1 and len(body) <= body[0]):
        raise MalformedPackage("a text message without its text")
    return (body[1:] if protocol == 1 else body[1 : 1 + body[0]]).decode("ascii", "replace")
