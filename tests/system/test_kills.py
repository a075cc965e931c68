"""Processes that die or freeze in mid-launch or at the release: the arm stops, the run is recorded, no orphan is left.

H numbers are those of `tests.system`.
"""

from __future__ import annotations

import resource
import signal
import sqlite3
from pathlib import Path

import psutil
import pytest

from tests.system.rig import FAST_RAD_S, LONG_LOB, NUDGE, Rig
from tests.system.service import RigService

REST_S = 0.150  # [s] of the controller's time from the kill to rest, H1 and H2: the promise of docs/executor.md
LANDED_S = 1.5  # [s] after the arm has come to rest: the object has landed, and the result exists
FULL_AT_BYTES = 1000  # [bytes] limit of every file; written data stays
ORPHANS_GONE_S = 10.0  # [s] within which planner processes follow their service
RECONNECTED_S = 1.0  # [s] the library reconnects within 0.2
MOMENTS = ("launch", "release")
SIGNALS = pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda n: n.name)


def launched(rig: Rig, when: str) -> tuple[str, float]:
    """Begins a fast throw and waits for the moment; returns its id and the controller's time."""
    id = rig.launch(FAST_RAD_S)
    return id, moment(rig, when)


def moment(rig: Rig, when: str) -> float:
    """Waits for the moment of a fast throw that is in mid-launch; returns the controller's time."""
    if when == "release":
        rig.until(lambda: rig.state()["gripper_open"], period=0.001)
    return rig.state()["t"]


def refuses_until_acknowledged(rig: Rig) -> None:
    """The fault is latched until acknowledged; the next test's launch shows that throws work then."""
    latched = rig.throw(NUDGE)
    assert (latched.outcome, "latched" in latched.reason) == ("refused", True)
    rig.acknowledge()


@pytest.mark.parametrize("when", MOMENTS)
@SIGNALS
def test_a_streaming_process_that_dies_or_freezes(rig: Rig, number: signal.Signals, when: str) -> None:
    released = len(rig.world()["releases"])
    id, at = launched(rig, when)
    streamer = rig.streamer()
    streamer.send_signal(number)
    assert rig.rest_time(at) < REST_S
    row = rig.end(id)
    assert row.outcome == "executor_lost", row.reason
    dropped = len(rig.world()["releases"]) - released
    assert 0 <= dropped <= (when == "release")  # held by the daemon, where its 40 ms are enough on this machine
    assert not streamer.is_running()  # reaped, not a zombie
    refuses_until_acknowledged(rig)


def test_an_object_is_held_by_the_daemon_where_the_stream_cannot(tmp_path: Path) -> None:
    """A gripper so slow that there is time on any machine: its command is taken back before the object leaves."""
    rig = Rig(tmp_path, replace={"delay_s = 0.040": "delay_s = 0.400"})
    try:
        rig.start()
        for number in (signal.SIGSTOP, signal.SIGKILL):
            id = rig.queue_when_ready(LONG_LOB)
            rig.until(lambda: rig.state()["gripper_open"], period=0.001)
            rig.streamer().send_signal(number)
            assert rig.end(id).outcome == "executor_lost", rig.row(id).reason
            assert rig.world()["releases"] == []
            assert rig.state()["gripper_holds"] is not None
            assert not rig.state()["gripper_open"]
            rig.acknowledge()
    finally:
        rig.stop()


@pytest.mark.parametrize("when", MOMENTS)
@SIGNALS
def test_a_daemon_that_dies_or_freezes(rig: Rig, number: signal.Signals, when: str) -> None:
    released = len(rig.world()["releases"])
    id, at = launched(rig, when)
    streamer = rig.streamer()
    rig.executor.send_signal(number)
    assert rig.rest_time(at) < REST_S
    if when == "launch":
        assert len(rig.world()["releases"]) == released
    if number == signal.SIGKILL:
        rig.executor.wait(10.0)
        rig.until(lambda: not streamer.is_running())
        rig.start_executor()
    else:
        rig.executor.send_signal(signal.SIGCONT)
    row = rig.end(id)
    assert row.outcome == "executor_lost", row.reason
    if when == "release":
        assert "the gripper was told to close" in row.reason or "the object left" in row.reason, row.reason
    rig.until(lambda: not streamer.is_running())
    refuses_until_acknowledged(rig)


