"""Replacing a running motion on a simulated cell: joined within the limits, or refused and the motion goes on."""

from __future__ import annotations

import signal
from contextlib import suppress
from threading import Thread
from typing import Any

import httpx2
import numpy as np
import psutil
import pytest

from planner.answer import plan_document, plan_from_document
from planner.planning import plan
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from store import ExecutionRow, new_id
from tests.processes import children_with
from tests.system.rig import LOB, Rig, rows_of
from tests.system.service import RigService

SWING_RAD = 0.35
LIMITS = {"velocity": 0.8, "acceleration": 6.0}
ANSWERED_S = 10.0
REST_S = 0.15  # [s] of the controller's time from a kill to rest: the promise of docs/executor.md
AHEAD_S = 1.0  # [s] of the motion from the request to the tick at which the new plan begins
TORN_RAD_S = 0.02  # [rad/s] a jump of the planned speed between two rows beyond what the acceleration explains


def swing(rig: Rig, signs: str) -> dict[str, Any]:
    """Returns a request for a motion from side to side, which takes about a second a passage."""
    home = rig.cell.home
    aside = SWING_RAD * np.array([1.0, 0.3, -0.4, 0.3, 0.2, 0.5])
    states = [home + (1.0 if sign == "+" else -1.0) * aside for sign in signs]
    passages = [
        {"name": str(i), "state": {"kind": "joint", "positions": q.tolist(), "velocities": (0.0 * q).tolist()}}
        for i, q in enumerate(states)
    ]
    return {"passages": passages, "end": {"kind": "home"}, "limits": LIMITS}


def stored(rig: Rig, request: dict[str, Any]) -> tuple[str, Trajectory]:
    """Plans a request and stores it."""
    request = {"cell": "rig", **request}
    found = plan(problem_from_request(request, rig.cell))
    document = plan_document(found, request, new_id(), "2026-01-01T00:00:00Z")
    rig.add_plan(document)
    return document["id"], plan_from_document(document, rig.cell)[1]


def start_on(motion: Trajectory, at_s: float) -> dict[str, Any]:
    """Returns the start that a motion has at a time."""
    tick = round(at_s / motion.dt)
    names = {"positions": motion.q, "velocities": motion.qd, "accelerations": motion.qdd}
    return {name: values[tick].tolist() for name, values in names.items()}


def streaming(rig: Rig, plan_id: str, plan_s: float, mode: str = "speedj") -> str:
    """Queues a plan and waits until its motion has come to a time; returns the execution's id."""
    id = rig.queue_plan_when_ready(plan_id, mode)

    def is_there() -> bool:
        events = rig.store.events(id)
        clocks = [each.data["clock_s"] for each in events if each.kind == "telemetry" and "clock_s" in each.data]
        return rig.row(id).state == "streaming" and bool(clocks) and clocks[-1] >= plan_s

    rig.until(is_there)
    return id


def answer(rig: Rig, id: str, plan_id: str) -> dict[str, Any]:
    """Asks for a replacement and returns what became of it."""
    asked = rig.store.request_replacement(id, plan_id, "test")
    assert asked is not None

    def found() -> dict[str, Any] | None:
        return next((dict(each) for each in rig.row(id).replacements or () if each["id"] == asked), None)

    rig.until(lambda: found() is not None, ANSWERED_S)
    result = found()
    assert result is not None
    return result


def planned_rows(rig: Rig, row: ExecutionRow) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns plan times (n,) [s], and planned positions and speeds (n, 6) of a run's ticks."""
    recording = rig.store.recording(row.id)
    assert recording is not None
    names, rows = rows_of(recording.csv)

    def columns(kind: str) -> np.ndarray:
        return rows[:, [names.index(kind.format(joint)) for joint in range(6)]]

    return rows[:, names.index("clock_s")], columns("planned_q_{}_rad"), columns("planned_qd_{}_rad_s")


def follows(rig: Rig, row: ExecutionRow, pieces: list[tuple[float, Trajectory]]) -> None:
    """Asserts that a run was recorded along motions, each from its time on."""
    assert row.outcome == "completed", row.reason
    clock, q, qd = planned_rows(rig, row)
    expected = q.copy()
    for begins_s, motion in pieces:
        later = clock >= begins_s
        expected[later] = motion.at(clock[later] - begins_s)[0]
    assert np.abs(q - expected)[clock >= 0.0].max() < 1e-6
    limit = rig.cell.limits.qdd_max.max()
    assert np.abs(np.diff(qd, axis=0)).max() < limit * np.diff(clock).max() + TORN_RAD_S
    assert row.metrics is not None
    assert row.metrics["tracking_error_max_rad"] < 0.02


@pytest.mark.parametrize("mode", ["speedj", pytest.param("servoj", marks=pytest.mark.slow)])
def test_a_plan_that_begins_on_the_motion_replaces_it(rig: Rig, mode: str) -> None:
    first, motion = stored(rig, swing(rig, "+-+-"))
    joins_s = 2.0
    second, onward = stored(rig, {**swing(rig, "+"), "start": start_on(motion, joins_s)})
    id = streaming(rig, first, joins_s - AHEAD_S, mode)
    found = answer(rig, id, second)
    assert found["joins_s"] == pytest.approx(joins_s), found
    row = rig.end(id)
    follows(rig, row, [(0.0, motion), (joins_s, onward)])


