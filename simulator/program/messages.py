"""What the controller tells the clients of its primary interface, beside its state.

Source: Universal Robots, "Primary and secondary interfaces", robot messages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

INFO = 1
WARNING = 2
VIOLATION = 3
FAULT = 4  # report levels of an error code
STARTED = "PROGRAM_XXX_STARTED"
STOPPED_TITLE = "PROGRAM_XXX_STOPPED"
READ_ONLY_CODE = 210  # a client whose scripts are not accepted: local control, or a port to read from only
SUDDEN_TARGET_CODE = 204  # source: UR service manual, "Path sanity check failed"
BY_PROGRAM_CODE = 209  # what URSim reports for protective_stop()
JOINT_LIMIT_CODE = 150  # source: UR service manual, "Position close to joint limits"


@dataclass(frozen=True)
class TextMessage:
    """Text of a program, by `textmsg`."""

    text: str


@dataclass(frozen=True)
class KeyMessage:
    """A keyword with its text: a program that started or stopped, and its name."""

    title: str
    text: str


@dataclass(frozen=True)
class RuntimeException:
    """An error in a program, at compilation or while it ran; line and column from 1."""

    line: int
    column: int
    text: str


@dataclass(frozen=True)
class ErrorCode:
    """An error code C<code>A<argument> with its report level."""

    code: int
    argument: int
    level: int
    text: str


@dataclass(frozen=True)
class Popup:
    """A message for the operator, by `popup`."""

    title: str
    text: str
    warning: bool
    error: bool
    blocking: bool


Message = TextMessage | KeyMessage | RuntimeException | ErrorCode | Popup


@dataclass
class MessageBoard:
    """Passes every message on to whoever listens; without a listener it is lost, as on a real controller."""

    listeners: list[Callable[[Message], None]] = field(default_factory=list)

    def post(self, message: Message) -> None:
        """Passes a message on."""
        for listener in self.listeners:
            listener(message)
