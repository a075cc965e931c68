"""Motions through several passages on a simulated cell: their outputs' edges in the controller's truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from executor.robot import set_outputs
from executor.streaming.state_checks import OUTPUT_SHIFT
from learning import calibration_moves, cell_in_use, estimate_profile, profile_bytes
from planner.answer import plan_document
from planner.controller_program import SwitchRow
from planner.planning import plan
from planner.request import problem_from_request
from store import ExecutionRow, new_id
from tests.system.rig import LOB, Rig, rows_of

DOWN = [math.pi, 0.0, 0.0]  # rotation vector of a tool that looks down
PULSE_S = 0.02
RUNS = 5
ROUNDING_S = 1e-9
VALVE = 7  # standard digital output
Edge = tuple[str, int, bool, float]  # output, index, level, plan time [s]


def part(number: int) -> dict[str, Any]:
    """Returns a passage over a part of a row, with two pulses on an output of its own."""
    line = {"output": "standard_digital", "index": number}
    offsets = [PULSE_S * i for i in range(4)]
    return {
        "name": f"part {number}",
        "state": {
            "kind": "pose",
            "pose": {"position": [0.5, 0.12 * number - 0.24, 0.35], "rotation_vector": DOWN},
            "twist": {"linear": [0.0, 0.8, 0.0], "angular": [0.0, 0.0, 0.0]},
        },
        "outputs": [{**line, "level": i % 2 == 0, "offset_s": offset} for i, offset in enumerate(offsets)],
    }


ROW = {"passages": [part(number) for number in range(5)]}
THROW = {
    "passages": [
        {
            "name": "throw",
            "state": LOB,
            "releases": True,
            "outputs": [
                {"output": "standard_digital", "index": 6, "level": True, "offset_s": -0.05},
                {"output": "standard_digital", "index": 6, "level": False, "offset_s": 0.1},
            ],
        }
    ]
}


CAMERA = {
    "name": "camera",
    "state": {
        "kind": "pose",
        "pose": {"position": [0.1, -0.45, 0.4], "rotation_vector": DOWN},
        "twist": {"linear": [0.0, 0.45, 0.0], "angular": [0.0, 0.0, 0.0]},
    },
    "outputs": [{"output": "standard_digital", "index": 0, "level": i == 0, "offset_s": 0.03 * i} for i in range(2)],
}


def stored(rig: Rig, request: dict[str, Any]) -> str:
    """Plans a request, with the profile that the cell uses, and stores it; returns the plan's id."""
    request = {"cell": "rig", **request}
    cell, profile = cell_in_use(rig.store, rig.cell)
    found = plan(problem_from_request(request, cell))
    id = new_id()
    rig.add_plan(plan_document(found, request, id, "2026-01-01T00:00:00Z") | {"profile": profile})
    return id


def true_edges(rig: Rig, row: ExecutionRow) -> list[Edge]:
    """Returns the edges of the standard outputs that happened in a run, on the plan's clock, from the simulator."""
    recording = rig.store.recording(row.id)
    assert recording is not None
    names, rows = rows_of(recording.csv)
    begun_s = float(rows[0, names.index("timestamp_s")])
    at_zero_s = begun_s - float(rows[0, names.index("clock_s")])
    found = []
    before = 0
    for t, bits in rig.state()["output_changes"]:
        if t > begun_s:
            for i in range(8):
                if (bits ^ before) >> OUTPUT_SHIFT["standard_digital"] + i & 1:
                    found.append(("standard_digital", i, bool(bits >> i & 1), t - at_zero_s))
        before = bits
    return found


def planned_edges(document: dict[str, Any]) -> list[Edge]:
    """Returns the edges of a plan, in the order of their times."""
    edges = [
        (each["output"], each["index"], each["level"], each["edge_time_s"])
        for passage in document["passages"]
        for each in passage["outputs"]
    ]
    return sorted(edges, key=lambda edge: edge[3])


def as_planned(rig: Rig, row: ExecutionRow) -> None:
    """Asserts that truth, record and plan agree on every edge within a tick."""
    document = rig.document(row.id)
    tick_s = 1.0 / document["sample_rate_hz"]
    planned = planned_edges(document)
    happened = true_edges(rig, row)
    assert [edge[:3] for edge in happened] == [edge[:3] for edge in planned]
    assert max(abs(a[3] - b[3]) for a, b in zip(happened, planned, strict=True)) <= tick_s
    assert row.metrics is not None
    recorded = row.metrics["outputs"]
    assert len(recorded) == len(planned)
    for each, (*_, at_s) in zip(recorded, happened, strict=True):
        assert -ROUNDING_S < each["edge_time_s"] - at_s < tick_s + ROUNDING_S  # seen with the next state
        assert each["command_time_s"] < each["edge_time_s"]


