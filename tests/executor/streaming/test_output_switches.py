"""The outputs of passages, as the stream switches them, and as stops end them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from math import isnan, nan
from types import SimpleNamespace
from typing import Any

import pytest

from executor.shared_memory import STOPPED_S
from executor.stream_job import StreamJob
from executor.streaming.loop import Stream
from executor.streaming.output_switches import OutputSwitches
from planner.controller_program import SwitchRow
from tests.executor.conftest import Prepared

VALVE = ("standard_digital", 1)
LAMP = ("configurable_digital", 2)
SWITCHES = [SwitchRow(10, *VALVE, True), SwitchRow(12, *LAMP, True), SwitchRow(30, *VALVE, False)]


@pytest.fixture
def job(prepared: Prepared) -> StreamJob:
    return replace(prepared.job, switches=SWITCHES)


def switched(job: StreamJob) -> tuple[OutputSwitches, list[tuple[str, int, bool]], Any]:
    """Returns the outputs of a job, what they are told, and the memory that they note it in."""
    told: list[tuple[str, int, bool]] = []
    memory: Any = SimpleNamespace(switched=[nan] * len(job.switches), fields=defaultdict(lambda: nan))
    connection: Any = SimpleNamespace(memory=memory, output=lambda *levels: told.append(levels))
    return OutputSwitches(connection, job), told, memory


@pytest.mark.parametrize(
    ("sent", "reached", "ended"),
    [
        (0, -1, []),
        (1, -1, [(*VALVE, False)]),
        (2, -1, [(*VALVE, False)]),
        (3, -1, []),
        (0, 9, []),  # a program that had not come so far
        (0, 10, [(*VALVE, False)]),  # that may have
        (2, 40, [(*VALVE, False)]),  # that may have closed it, or not
    ],
)
def test_a_stop_owes_an_output_that_was_switched_its_last_level(
    job: StreamJob, sent: int, reached: int, ended: list[tuple[str, int, bool]]
) -> None:
    assert [(*each.line, each.level) for each in job.stop_levels(sent, reached)] == ended


def test_a_brake_ends_what_was_switched_and_notes_when(job: StreamJob) -> None:
    outputs, told, memory = switched(job)
    for row in range(21):
        outputs.send(row)
    assert told == [(*VALVE, True), (*LAMP, True)]
    outputs.stop(21)
    assert told[2:] == [(*VALVE, False)]
    assert memory.fields[STOPPED_S] == pytest.approx(job.first_clock_s + (21 - job.lag_ticks) * job.dt)
    outputs.stop(22)
    outputs.send(30)
    assert len(told) == 3
    assert isnan(memory.switched[2])


def test_an_output_is_noted_before_it_is_sent(job: StreamJob) -> None:
    """A process that is killed between the two leaves nothing on that the daemon does not know of."""
    outputs, _, memory = switched(job)
    connection: Any = outputs._connection

    def fail(*levels: object) -> None:
        raise ConnectionError

    connection.output = fail
    with pytest.raises(ConnectionError):
        outputs.send(10)
    assert not isnan(memory.switched[0])


@pytest.mark.parametrize(("kind", "waits"), [("standard_digital", True), ("tool_digital", False)])
def test_an_output_of_the_grippers_kind_waits_for_the_tick_after_its_opening(
    job: StreamJob, kind: str, waits: bool
) -> None:
    job = replace(job, output=kind, output_index=0, second=None, link=None)
    outputs, told, _ = switched(job)
    stream: Any = SimpleNamespace(job=job, outputs=outputs, opened_at=10)
    Stream._switch_outputs(stream, 10)
    assert told == ([] if waits else [(*VALVE, True)])
    Stream._switch_outputs(stream, 11)
    assert told == [(*VALVE, True)]
