"""Fresh runs of the real processes are paths of the model of `tests/protocol`.

With FLING_RECORD_PROTOCOL=FOLDER they are written there; `tests/protocol/recorded` was made so.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from fling.stop_socket import stop
from tests.protocol.recorder import ProtocolRecorder, settled
from tests.protocol.traces import refusal
from tests.system.rig import FAST_RAD_S, LONG_LOB, Rig
from tests.system.test_replacement import answer, start_on, stored, streaming, swing


def throw(rig: Rig, record: ProtocolRecorder) -> None:
    rig.end(record.follow(rig.queue(LONG_LOB)))


def stop_before_the_release(rig: Rig, record: ProtocolRecorder) -> None:
    id = record.follow(rig.queue(LONG_LOB))
    rig.in_launch(id, 0.1)
    record.act("asks to stop", lambda: stop(rig.folder / "data", id, "test"))
    rig.end(id)


def kill_the_stream_before_the_release(rig: Rig, record: ProtocolRecorder) -> None:
    id = record.follow(rig.queue(LONG_LOB))
    rig.in_launch(id, FAST_RAD_S)
    record.act("kills stream", rig.streamer().kill)
    rig.end(id)


def kill_the_stream_after_the_release(rig: Rig, record: ProtocolRecorder) -> None:
    id = record.follow(rig.queue(LONG_LOB))
    rig.in_launch(id)
    streamer = rig.streamer()
    rig.until(lambda: rig.world()["in_flight"], period=0.001)
    record.act("kills stream", streamer.kill)
    rig.end(id)


def kill_the_executor(rig: Rig, record: ProtocolRecorder) -> None:
    id = record.follow(rig.queue(LONG_LOB))
    rig.in_launch(id, 0.1)
    streamer = rig.streamer()
    record.act("kills executor", rig.executor.kill)
    rig.executor.wait(10.0)
    rig.until(lambda: not streamer.is_running())
    record.act("starts executor", rig.start_executor)
    rig.end(id)


def freeze_both_and_kill_the_executor(rig: Rig, record: ProtocolRecorder) -> None:
    id = record.follow(rig.queue(LONG_LOB))
    rig.in_launch(id, 0.1)
    streamer = rig.streamer()
    record.act("freezes executor", lambda: rig.executor.send_signal(signal.SIGSTOP))
    rig.until(lambda: psutil.Process(rig.executor.pid).status() == psutil.STATUS_STOPPED, period=0.001)
    record.act("freezes stream", lambda: streamer.send_signal(signal.SIGSTOP))
    rig.until(lambda: streamer.status() == psutil.STATUS_STOPPED, period=0.001)
    rig.rest_time(0.0)
    record.act("kills executor", rig.executor.kill)
    rig.executor.wait(10.0)
    record.act("starts executor", rig.start_executor)
    rig.end(id)


def replace_the_motion(rig: Rig, record: ProtocolRecorder) -> None:
    first, motion = stored(rig, swing(rig, "+-"))
    second, _ = stored(rig, {**swing(rig, "+"), "start": start_on(motion, 1.4)})
    id = record.follow(streaming(rig, first, 0.3))
    record.act("asks to replace", lambda: answer(rig, id, second))
    rig.end(id)


SCENARIOS = (
    throw,
    stop_before_the_release,
    kill_the_stream_before_the_release,
    kill_the_stream_after_the_release,
    kill_the_executor,
    freeze_both_and_kill_the_executor,
    replace_the_motion,
)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda each: each.__name__)
def test_a_run_is_a_path_of_the_model(rig: Rig, scenario: Callable[[Rig, ProtocolRecorder], None]) -> None:
    rig.plan(LONG_LOB)
    settled(rig)
    with ProtocolRecorder(rig, scenario.__name__.replace("_", " ")) as record:
        scenario(rig, record)
        settled(rig)
    trace = record.trace()
    if folder := os.environ.get("FLING_RECORD_PROTOCOL"):
        trace.write(Path(folder))
    assert refusal(trace) == "", trace
