"""What a job does next, and what became of its objects, from records written by hand."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.cycles import JobOrder, JobProgress, cycle_end, object_results, progress_of, shift_record, wilson_interval
from planner.errors import InvalidProblem
from store import ExecutionRow, JobCycleRow, LandingRow

DOWN = [math.pi, 0.0, 0.0]
POSES = [{"position": [0.45, 0.1 * i, 0.1], "rotation_vector": DOWN} for i in range(3)]
TARGETS = [{"kind": "target", "position": [1.1, y, 0.0]} for y in (-0.2, 0.3)]
APPROACH = JobCycleRow("job", 0, "approach", None, 0, result="moved", outcome="completed", ended_at=1.0)


def ordered(**policy: Any) -> JobOrder:
    body = {"picks": [{"pose": pose} for pose in POSES], "targets": TARGETS, "policy": policy}
    return JobOrder.read(body, "cell")


def throw(number: int, pick: int, next_pick: int | None, turn: int, **changed: Any) -> JobCycleRow:
    row = JobCycleRow("job", number, "throw", pick, next_pick, turn, turn % 2, execution_id=f"e{number}")
    row = replace(row, target_m=TARGETS[turn % 2]["position"], hit_radius_m=0.05)
    return replace(row, **{"result": "thrown", "outcome": "completed", "ended_at": number + 1.0, **changed})


def landing(number: int, x: float, y: float) -> LandingRow:
    return LandingRow(f"l{number}", f"e{number}", 100.0 + number, "camera", "me", [x, y, 0.0], 0.003)


def execution(outcome: str, metrics: dict[str, Any] | None) -> ExecutionRow:
    return ExecutionRow("e", "p", "cell", "speedj", False, "me", 0.0, None, None, None, "finished", outcome, "why",
                        metrics, 1.0)  # fmt: skip


def test_a_job_approaches_throws_and_ends_at_home():
    order = ordered()
    first = JobProgress(order, []).next_motion(None)
    assert first is not None
    assert (first.kind, first.next_pick, first.rises_from) == ("approach", 0, None)
    second = JobProgress(order, [APPROACH])
    found = second.next_motion(second.arm_at())
    assert found is not None
    assert (found.kind, found.pick, found.next_pick, found.rises_from, found.turn) == ("throw", 0, 1, 0, 0)
    rows = [APPROACH, throw(1, 0, 1, 0), throw(2, 1, 2, 1)]
    last = JobProgress(order, rows).next_motion(2)
    assert last is not None
    assert (last.pick, last.next_pick, last.turn) == (2, None, 2)
    assert JobProgress(order, [*rows, throw(3, 2, None, 2)]).next_motion(None) is None


def test_an_arm_that_was_moved_approaches_its_pick_again():
    found = JobProgress(ordered(), [APPROACH]).next_motion(None)
    assert found is not None
    assert (found.kind, found.next_pick, found.rises_from) == ("approach", 0, None)


@pytest.mark.parametrize(("way", "again"), [("retry", [0, 0, 1]), ("skip", [0, 1, 2]), ("stop", [0, 0, 0])])
def test_a_missed_grip_is_retried_skipped_or_waits(way: str, again: list[int]):
    order = ordered(missed_grip=way, attempts=2)
    rows = [APPROACH]
    picks = []
    for number in (1, 2, 3):
        picks.append(next(pick for pick in range(3) if JobProgress(order, rows).state_of(pick) == "waiting"))
        rows.append(throw(number, picks[-1], None, 0, result="missed_grip", outcome="refused",
                          attempt=1 + sum(row.pick == picks[-1] for row in rows)))  # fmt: skip
    assert picks == again
    stops = JobProgress(order, rows).stop_reason(0.0)
    assert (stops is not None) == (way == "stop")
    assert JobProgress(order, rows).stop_reason(100.0) is None  # resumed since


def test_a_grip_that_is_skipped_leads_from_its_pick_to_the_next():
    rows = [APPROACH, throw(1, 0, 1, 0, result="missed_grip", outcome="refused")]
    progress = JobProgress(ordered(missed_grip="skip"), rows)
    found = progress.next_motion(progress.arm_at())
    assert found is not None
    assert (found.kind, found.rises_from, found.next_pick) == ("approach", 0, 1)


def test_a_missed_grip_uses_no_turn_of_a_target():
    rows = [APPROACH, throw(1, 0, 1, 0, result="missed_grip", outcome="refused")]
    found = JobProgress(ordered(missed_grip="retry"), rows).next_motion(0)
    assert found is not None
    assert (found.pick, found.turn, found.attempt) == (0, 0, 2)


def test_a_target_that_was_missed_gets_another_object_until_its_attempts_are_used():
    order = ordered(missed_throw="retry", attempts=2)
    rows = [APPROACH, throw(1, 0, 1, 0)]
    missed = progress_of(order, rows, [landing(1, 1.1, 0.3)])  # half a metre off
    assert missed.missed == {1: 101.0}
    found = missed.next_motion(1)
    assert found is not None
    assert found.turn == 0
    twice = progress_of(order, [*rows, throw(2, 1, 2, 0)], [landing(1, 1.1, 0.3), landing(2, 1.1, 0.3)])
    found = twice.next_motion(2)
    assert found is not None
    assert found.turn == 1
    skipped = progress_of(ordered(missed_throw="skip"), rows, [landing(1, 1.1, 0.3)]).next_motion(1)
    assert skipped is not None
    assert skipped.turn == 1


def test_a_missed_throw_stops_a_job_whose_policy_says_so_until_it_is_resumed():
    progress = progress_of(ordered(missed_throw="stop"), [APPROACH, throw(1, 0, 1, 0)], [landing(1, 1.1, 0.3)])
    assert progress.stop_reason(0.0) == "the object of pick 0 landed beside target 0"
    assert progress.stop_reason(102.0) is None


@pytest.mark.parametrize(
    ("outcome", "metrics", "claimed_at", "result"),
    [
        ("completed", {"released": True}, 0.5, "thrown"),
        ("refused", {"grip": {"held": False, "by": "input", "opened_again": True}}, 0.5, "missed_grip"),
        ("refused", {"grip": {"held": False, "by": "input", "opened_again": False}}, 0.5, "not_begun"),
        ("refused", None, 0.5, "not_begun"),
        ("aborted", None, 0.5, "not_begun"),
        ("executor_lost", None, None, "not_begun"),
        ("executor_lost", None, 0.5, "unknown"),
        ("aborted", {"released": False}, 0.5, "kept"),
        ("aborted", {"released": False, "ticks": 7}, 0.5, "kept"),
        ("aborted", {"released": False, "ticks": 0}, 0.5, "not_begun"),
        ("released_early", {"released": False, "ticks": 0}, 0.5, "dropped"),
        ("completed", {"released": True, "object_left": True}, 0.5, "thrown"),
        ("completed", {"released": True, "object_left": False}, 0.5, "kept"),
        ("held", {"released": False}, 0.5, "kept"),
        ("protective_stop", {"released": True}, 0.5, "unknown"),
        ("released_early", {"released": False}, 0.5, "dropped"),
        ("not_released", {"released": True}, 0.5, "kept"),
        ("completed", {"released": True, "grip": {"held": True, "by": "gripper"}}, 0.5, "thrown"),
    ],
)
def test_what_an_execution_was_for_its_job(outcome: str, metrics: Any, claimed_at: float | None, result: str):
    ran = replace(execution(outcome, metrics), claimed_at=claimed_at)
    found = cycle_end(throw(1, 0, 1, 0), ran, was_seen_moving=False)
    assert found.result == result
    assert found.object_at
    row = throw(1, 0, 1, 0, result=result, outcome=outcome)
    stops = JobProgress(ordered(missed_grip="retry"), [APPROACH, row]).stop_reason(0.0) is not None
    assert stops == (result not in ("thrown", "missed_grip"))


@pytest.mark.parametrize(
    ("result", "frees"), [("kept", True), ("dropped", True), ("unknown", True), ("not_begun", False)]
)
def test_a_job_that_stops_with_a_gripper_that_may_be_full_says_that_it_is_to_be_emptied(result: str, frees: bool):
    row = throw(1, 0, 1, 0, result=result, outcome="aborted", reason="so")
    reason = JobProgress(ordered(), [APPROACH, row]).stop_reason(0.0)
    assert reason is not None
    assert ("empty and open the gripper" in reason) == frees


def test_a_throw_that_did_not_begin_is_no_attempt():
    rows = [APPROACH, throw(1, 0, 1, 0, result="not_begun", outcome="aborted")]
    progress = JobProgress(ordered(missed_grip="retry", attempts=1), rows)
    found = progress.next_motion(progress.arm_at())
    assert found is not None
    assert (found.pick, found.attempt, found.rises_from) == (0, 1, 0)
    missed = throw(2, 0, 1, 0, result="missed_grip", outcome="refused", attempt=found.attempt)
    assert JobProgress(progress.order, [*rows, missed]).state_of(0) == "missed_grip"
    assert JobProgress(progress.order, [*rows, missed]).attempts(0) == 1


def test_two_approaches_in_a_row_without_a_motion_stop_a_job_until_it_is_resumed():
    said = {"result": "not_planned", "reason": "in a collision", "outcome": None}
    first, second = (replace(APPROACH, number=i, next_pick=i, ended_at=i + 1.0, **said) for i in (0, 1))
    assert JobProgress(ordered(), [first]).stop_reason(0.0) is None
    both = JobProgress(ordered(), [first, second])
    expected = "no motion was found in 2 approaches in a row, at last to pick 1: in a collision"
    assert both.stop_reason(0.0) == expected
    assert both.stop_reason(1.5) is None
    assert JobProgress(ordered(), [first, throw(1, 0, 1, 0), second]).stop_reason(0.0) is None


def test_what_was_not_thrown_for_certain_is_picked_again_and_nothing_else():
    order = ordered()
    for result, state in (("not_begun", "waiting"), ("unknown", "unknown"), ("kept", "kept"), ("thrown", "thrown")):
        row = throw(1, 0, 1, 0, result=result, outcome="executor_lost")
        assert JobProgress(order, [APPROACH, row]).state_of(0) == state


def test_the_record_counts_hits_misses_by_cause_and_cycles():
    order = ordered(missed_grip="skip")
    rows = [
        replace(APPROACH, asked_at=0.0, ended_at=2.0),
        throw(1, 0, 1, 0, asked_at=2.0, ended_at=5.0),
        throw(2, 1, 2, 1, asked_at=5.0, ended_at=9.0),
        throw(3, 2, None, 2, asked_at=9.0, ended_at=10.0, result="missed_grip", outcome="refused"),
    ]
    seen = [landing(1, 1.1, -0.21), landing(2, 1.1, 0.36)]
    objects = object_results(order, rows, seen)
    assert [each["result"] for each in objects] == ["hit", "miss", "missed_grip"]
    assert objects[1]["error_m"] == pytest.approx(0.06)
    record = shift_record(objects, rows)
    assert (record["thrown"], record["hits"], record["landings_seen"]) == (2, 1, 2)
    assert record["misses"] == {"miss": 1, "missed_grip": 1}
    assert record["cycles_per_hour"] == pytest.approx(720.0)
    assert record["cycle_time_s"] == pytest.approx(3.5)


def test_wilson_intervals_are_those_of_scipy():
    from scipy.stats import binomtest

    for hits, throws in ((0, 5), (3, 7), (97, 100), (40, 40)):
        expected = binomtest(hits, throws).proportion_ci(method="wilson")
        assert wilson_interval(hits, throws) == pytest.approx([expected.low, expected.high], abs=1e-12)
    assert wilson_interval(0, 0) is None


def test_a_grid_is_its_picks_row_by_row():
    grid = {"corner": POSES[0], "along_m": [0.0, 0.1, 0.0], "across_m": [0.05, 0.0, 0.01], "columns": 3, "rows": 2}
    order = JobOrder.read({"picks": {"grid": grid}, "targets": TARGETS}, "cell")
    expected = [
        [0.45, 0.0, 0.1],
        [0.45, 0.1, 0.1],
        [0.45, 0.2, 0.1],
        [0.5, 0.0, 0.11],
        [0.5, 0.1, 0.11],
        [0.5, 0.2, 0.11],
    ]
    np.testing.assert_allclose([each["pose"]["position"] for each in order.picks], expected, atol=1e-12)
    assert JobOrder.read(order.to_json(), "other") == order


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"picks": []}, "picks"),
        ({"picks": [{"pose": {"position": [0.4, 0.0], "rotation_vector": DOWN}}]}, "picks[0].pose.position"),
        ({"targets": [{"kind": "target", "position": {"target": "latest"}}]}, "targets[0].position"),
        ({"targets": [{"kind": "pose", "position": [1.0, 0.0, 0.0]}]}, "targets[0].kind"),
        ({"policy": {"missed_grip": "again"}}, "policy.missed_grip"),
        ({"policy": {"attempts": 0}}, "policy.attempts"),
        ({"line_speed_m_s": 1.0}, "approach_m"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_refused_job_names_its_field(change: dict[str, Any], field: str):
    with pytest.raises(InvalidProblem) as refused:
        JobOrder.read({"picks": [{"pose": POSES[0]}], "targets": TARGETS, **change}, "cell")
    assert field in [error.field for error in refused.value.errors]


def test_the_job_of_the_how_to_is_one(root: Path):
    block = re.search(r"```json\n(.*?)```", (root / "docs" / "how-to" / "jobs.md").read_text(), re.DOTALL)
    assert block is not None
    assert len(JobOrder.read(json.loads(block[1]), "cell").picks) == 6
