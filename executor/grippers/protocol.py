"""What a driver knows of its gripper: the bytes to send, and what its answers mean. It never touches a socket."""

from __future__ import annotations

from typing import Protocol


class GripperDriver(Protocol):
    """One kind of gripper.

    Attributes:
        answers: whether it answers every request.
        reports: whether it tells what it does; one that does not cannot be watched, nor waited for.
        fault: what it reported to be wrong; empty where nothing is.
        reconnects: whether its other side may close the connection where nothing is said, and takes another.
        quiet_s: time before the command to open in which nothing is asked, so that the bus is free [s].
    """

    answers: bool
    reports: bool
    fault: str
    reconnects: bool
    quiet_s: float

    def preparation(self) -> tuple[bytes, ...]:
        """Returns requests that make it ready, and that tell whether it is, to be sent one after another."""
        ...

    def unready(self) -> str:
        """Returns why it cannot be used, once `preparation` is answered; empty where it can."""
        ...

    def tell(self, opens: bool) -> bytes:
        """Returns the command to open or to close, which is about to be sent."""
        ...

    def question(self) -> bytes:
        """Returns the next question about its state; empty where there is none."""
        ...

    def take(self, received: bytearray) -> int:
        """Takes whole answers off the front of what was received; returns how many."""
        ...

    def is_open(self) -> bool | None:
        """Returns whether it is open, or opens; None where that is not known."""
        ...

    def is_closed(self) -> bool:
        """Returns whether it reports that it was closed since it was told to, and is still."""
        ...

    def holds(self) -> bool | None:
        """Returns whether it reports an object since it was told to close; None where it does not tell."""
        ...

    def motion(self) -> tuple[int, bool] | None:
        """Returns the number of its newest report, and whether its fingers had begun to open by then.

        None where it was not told to open, or reports of no fingers.
        """
        ...

    def has_lost_object(self) -> bool:
        """Returns whether it reports that it held an object and closed further, without it."""
        ...
