"""Whether the gripper does what it was told, and nothing else: any client of the controller may switch it."""

from __future__ import annotations

from executor.stream_job import StreamJob

ANSWER_S = 0.05  # [s] beyond the cell's lag until an output shows what it was told; some ticks, of 8 ms on a CB3


class GripperWatch:
    """Follows the gripper while it holds an object.

    Attributes:
        is_open: whether it was open when it was seen last: its output, or what it reports.
    """

    def __init__(self, job: StreamJob, held: bool = False) -> None:
        """Begins to watch a gripper that is closed; `held` says that it was seen to hold an object."""
        self.answer_s = job.lag_ticks * job.dt + ANSWER_S + job.opens_in_s
        self._thing = "the gripper's output" if job.link is None else "what the gripper reports"
        self.is_open = False
        self._told_open = False
        self._answered = True
        self._in_flight = False  # an earlier command may show after the newest one
        self._settled_at = 0.0
        self._grip_input = job.grip_input
        self._held = held
        self._may_leave = False  # told to open once: that its object leaves is no surprise any more

    def tell(self, opens: bool, stamp: float) -> None:
        """Notes that the gripper was told to open or close the gripper at the controller's time `stamp` [s]."""
        self._in_flight = not self._answered
        self._told_open = opens
        self._may_leave = self._may_leave or opens
        self._answered = False
        self._settled_at = stamp + self.answer_s

    def look(self, is_open: bool | None, stamp: float, holds: bool | None = None) -> tuple[str, str] | None:
        """Returns outcome and reason of a gripper that another client switched, or that did not do what it was told.

        Or of one that has lost its object, by the input that shows it.

        Args:
            is_open: whether it is open; None: nobody can tell.
            stamp: the controller's time [s].
            holds: whether it holds an object; None: nobody can tell.
        """
        self.is_open = bool(is_open)
        settled = stamp > self._settled_at
        if is_open is None or self.is_open == self._told_open:
            self._answered = self._answered or settled or not self._in_flight
            return self._slipped(holds)
        if not self._answered and not settled:
            return None
        if self.is_open:
            by = "another client opened the gripper" if self._answered else "the gripper did not close when told"
            return "released_early", f"{by}: {self._thing} changed while it held the object"
        if self._answered:
            return "not_released", "another client closed the gripper before the object left"
        return "not_released", f"{self._thing} did not change when it was told to open"

    def _slipped(self, holds: bool | None) -> tuple[str, str] | None:
        """Returns outcome and reason of an object that was held and is not any more, as the input shows."""
        if self._grip_input is None or self._may_leave:
            return None
        if self._held and holds is False:
            return "released_early", f"the object slipped out of the gripper: input {self._grip_input} went low"
        self._held = self._held or holds is True
        return None
