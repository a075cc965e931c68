"""Whether the gripper's output does what it was told, and nothing else: any client of the controller may switch it."""

from __future__ import annotations

from executor.stream_job import StreamJob
from executor.streaming.state_checks import OUTPUT_SHIFT

ANSWER_S = 0.05  # [s] beyond the cell's lag until an output shows what it was told; some ticks, of 8 ms on a CB3


class GripperWatch:
    """Follows the gripper's output while it holds an object.

    Attributes:
        is_open: whether the output was at the level that opens the gripper when it was seen last.
    """

    def __init__(self, job: StreamJob) -> None:
        self.bit = 1 << (OUTPUT_SHIFT[job.output] + job.output_index)
        self.open_bits = self.bit if job.output_level else 0
        self.answer_s = job.lag_ticks * job.dt + ANSWER_S
        self.is_open = False
        self._told_open = False
        self._answered = True
        self._in_flight = False  # an earlier command may show after the newest one
        self._settled_at = 0.0

    def opens(self, outputs: int) -> bool:
        """Returns whether output bits open the gripper."""
        return int(outputs) & self.bit == self.open_bits

    def tell(self, opens: bool, stamp: float) -> None:
        """Notes that the output was told to open or close the gripper at the controller's time `stamp` [s]."""
        self._in_flight = not self._answered
        self._told_open = opens
        self._answered = False
        self._settled_at = stamp + self.answer_s

    def look(self, outputs: int, stamp: float) -> tuple[str, str] | None:
        """Returns outcome and reason of an output that another client switched, or that did not do what it was told.

        Args:
            outputs: output bits.
            stamp: the controller's time [s].
        """
        self.is_open = self.opens(outputs)
        settled = stamp > self._settled_at
        if self.is_open == self._told_open:
            self._answered = self._answered or settled or not self._in_flight
            return None
        if not self._answered and not settled:
            return None
        if self.is_open:
            by = "another client opened the gripper" if self._answered else "the gripper did not close when told"
            return "released_early", f"{by}: its output changed while it held the object"
        if self._answered:
            return "not_released", "another client closed the gripper before the object left"
        return "not_released", "the gripper's output did not change when it was told to open"