@pytest.mark.slow
def test_a_stream_that_is_frozen_as_its_daemon_dies_is_ended_by_the_next(rig: Rig) -> None:
    """It would keep the controller's inputs, and go on with its tick whenever somebody wakes it."""
    id, at = launched(rig, "launch")
    streamer = rig.streamer()
    rig.executor.send_signal(signal.SIGSTOP)
    rig.until(lambda: psutil.Process(rig.executor.pid).status() == psutil.STATUS_STOPPED, period=0.001)
    streamer.send_signal(signal.SIGSTOP)  # in its brake
    rig.rest_time(at)  # by the watchdog
    rig.executor.kill()
    rig.executor.wait(10.0)
    assert streamer.status() == psutil.STATUS_STOPPED
    rig.start_executor()
    row = rig.end(id)
    assert row.outcome == "executor_lost", row.reason
    rig.until(lambda: not streamer.is_running())
    refuses_until_acknowledged(rig)
    assert rig.throw(NUDGE).outcome == "completed"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_process_that_waited_for_an_execution_is_not_missed(rig: Rig, number: signal.Signals) -> None:
    waiting = rig.streamer()
    assert waiting.net_connections("inet") == []  # nothing that could move an arm, or keep another from it
    waiting.send_signal(number)
    row = rig.throw_when_ready()
    assert row.outcome == "completed", row.reason
    assert not waiting.is_running()


@pytest.mark.slow
def test_a_process_that_waits_ends_with_its_executor(rig: Rig) -> None:
    """Also a frozen one, which takes no signal: the next executor ends it."""
    for freezes in (False, True):
        waiting = rig.streamer()
        if freezes:
            waiting.suspend()
        rig.executor.kill()
        rig.executor.wait(10.0)
        rig.start_executor()
        rig.until(lambda waiting=waiting: not waiting.is_running())
    assert rig.throw_when_ready().outcome == "completed"


@pytest.mark.slow
def test_a_connection_that_is_reset_as_the_daemon_dies_moves_nothing_again(rig: Rig) -> None:
    """The library would reconnect within its call, and repeat its command in a program without a watchdog."""
    id = rig.far_from_its_start()
    streamer = rig.streamer()
    rig.fault("close_connection", role="inputs", reset=True)
    rig.executor.kill()
    rig.executor.wait(10.0)
    rig.until(lambda: not streamer.is_running())
    rig.rest_time(0.0)
    rested = rig.state()["moved_at"]
    rig.until(lambda: rig.state()["t"] > rested + RECONNECTED_S)
    assert rig.state()["moved_at"] == rested
    rig.start_executor()
    assert rig.end(id).outcome == "executor_lost"
    refuses_until_acknowledged(rig)


def test_a_daemon_that_is_terminated_brakes_first(rig: Rig) -> None:
    released = len(rig.world()["releases"])
    id, _ = launched(rig, "launch")
    rig.executor.terminate()
    rig.executor.wait(30.0)
    row = rig.row(id)
    rig.start_executor()
    assert row.outcome == "aborted", row.reason
    assert "asked to end" in row.reason
    assert len(rig.world()["releases"]) == released
    assert max(map(abs, rig.state()["qd"])) < 1e-3


def test_a_database_that_is_gone_in_mid_run_loses_nothing(rig: Rig) -> None:
    id, _ = launched(rig, "launch")
    released = len(rig.world()["releases"])
    with sqlite3.connect(rig.url.removeprefix("sqlite:///")) as other:
        other.execute("BEGIN EXCLUSIVE")
        rig.until(lambda: len(rig.world()["releases"]) > released)
        rig.rest_time(rig.state()["t"])
        kept = rig.folder / "data" / "executor" / "rig" / f"{id}.result.json"
        rig.until(kept.exists)
        other.rollback()
    row = rig.end(id)
    assert row.outcome == "completed", row.reason
    assert row.metrics["landing_error_m"] < 0.005
    rig.until(lambda: not kept.exists())
    assert rig.store.recording(id) is not None


