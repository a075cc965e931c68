"""The outputs that a plan switches about its passages, each with the command of its row."""

from __future__ import annotations

from collections.abc import Collection
from math import isnan
from typing import TYPE_CHECKING

from executor.shared_memory import STOPPED_S
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

    def go_by(self, job: StreamJob) -> None:
        """Goes by another job, which begins with what is due of this one before the two part."""
        self._job = job

    def send(self, row: int, but: Collection[str] = ()) -> None:
        """Switches what is due at a row; after lost ticks at the next one.

        From the first output of the kinds `but` on, what is due waits for the next row.

        It is noted before it is sent: where this process ends between the two, the daemon ends the output.
        """
        while (due := self._due(row)) is not None and due.output not in but:
            self._note(row)
            self._connection.output(due.output, due.index, due.level)

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
        self._connection.memory.switched[self._next] = self._told_s(row)
        self._next += 1

    def _told_s(self, row: int) -> float:
        """Returns the plan time at which what belongs to a row is sent [s]."""
        return self._job.first_clock_s + (row - self._job.lag_ticks) * self._job.dt

    def stop(self, row: int) -> None:
        """Ends the switching of a motion that is braked from a row."""
        for each in self.note_stop(row):
            self._connection.output(each.output, each.index, each.level)

    def note_stop(self, row: int) -> list[SwitchRow]:
        """Notes that a brake from a row ends the switching; returns what it switches."""
        if isnan(self._connection.memory.fields[STOPPED_S]):
            self._connection.memory.fields[STOPPED_S] = self._told_s(row)
        levels = self._job.stop_levels(self._next, row=row)
        self._next = len(self._job.switches)
        return levels