@pytest.mark.slow
def test_a_replaced_motion_can_be_replaced_again(rig: Rig) -> None:
    first, motion = stored(rig, swing(rig, "+-+-"))
    second, onward = stored(rig, {**swing(rig, "+-"), "start": start_on(motion, 1.6)})
    third, last = stored(rig, {**swing(rig, "-"), "start": start_on(onward, 1.25)})
    id = streaming(rig, first, 0.4)
    assert answer(rig, id, second)["joins_s"] == pytest.approx(1.6)
    assert answer(rig, id, third)["joins_s"] == pytest.approx(2.85)
    follows(rig, rig.end(id), [(0.0, motion), (1.6, onward), (2.85, last)])


def test_what_does_not_fit_is_refused_and_the_motion_goes_on(rig: Rig) -> None:
    first, motion = stored(rig, swing(rig, "+-+-"))
    at = start_on(motion, 2.5)
    off = {name: [x + 1e-4 for x in values] for name, values in at.items()}
    wrong = {
        "position": {**at, "positions": off["positions"]},
        "velocity": {**at, "velocities": off["velocities"]},
        "acceleration": {**at, "accelerations": off["accelerations"]},
    }
    plans = {name: stored(rig, {**swing(rig, "+"), "start": start})[0] for name, start in wrong.items()}
    plans["tick passed"] = stored(rig, {**swing(rig, "+"), "start": start_on(motion, 0.3)})[0]
    other, _ = stored(rig, {**swing(rig, "+"), "start": at})
    row = rig.store.plan(other)
    assert row is not None
    throw = rig.plan(LOB)
    id = streaming(rig, first, 0.6)
    for reason, plan_id in plans.items():
        found = answer(rig, id, plan_id)
        assert found["joins_s"] is None
        assert reason in found["reason"]
    assert answer(rig, id, throw)["joins_s"] is None
    assert "no such plan" in answer(rig, id, new_id())["reason"]
    follows(rig, rig.end(id), [(0.0, motion)])


@pytest.mark.slow
def test_a_certifying_process_that_is_killed_refuses_and_the_motion_goes_on(own_rig: Rig) -> None:
    rig = own_rig
    rig.start()
    first, motion = stored(rig, swing(rig, "+-+-"))
    second, _ = stored(rig, {**swing(rig, "+"), "start": start_on(motion, 1.9)})
    id = streaming(rig, first, 0.4)
    (killed,) = certifying(rig)
    killed.kill()
    found = answer(rig, id, second)
    assert found["joins_s"] is None
    assert "certifying process ended" in found["reason"]
    follows(rig, rig.end(id), [(0.0, motion)])
    assert certifying(rig) == []
    rig.end(rig.queue_plan_when_ready(first))
    assert len(certifying(rig)) == 1


@pytest.mark.slow
def test_a_service_that_is_killed_with_its_planners_leaves_a_replacement_to_the_executor(rig: Rig) -> None:
    first, motion = stored(rig, swing(rig, "+-+-"))
    second, onward = stored(rig, {**swing(rig, "+"), "start": start_on(motion, 1.9)})
    with RigService(rig) as service:
        id = streaming(rig, first, 0.4)

        def ask() -> None:
            with suppress(httpx2.TransportError):  # nobody is there to answer
                service.http.post(f"/executions/{id}/replace", json={"plan_id": second})

        asking = Thread(target=ask)
        asking.start()
        rig.until(lambda: rig.row(id).replace_request is not None, ANSWERED_S, 0.001)
        for process in (*psutil.Process(service.process.pid).children(recursive=True), service.process):
            process.kill()
        asking.join()
    row = rig.end(id)
    (found,) = row.replacements or ()
    assert found["joins_s"] is not None or "tick passed" in found["reason"], found  # a busy machine certifies late
    follows(rig, row, [(0.0, motion), (1.9, onward)] if found["joins_s"] is not None else [(0.0, motion)])


def certifying(rig: Rig) -> list[psutil.Process]:
    """Returns the process of the executor that certifies what is to replace a running motion."""
    assert rig.executor is not None
    return children_with("spawn_main", rig.executor.pid)


@pytest.mark.slow
def test_a_process_killed_as_it_swaps_ends_in_the_usual_stop(own_rig: Rig) -> None:
    rig = own_rig
    rig.start()
    first, motion = stored(rig, swing(rig, "+-+-"))
    second, _ = stored(rig, {**swing(rig, "+"), "start": start_on(motion, 2.0)})
    id = streaming(rig, first, 1.0)
    rig.store.request_replacement(id, second, "test")
    rig.until(lambda: rig.row(id).replacements, ANSWERED_S, 0.001)
    killed_s = rig.state()["t"]
    rig.streamer().send_signal(signal.SIGKILL)
    row = rig.end(id)
    assert row.outcome == "executor_lost"
    assert rig.rest_time(killed_s) < REST_S
