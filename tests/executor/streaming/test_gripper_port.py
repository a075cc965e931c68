"""A gripper on one or two digital outputs, as the stream switches it."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from types import SimpleNamespace

import pytest

from executor import shared_memory as shm
from executor.streaming import gripper_port
from executor.streaming.gripper_port import OutputPort
from planner.grippers import SecondOutput
from tests.executor.conftest import Prepared

KINDS = [("standard_digital", 3, 1 << 3), ("configurable_digital", 2, 1 << 10), ("tool_digital", 1, 1 << 17)]
CLOSES = SecondOutput("standard_digital", 5, open_level=False, lasts_s=None)
BLOWS = SecondOutput("standard_digital", 5, open_level=True, lasts_s=0.1)


class SwitchedOutputs(SimpleNamespace):
    """A connection whose outputs change at once, and whose time passes while it is read."""

    def output(self, kind: str, index: int, level: bool) -> None:
        bit = 1 << ({"standard_digital": 0, "configurable_digital": 8, "tool_digital": 16}[kind] + index)
        self.outputs = self.outputs | bit if level else self.outputs & ~bit
        self.told.append((index, level))

    def read(self) -> None:
        self.stamp += self.job.dt if self.sends else 0.0


def port_of(prepared: Prepared, **changes: object) -> tuple[OutputPort, SwitchedOutputs]:
    job = replace(prepared.job, **changes)
    memory = SimpleNamespace(fields=defaultdict(float))
    controller = SwitchedOutputs(job=job, outputs=0, stamp=1.0, told=[], sends=True, memory=memory)
    return OutputPort(controller), controller


@pytest.mark.parametrize(("output", "index", "bit"), KINDS, ids=[kind[0] for kind in KINDS])
@pytest.mark.parametrize("level", [True, False])
def test_one_output_opens_at_its_own_level(prepared: Prepared, output: str, index: int, bit: int, level: bool) -> None:
    port, _ = port_of(prepared, output=output, output_index=index, output_level=level)
    assert port.opens(bit) is level
    assert port.opens(~bit) is not level


def test_a_pair_is_open_with_both(prepared: Prepared) -> None:
    port, controller = port_of(prepared, output="standard_digital", output_index=4, output_level=True, second=CLOSES)
    port.tell(True)
    assert (port.is_open(), controller.outputs) == (True, 1 << 4)
    port.tell(False)
    assert (port.is_open(), controller.outputs) == (False, 1 << 5)
    assert not port.opens(1 << 4 | 1 << 5)


def test_what_blows_begins_before_the_vacuum_goes_and_ends_in_time(prepared: Prepared) -> None:
    port, controller = port_of(prepared, output="standard_digital", output_index=4, output_level=False, second=BLOWS)
    controller.outputs = 1 << 4
    assert not port.is_open()
    port.tell(True)
    assert controller.told == [(5, True), (4, False)]
    assert port.is_open()
    controller.stamp += 0.09
    port.cycle()
    assert controller.outputs == 1 << 5
    port.finish()
    assert controller.stamp == pytest.approx(1.1, abs=prepared.job.dt)
    assert (port.is_open(), controller.outputs) == (True, 0)


def test_a_vacuum_that_comes_back_ends_the_blowing(prepared: Prepared) -> None:
    port, controller = port_of(prepared, output="standard_digital", output_index=4, output_level=False, second=BLOWS)
    port.tell(True)
    port.tell(False)
    assert controller.outputs == 1 << 4
    port.finish()
    assert controller.stamp == 1.0


def test_a_long_blowing_is_no_silence_and_a_silent_controller_is(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The daemon ends a run in which nothing happens for five seconds; a cell's blowing may last ten."""
    port, controller = port_of(prepared, output="standard_digital", output_index=4, output_level=False, second=BLOWS)
    port.tell(True)
    now = 100.0
    pulses = []

    def slept(s: float) -> None:
        nonlocal now
        now += s
        pulses.append(controller.memory.fields[shm.PULSE])
        controller.sends = len(pulses) < 10
        if len(pulses) > 40:
            raise InterruptedError  # ended by the daemon

    monkeypatch.setattr(gripper_port, "sleep", slept)
    monkeypatch.setattr(gripper_port, "monotonic", lambda: now)
    with pytest.raises(InterruptedError):
        port.finish()
    assert pulses[3] < pulses[6] < pulses[10] == pulses[40]
