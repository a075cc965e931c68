"""Robot messages of the primary interface as bytes.

Source: Universal Robots, "Primary and secondary interfaces", "Robot message": int32 size, uint8 type 20, uint64
timestamp [us], int8 source, uint8 message type, then fields; big-endian; a text at the end has no length of its own.
"""

from __future__ import annotations

import struct

from simulator.program import messages
from simulator.settings import ControllerIdentity

ROBOT_MESSAGE = 20
HEAD = struct.Struct(">iBQbB")
TEXT = 0
POPUP = 2
VERSION = 3
SAFETY_MODE = 5
ERROR_CODE = 6
KEY = 7
RUNTIME_EXCEPTION = 10
FROM_INTERFACE = -2
FROM_CONTROLLER = -3  # who says it: the robot interface, the real-time machine
PROJECT = "URControl"
BUILD_DATE = "01-01-2024, 00:00:00"
REQUEST_NOTHING = 0  # a popup that asks for no value


def _message(kind: int, source: int, t: float, body: bytes) -> bytes:
    return HEAD.pack(HEAD.size + len(body), ROBOT_MESSAGE, round(t * 1e6), source, kind) + body


def _short(text: str) -> bytes:
    """Returns a text with its length before it."""
    data = _ascii(text)[:255]
    return bytes([len(data)]) + data


def _ascii(text: str) -> bytes:
    return text.encode("ascii", "replace")


def version_message(identity: ControllerIdentity, t: float) -> bytes:
    """Returns the first message on every connection."""
    major, minor, bugfix = identity.version
    numbers = struct.pack(">BBii", major, minor, bugfix, identity.build)
    return _message(VERSION, FROM_INTERFACE, t, _short(PROJECT) + numbers + _ascii(BUILD_DATE))


def safety_mode_message(mode: int, t: float) -> bytes:
    """Returns the message of a new safety mode."""
    return _message(SAFETY_MODE, FROM_CONTROLLER, t, struct.pack(">iiBII", 0, 0, mode, 0, 0))


def message_bytes(message: messages.Message, t: float) -> bytes:
    """Returns any message of the controller at its time `t` [s]."""
    if isinstance(message, messages.TextMessage):
        return _message(TEXT, FROM_CONTROLLER, t, _ascii(message.text))
    if isinstance(message, messages.KeyMessage):
        body = struct.pack(">ii", 0, 0) + _short(message.title) + _ascii(message.text)
        return _message(KEY, FROM_INTERFACE, t, body)
    if isinstance(message, messages.RuntimeException):
        body = struct.pack(">ii", message.line, message.column) + _ascii(message.text)
        return _message(RUNTIME_EXCEPTION, FROM_CONTROLLER, t, body)
    if isinstance(message, messages.ErrorCode):
        body = struct.pack(">iiiII", message.code, message.argument, message.level, 0, 0) + _ascii(message.text)
        return _message(ERROR_CODE, FROM_CONTROLLER, t, body)
    flags = struct.pack(">IB???", 0, REQUEST_NOTHING, message.warning, message.error, message.blocking)
    return _message(POPUP, FROM_INTERFACE, t, flags + _short(message.title) + _ascii(message.text))