@pytest.mark.slow
def test_a_hundred_edges_happen_within_a_tick_of_the_plan(rig: Rig) -> None:
    plan_id = stored(rig, ROW)
    newest = rig.newest_object()
    edges = 0
    for _ in range(RUNS):
        row = rig.quiet_run(plan_id)
        assert row.outcome == "completed", row.reason
        assert "output" not in row.reason
        as_planned(rig, row)
        edges += len(row.metrics["outputs"])
    assert edges == 100
    assert rig.newest_object() == newest


@pytest.mark.slow
def test_a_known_delay_of_the_outputs_is_made_up_for(own_rig: Rig) -> None:
    truth = own_rig.folder / "truth.toml"
    truth.write_text("[timing]\noutput_delay_s = 0.0275\n")
    names = "".join(
        f'\n[outputs.flash_{i}]\noutput = "standard_digital"\nindex = {i}\ndelay_s = 0.0075\n' for i in range(5)
    )
    own_rig.rewrite(own_rig.path.read_text() + names)
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    own_rig.start_executor()
    row = own_rig.quiet_run(stored(own_rig, ROW))
    assert row.outcome == "completed", row.reason
    as_planned(own_rig, row)


HIDDEN_S = ((0.0131, 0.0012), (0.0274, 0.0008))  # [s] delay and jitter of what two outputs switch
CALIBRATIONS = 6  # runs of eight edges each
LEARNT_S = 0.0005  # [s] promised of the mean


def device_edges(rig: Rig, row: ExecutionRow, name: str, count: int) -> list[float]:
    """Returns the newest changes of what an output switches, on a run's plan clock, from the simulator [s]."""
    recording = rig.store.recording(row.id)
    assert recording is not None
    names, rows = rows_of(recording.csv)
    at_zero_s = float(rows[0, names.index("timestamp_s")]) - float(rows[0, names.index("clock_s")])
    return [at - at_zero_s for at, _ in rig.state()["device_changes"][name][-count:]]


@pytest.mark.slow
def test_hidden_delays_of_outputs_are_learnt_and_made_up_for(own_rig: Rig) -> None:
    rig = own_rig
    cell = truth = ""
    for i, (delay_s, jitter_s) in enumerate(HIDDEN_S):
        cell += f'\n[outputs.flash_{i}]\noutput = "standard_digital"\nindex = {i}\nsense_input = {i + 8}\n'
        truth += f"[outputs.flash_{i}]\ndelay_s = {delay_s}\njitter_s = {jitter_s}\n"
    (rig.folder / "truth.toml").write_text(truth)
    rig.rewrite(rig.path.read_text() + cell)
    rig.start_simulator("--truth", str(rig.folder / "truth.toml"), "--reveal")
    rig.start_executor()
    request = calibration_moves(rig.cell, 2)["outputs"][0]
    shorter = [each | {"outputs": each["outputs"][:4]} for each in request["passages"]]  # a script holds 2 s
    plan_ids = {"speedj": stored(rig, request), "script": stored(rig, request | {"passages": shorter})}
    for mode in ["script", "servoj"] + ["speedj"] * CALIBRATIONS:
        row = rig.quiet_run(plan_ids.get(mode, plan_ids["speedj"]), mode)
        assert row.metrics is not None, row.reason
        for i in range(len(HIDDEN_S)):
            recorded = [each for each in row.metrics["outputs"] if each["index"] == i]
            happened = device_edges(rig, row, f"flash_{i}", len(recorded))
            for each, at_s in zip(recorded, happened, strict=True):
                assert each["edge_after_s"] - ROUNDING_S < at_s < each["edge_time_s"] + ROUNDING_S
    document = estimate_profile(rig.store, rig.cell)
    for i, (delay_s, jitter_s) in enumerate(HIDDEN_S):
        learnt = document["outputs"][f"flash_{i}"]
        assert learnt["edges"] >= 8 * CALIBRATIONS
        lead_s = delay_s + rig.cell.sim.lag_s
        assert learnt["delay_s"] + document["lag_s"] == pytest.approx(lead_s, abs=LEARNT_S)
        assert learnt["jitter_s"] == pytest.approx(jitter_s, abs=4.0 * learnt["jitter_std_s"])
    profile = rig.store.add_profile("rig", rig.cell.sha256, "test", profile_bytes(document))
    rig.store.adopt_profile("rig", profile.id, "test")
    row = rig.quiet_run(stored(rig, {"passages": [part(i) for i in range(2)]}))
    assert row.outcome == "completed", row.reason
    passages = rig.document(row.id)["passages"]
    for i, ((_, jitter_s), passed) in enumerate(zip(HIDDEN_S, passages, strict=True)):
        planned = [edge["edge_time_s"] for edge in passed["outputs"]]
        happened = device_edges(rig, row, f"flash_{i}", len(planned))
        room_s = 1.0 / rig.cell.robot.sample_rate_hz + LEARNT_S + 3.0 * jitter_s
        assert max(abs(a - b) for a, b in zip(happened, planned, strict=True)) <= room_s


