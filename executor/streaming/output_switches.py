"""The outputs that a plan switches about its passages, each with the command of its row."""

from __future__ import annotations

from typing import TYPE_CHECKING

from executor.stream_job import StreamJob
from planner.controller_program import SwitchRow

if TYPE_CHECKING:
    from executor.streaming.rtde_connection import RtdeConnection


class OutputSwitches:
    """What is still to be switched, and what was.

    A stop drops what is still to come, and gives each output that was switched the last level that the plan has for it:
    a valve that was to close later closes.
    """

    def __init__(self, connection: RtdeConnection, job: StreamJob) -> None:
        """Takes the outputs of a job."""
        self._connection = connection
        self._job = job
        self._next = 0
        self._levels: dict[tuple[str, int], bool] = {}

    def send(self, row: int) -> None:
        """Switches what is due at a row; after lost ticks at the next one."""
        while (due := self._due(row)) is not None:
            self._set(due.output, due.index, due.level)
            self._note(row)

    def note(self, row: int) -> None:
        """Notes that somebody else has switched what was due up to a row, in time."""
        while (due := self._due(row)) is not None:
            self._note(due.row)

    def _due(self, row: int) -> SwitchRow | None:
        """Returns the next output, if it is due at a row."""
        switches = self._job.switches
        return switches[self._next] if self._next < len(switches) and switches[self._next].row <= row else None

    def _note(self, row: int) -> None:
        """Notes that the next output was switched with a row."""
        job = self._job
        self._connection.memory.switched[self._next] = job.first_clock_s + (row - job.lag_ticks) * job.dt
        self._next += 1

    def stop(self) -> None:
        """Ends the switching of a motion that is braked."""
        to_come = self._job.switches[self._next :]
        self._next = len(self._job.switches)
        last = {(each.output, each.index): each.level for each in to_come}
        for (output, index), level in list(self._levels.items()):
            if last.get((output, index), level) != level:
                self._set(output, index, not level)

    def _set(self, output: str, index: int, level: bool) -> None:
        self._connection.output(output, index, level)
        self._levels[output, index] = level
