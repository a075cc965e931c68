"""Packages of a controller's primary interface, whole and within robot states.

Source: Universal Robots, "Primary and secondary interfaces": port 30001; a package is its whole size (int32), its type
(uint8) and its body. A robot state (type 16) is a row of such packages. All numbers are big-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

PORT = 30001
PACKAGE_MAX = 1 << 20  # [bytes] a larger size is no package
HEADER = struct.Struct(">iB")


def take_packages(buffer: bytearray) -> Iterator[tuple[int, bytes]]:
    """Yields type and body of every whole package at the beginning of the buffer, and removes it there.

    Raises:
        ValueError: a size is that of no package.
    """
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if not HEADER.size <= size <= PACKAGE_MAX:
            raise ValueError(f"the controller sent a package of {size} bytes: this is no primary interface")
        if len(buffer) < size:
            return
        body = bytes(buffer[HEADER.size : size])
        del buffer[:size]
        yield kind, body