@pytest.mark.parametrize(
    "mode", ["speedj", *(pytest.param(mode, marks=pytest.mark.slow) for mode in ("servoj", "script"))]
)
def test_a_camera_is_triggered_before_the_release_of_a_throw(rig: Rig, mode: str) -> None:
    row = rig.quiet_run(stored(rig, THROW), mode)
    assert row.outcome == "completed", row.reason
    as_planned(rig, row)
    assert row.metrics is not None
    assert row.metrics["released"]
    if mode != "servoj":
        assert row.metrics["landing_error_m"] < 0.02


@pytest.mark.slow
def test_an_object_is_thrown_after_a_passage_of_the_tool_itself(rig: Rig) -> None:
    row = rig.quiet_run(stored(rig, {"passages": [CAMERA, *THROW["passages"]]}))
    assert row.outcome == "completed", row.reason
    as_planned(rig, row)
    assert row.metrics is not None
    assert row.metrics["landing_error_m"] < 0.02


def valve_opened(rig: Rig, mode: str) -> str:
    """Queues a motion with a valve that is open from its first part to its last, until it opens; returns the id."""
    line = {"output": "standard_digital", "index": VALVE}
    opened = part(0) | {"outputs": [{**line, "level": True}]}
    closed = part(4) | {
        "outputs": [{**line, "level": False}, {"output": "standard_digital", "index": 5, "level": True}]
    }
    set_outputs(rig.host, [SwitchRow(0, "standard_digital", index, False) for index in (5, VALVE)])
    id = rig.queue_plan_when_ready(stored(rig, {"passages": [opened, part(1), part(2), closed]}), mode)
    rig.until(lambda: rig.state()["digital_outputs"] >> VALVE & 1, period=0.001)
    return id


def closes_the_valve(rig: Rig, id: str) -> ExecutionRow:
    """Asserts that a stop closes the valve, and says so; returns the execution."""
    row = rig.end(id)
    outputs = rig.state()["digital_outputs"]
    assert not outputs >> VALVE & 1, row.reason
    assert not outputs >> 5 & 1
    assert "not seen" not in (row.reason or "")
    assert row.metrics is not None
    ended = [each for each in row.metrics["outputs"] if each["passage"] is None]
    assert [(each["index"], each["level"]) for each in ended] == [(VALVE, False)]
    assert ended[0]["command_time_s"] > row.metrics["outputs"][0]["command_time_s"]
    return row


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["speedj", "script"])
def test_a_stop_switches_off_what_the_plan_was_to_switch_off_later(rig: Rig, mode: str) -> None:
    id = valve_opened(rig, mode)
    rig.store.request_abort(id)
    assert closes_the_valve(rig, id).outcome == "aborted"


STOPS: dict[str, tuple[Callable[[Rig], None], str]] = {  # which are no orderly brake, and their outcomes
    "protective stop": (lambda rig: rig.fault("protective_stop"), "protective_stop"),
    "emergency stop": (lambda rig: rig.fault("emergency_stop"), "emergency_stop"),
    "slider": (lambda rig: rig.fault("speed_slider", fraction=0.5), "aborted"),
    "pause": (lambda rig: rig.fault("pause_program"), "aborted"),
    "stop": (lambda rig: rig.fault("stop_program"), "aborted"),
    "killed": (lambda rig: rig.streamer().kill(), "executor_lost"),
}


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["speedj", "script"])
@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_that_is_no_orderly_brake_switches_it_off_too(rig: Rig, stop: str, mode: str) -> None:
    happens, outcome = STOPS[stop]
    id = valve_opened(rig, mode)
    happens(rig)
    assert closes_the_valve(rig, id).outcome == outcome


@pytest.mark.slow
def test_an_output_that_stays_on_is_named(rig: Rig) -> None:
    id = valve_opened(rig, "speedj")
    rig.fault("outputs_stuck")
    rig.fault("protective_stop")
    row = rig.end(id)
    assert "standard_digital 7 was not seen to switch off" in (row.reason or "")
    assert row.metrics is not None
    assert all(each["passage"] for each in row.metrics["outputs"])