@pytest.mark.slow
def test_a_disk_that_fills_up_in_mid_run_loses_nothing(rig: Rig) -> None:  # H6
    """No file of the executor may grow, neither journal nor database, as on a full disk."""
    id, _ = launched(rig, "launch")
    soft, hard = resource.prlimit(rig.executor.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(rig.executor.pid, resource.RLIMIT_FSIZE, (FULL_AT_BYTES, hard))
    try:
        rig.until(lambda: (state := rig.state())["t"] - state["moved_at"] > LANDED_S)
        unfinished = rig.row(id).state != "finished"
    finally:
        resource.prlimit(rig.executor.pid, resource.RLIMIT_FSIZE, (soft, hard))
    assert unfinished
    row = rig.end(id)
    assert row.outcome == "completed", row.reason
    assert row.metrics["landing_error_m"] < 0.005
    assert rig.store.recording(id).mcap.startswith(b"\x89MCAP0\r\n")
    assert rig.throw(NUDGE).outcome == "completed"


@pytest.mark.slow
def test_an_abort_in_the_approach_stops_in_order(rig: Rig) -> None:
    assert rig.throw(NUDGE).outcome == "completed"
    far = {**NUDGE, "positions": [0.9, -1.57, 1.57, -1.57, -1.57, 0.0]}
    assert rig.throw(far).outcome == "completed"
    rig.abort_approaching(rig.queue(NUDGE), 1.7)  # starts at home: 0.9 rad away


def test_an_abort_while_preparing_moves_nothing(rig: Rig) -> None:
    assert rig.throw(NUDGE).outcome == "completed"
    before = rig.state()["moved_at"]
    id = rig.queue(NUDGE)
    rig.until(lambda: rig.row(id).state == "preparing", period=0.001)
    rig.store.request_abort(id)
    row = rig.end(id)
    assert row.outcome == "aborted", row.reason
    assert "before anything moved" in row.reason
    assert rig.states(id) == ["queued", "preparing", "finished"]
    assert rig.state()["moved_at"] == before
    assert not rig.is_latched()


def test_an_abort_after_the_gripper_command_closes_it_again(rig: Rig) -> None:
    id, _ = launched(rig, "release")
    rig.store.request_abort(id)
    row = rig.end(id)
    assert row.outcome in ("aborted", "completed"), row.reason  # the object may leave before the request is read
    assert not rig.state()["gripper_open"] or row.metrics["gripper_opened_s"] is not None


@pytest.mark.parametrize("speed", [0.1, 2.5])
def test_an_abort_brakes_and_keeps_the_object(rig: Rig, speed: float) -> None:
    released = len(rig.world()["releases"])
    id = rig.launch(speed)
    rig.store.request_abort(id)
    row = rig.end(id)
    assert row.outcome == "aborted", row.reason
    assert len(rig.world()["releases"]) == released
    assert rig.state()["gripper_holds"] is not None
    assert max(map(abs, rig.state()["qd"])) < 1e-3
    assert rig.throw(NUDGE).outcome == "completed"  # an abort in order latches nothing


@pytest.mark.slow
def test_a_service_that_freezes_or_dies(rig: Rig) -> None:
    """The run goes on to its end, and the next service finds its result."""
    service = RigService(rig)
    plan = rig.plan(LONG_LOB)
    frozen = service.execute(plan)
    rig.in_launch(frozen, FAST_RAD_S)
    service.process.send_signal(signal.SIGSTOP)
    assert rig.end(frozen).outcome == "completed", rig.row(frozen).reason
    service.process.send_signal(signal.SIGCONT)
    assert service.http.get(f"/executions/{frozen}").json()["outcome"] == "completed"
    killed = service.execute(plan)
    rig.in_launch(killed, FAST_RAD_S)
    moment(rig, "release")
    planners = psutil.Process(service.process.pid).children(recursive=True)
    service.process.kill()
    assert rig.end(killed).outcome == "completed", rig.row(killed).reason
    assert psutil.wait_procs(planners, ORPHANS_GONE_S)[1] == []
    service.end()
    assert rig.store.recording(killed).mcap.startswith(b"\x89MCAP0\r\n")  # where the next service finds it
