"""A motion inside the controller as the streaming process sees it: asked to stop, and stopped by its own program."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from executor.preparation import prepare_job
from executor.stream_job import StreamJob
from executor.streaming import script_stream
from executor.streaming.gripper_port import OutputPort
from executor.streaming.rtde_connection import PROGRAM_OUTPUTS, ProgramState
from executor.streaming.script_stream import ScriptStream
from executor.streaming.state_checks import StreamFault, check_state
from planner.approach import Approach
from planner.controller_program import BRAKED, END, GO, HEARTBEAT, OFF_COURSE, REQUEST, UNHEARD
from simulator.interfaces import InputValues
from tests.executor.conftest import Prepared, prepare, settings
from tests.simulator.conftest import Driven

NORMAL = 1  # safety bits
RUNNING = 7  # robot mode


class DrivenConnection(Driven):
    """What `ScriptStream` uses of an RTDE connection, of a controller that goes on by a cycle at each look."""

    plays = False
    delayed_s = call_s = 0.0
    safety_bits = NORMAL
    current = (0.0,) * 6

    def __init__(self, prepared: Prepared, job: StreamJob) -> None:
        super().__init__(prepared.cell, script=job.program)
        self.job = job
        connection: Any = self
        self.gripper = OutputPort(connection)
        self.memory: Any = SimpleNamespace(fields=defaultdict(float), add_row=lambda values: None)
        self.read()

    def timestamp(self) -> float:
        time.sleep(0.5 * self.controller.timeline.dt)  # heartbeats are told by the clock of this machine
        self.cycle()
        return self.controller.timeline.t

    def read(self) -> None:
        self.stamp = self.controller.timeline.t
        self.q = self.arm.q
        self.qd = self.target_qd = self.arm.qd
        self.runtime_state = self.controller.runner.runtime
        self.scaling = self.controller.speed_scaling
        self.outputs = self.controller.workcell.outputs.bits
        self.inputs = self.controller.workcell.input_bits
        self.program = ProgramState(*map(self.out_int, PROGRAM_OUTPUTS))

    def check(self) -> None:
        runtime = self.runtime_state if self.plays else 2
        check_state(self.safety_bits, runtime, self.scaling, RUNNING)

    def beat(self, number: int, request: int) -> None:
        self.controller.take_inputs(InputValues([(HEARTBEAT, number), (REQUEST, request)], []))

    def output(self, kind: str, index: int, level: bool) -> None:
        pass

    def wait_for_rest(self) -> None:
        pass


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> ScriptStream:
    """A throw whose program waits for its start."""
    prepared = prepare("ur5e-sim")
    how = ("script", False, replace(settings(), dead_man_s=0.1))
    job = prepare_job(prepared.problem, prepared.trajectory, Approach(prepared.trajectory.q[0]), *how)
    monkeypatch.setattr(script_stream, "Upload", lambda job: SimpleNamespace(go_on=lambda: None, close=lambda: None))
    connection: Any = DrivenConnection(prepared, job)
    requests: Any = SimpleNamespace(pending=lambda: None)
    return ScriptStream(connection, job, requests, recorded=False)


def controller_of(stream: ScriptStream) -> Driven:
    connection: Any = stream.connection
    return connection


def test_an_abort_at_the_start_ends_the_program_before_the_run_is_told_to_be_over(stream: ScriptStream) -> None:
    requests: Any = stream.requests
    went = stream.job.run + GO
    requests.pending = lambda: ("aborted", "abort requested") if stream.clock.request == went else None
    assert stream.run() == ("aborted", "abort requested")
    driven = controller_of(stream)
    assert driven.out_int(END) == BRAKED
    assert not any(driven.arm.qd)


@pytest.mark.parametrize(("fraction", "outcome"), [(1.0, "tracking"), (0.5, "aborted")])
def test_a_program_off_its_course_is_told_by_its_cause(stream: ScriptStream, fraction: float, outcome: str) -> None:
    """It was paused and resumed between two states; where the next one shows a speed slider, that is the cause."""
    driven = controller_of(stream)
    requests: Any = stream.requests

    def disturb() -> None:
        if stream.clock.tick > stream.job.release_row // 2 and driven.controller.runner.pause():
            driven.cycle(500)
            driven.controller.runner.resume()
            driven.cycle(2)
            driven.controller.slider = driven.controller.speed_scaling = fraction

    requests.pending = disturb
    with pytest.raises(StreamFault) as raised:
        stream.run()
    assert driven.out_int(END) == OFF_COURSE
    assert raised.value.outcome == outcome


@pytest.mark.parametrize("cycles", [50, 51, 55, 60])
def test_a_program_that_ended_before_its_first_row_was_seen_was_stopped(stream: ScriptStream, cycles: int) -> None:
    """This process was suspended from the request to go on: the first state that shows a row shows the end, too."""
    driven = controller_of(stream)
    beat = driven.beat

    def beat_and_sleep(number: int, request: int) -> None:
        beat(number, request)
        if request == stream.job.run + GO and driven.out_int(END) == 0:
            driven.cycle(cycles)

    driven.beat = beat_and_sleep
    with pytest.raises(StreamFault) as raised:
        stream.run()
    assert driven.out_int(END) == UNHEARD
    assert raised.value.outcome in ("late", "link_lost")
    assert "the program stopped the arm" in raised.value.reason


def test_an_abort_before_the_program_starts_ends_it_when_it_does(stream: ScriptStream) -> None:
    requests: Any = stream.requests
    requests.pending = lambda: ("aborted", "abort requested")
    assert stream.run() == ("aborted", "abort requested")
    driven = controller_of(stream)
    driven.cycle(100)
    assert not driven.controller.runner.playing
    assert not any(driven.arm.qd)
