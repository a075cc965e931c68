"""Jobs over HTTP, planned by the service, with an executor that ends executions as the test says."""

from __future__ import annotations

import csv
import io
import math
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import orjson
import pytest

from api.shifts import JobDrivers, run
from api.shifts.planned import MotionPlanner
from store import CellBusy, JobCycleRow, JobDriven, JobLost, Store, new_id
from tests.api.conftest import NO_ID, FakeExecutor, RunningService, beat_as
from tests.api.test_bad_input import problem_of

DOWN = [math.pi, 0.0, 0.0]
PICKS = [{"pose": {"position": [0.45, 0.1 * i, 0.1], "rotation_vector": DOWN}, "object": f"ball {i}"} for i in range(3)]
BIN = {"kind": "target", "position": [1.1, -0.3, 0.0], "opening": {"radius_m": 0.12, "rim_height_m": 0.2}}
POINT = {"kind": "target", "position": [1.2, 0.3, 0.0]}
JOB = {"cell": "ur5e-sim", "picks": PICKS, "targets": [BIN, POINT]}
DONE_S = 120.0  # [s] a handful of plans on a busy machine
TICK_S = 0.02  # [s] between two looks of the executor
COMPLETED = ("completed", {"released": True})
MISSED_GRIP = ("refused", {"grip": {"held": False, "by": "input", "opened_again": True}})


class CarryingExecutor(FakeExecutor):
    """Carries executions out at once: the arm stands where the plan ends, unless the grip failed.

    Attributes:
        ends: outcome and metrics of each execution that throws, in turn; then all are completed.
        ran: plan ids, in the order of the executions.
        gate: executions end while it is set.
        shows: what heartbeats tell of the gripper.
    """

    def __init__(self, store: Store, cell: str = "ur5e-sim") -> None:
        super().__init__(store, cell)
        self.ends: list[tuple[str, dict[str, Any] | None]] = []
        self.ran: list[str] = []
        self.gate = threading.Event()
        self.gate.set()
        self.off_m = 0.0
        self.shows: dict[str, bool] = {}
        self._carrying = threading.Thread(target=self._carry, daemon=True)

    def start(self) -> CarryingExecutor:
        super().start()
        self._carrying.start()
        return self

    def stop(self) -> None:
        self.gate.set()
        super().stop()
        self._carrying.join()

    def beat(self) -> None:
        beat_as(self.store, "fake", self.cell, "sim", {**self.robot, **self.shows}, self.fault, self.read_only)

    def _carry(self) -> None:
        while not self._ended.wait(TICK_S):
            row = self.store.claim_execution(self.cell, "fake")
            if row is not None:
                self.ran.append(row.plan_id)
                self.store.set_state(row.id, "streaming")
                self.gate.wait()
                self._end(row.id, row.plan_id)

    def _end(self, id: str, plan_id: str) -> None:
        plan = self.store.plan(plan_id)
        assert plan is not None
        document = orjson.loads(plan.document)
        throws = document["release"] is not None
        outcome, metrics = self.ends.pop(0) if throws and self.ends else COMPLETED
        if outcome == "completed":
            self.robot = {"positions": document["trajectory"]["positions"][-1]}
            self.beat()
        if throws and (metrics or {}).get("released"):
            x, y, z = document["flight"]["landing_point"]
            self.store.add_landing(new_id(), id, time.time(), "camera", position=[x + self.off_m, y, z], std_m=0.003)
        self.store.finish_execution(id, outcome, "as the test says", metrics)


@pytest.fixture
def carrying(service: RunningService) -> Iterator[CarryingExecutor]:
    fake = CarryingExecutor(service.store).start()
    yield fake
    for row in service.store.unfinished_jobs():
        service.store.cancel_job(row.id)
    fake.gate.set()
    deadline = time.monotonic() + DONE_S
    while service.store.unfinished_jobs():
        assert time.monotonic() < deadline
        time.sleep(TICK_S)
    fake.stop()


def post(service: RunningService, **changes: Any) -> str:
    answer = service.client.post("/jobs", json={**JOB, **changes})
    assert answer.status_code == 201, answer.text
    assert answer.headers["Location"] == f"/jobs/{answer.json()['id']}"
    return answer.json()["id"]


def wait_until(service: RunningService, id: str, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + DONE_S
    while not holds(job := service.client.get(f"/jobs/{id}").json()):
        assert time.monotonic() < deadline, job
        time.sleep(TICK_S)
    return job


def finished(service: RunningService, id: str) -> dict[str, Any]:
    return wait_until(service, id, lambda job: job["state"] == "finished")


def results(service: RunningService, id: str) -> list[dict[str, Any]]:
    return service.client.get(f"/jobs/{id}/results", params={"limit": 200}).json()["results"]


def test_a_job_throws_every_object_once_at_targets_in_turn(service: RunningService, carrying: CarryingExecutor):
    id = post(service)
    job = finished(service, id)
    assert (job["outcome"], job["done"], job["total"], job["current"]) == ("completed", 3, 3, None)
    assert job["record"]["objects"] == {"hit": 3}
    assert job["record"]["hit_interval"][0] == pytest.approx(0.438, abs=1e-3)  # Wilson, of 3 in 3
    found = results(service, id)
    assert [(each["result"], each["target"], each["object"]) for each in found] == [
        ("hit", 0, "ball 0"),
        ("hit", 1, "ball 1"),
        ("hit", 0, "ball 2"),
    ]
    assert len(carrying.ran) == 4  # an approach, three throws
    plans = [orjson.loads(service.store.plan(plan).document) for plan in carrying.ran]  # type: ignore[union-attr]
    for before, after in pairwise(plans):
        assert after["trajectory"]["positions"][0] == before["trajectory"]["positions"][-1]
    names = [[passage["name"] for passage in plan["passages"]] for plan in plans]
    assert names == [["down"], ["up", "throw", "down"], ["up", "throw", "down"], ["up", "throw"]]


def test_tables_have_a_row_an_object(service: RunningService, carrying: CarryingExecutor):
    id = post(service, picks=PICKS[:1])
    finished(service, id)
    answer = service.client.get(f"/jobs/{id}/results", headers={"Accept": "text/csv"})
    (row,) = csv.DictReader(io.StringIO(answer.text))
    (expected,) = results(service, id)
    assert row == {name: "" if value is None else str(value) for name, value in expected.items()}
    pyarrow = pytest.importorskip("pyarrow.parquet")
    answer = service.client.get(f"/jobs/{id}/results", headers={"Accept": "application/vnd.apache.parquet"})
    assert pyarrow.read_table(io.BytesIO(answer.content)).to_pylist() == [expected]


def test_a_missed_grip_is_tried_again_with_the_arm_where_it_stands(service: RunningService, carrying: CarryingExecutor):
    carrying.ends = [MISSED_GRIP]
    id = post(service, picks=PICKS[:2], policy={"missed_grip": "retry"})
    job = finished(service, id)
    assert job["record"]["objects"] == {"hit": 2}
    assert [each["attempts"] for each in results(service, id)] == [2, 1]
    assert [each["target"] for each in results(service, id)] == [0, 1]  # nothing was thrown: the turn is still its own
    assert len(carrying.ran) == 4


def test_a_missed_grip_is_put_aside_and_the_next_pick_approached(service: RunningService, carrying: CarryingExecutor):
    carrying.ends = [MISSED_GRIP]
    id = post(service, picks=PICKS[:2], policy={"missed_grip": "skip"})
    job = finished(service, id)
    assert job["outcome"] == "completed"
    assert job["record"]["misses"] == {"missed_grip": 1}
    first, second = results(service, id)
    assert (first["result"], first["object_at"], second["result"]) == ("missed_grip", "at its pick", "hit")
    plan = orjson.loads(service.store.plan(carrying.ran[2]).document)  # type: ignore[union-attr]
    assert [passage["name"] for passage in plan["passages"]] == ["up", "down"]


def test_a_job_that_stopped_goes_on_where_it_was(service: RunningService, carrying: CarryingExecutor):
    carrying.ends = [MISSED_GRIP]
    id = post(service, picks=PICKS[:2])
    job = finished(service, id)
    assert (job["outcome"], job["reason"]) == ("stopped", "nothing was gripped at pick 0")
    assert [each["result"] for each in results(service, id)] == ["waiting", "waiting"]
    assert service.client.post(f"/jobs/{id}/resume").status_code == 202
    assert finished(service, id)["record"]["objects"] == {"hit": 2}


def test_a_throw_that_did_not_begin_leaves_its_pick_straight_up(service: RunningService, carrying: CarryingExecutor):
    carrying.ends = [("refused", None)]
    id = post(service, picks=PICKS[:1])
    assert finished(service, id)["outcome"] == "stopped"
    service.client.post(f"/jobs/{id}/resume")
    assert finished(service, id)["record"]["objects"] == {"hit": 1}
    assert [each["attempts"] for each in results(service, id)] == [1]
    plan = orjson.loads(service.store.plan(carrying.ran[2]).document)  # type: ignore[union-attr]
    assert [passage["name"] for passage in plan["passages"]] == ["up", "throw"]


@pytest.mark.slow
def test_a_job_that_is_resumed_waits_for_the_one_that_runs_in_its_cell(
    service: RunningService, carrying: CarryingExecutor
):
    carrying.ends = [MISSED_GRIP]
    first = post(service, picks=PICKS[:1])
    finished(service, first)
    carrying.gate.clear()
    second = post(service, picks=PICKS[1:])
    wait_until(service, second, lambda job: job["current"] is not None)
    service.client.post(f"/jobs/{first}/resume")
    with pytest.raises(JobDriven, match=second):
        service.store.claim_job(first, "another service")
    carrying.gate.set()
    assert finished(service, second)["record"]["objects"] == {"hit": 2}
    assert finished(service, first)["record"]["objects"] == {"hit": 1}
    again = [row.asked_at for row in service.store.job_cycles(first)][2:]
    assert min(again) > max(row.ended_at for row in service.store.job_cycles(second))  # type: ignore[type-var]


@pytest.mark.slow
def test_an_arm_that_is_moved_while_its_throw_is_planned_approaches_anew(
    service: RunningService, carrying: CarryingExecutor, monkeypatch: pytest.MonkeyPatch
):
    planned = MotionPlanner.planned
    moved: list[list[float]] = []

    async def moves_the_arm(self: MotionPlanner, motion: Any, start: Any) -> Any:
        found = await planned(self, motion, start)
        if motion.kind == "throw" and not moved:
            moved.append([start[0] + 0.2, *start[1:]])
            carrying.robot = {"positions": moved[0]}
            carrying.beat()
        return found

    monkeypatch.setattr(MotionPlanner, "planned", moves_the_arm)
    id = post(service, picks=PICKS[:1])
    assert finished(service, id)["record"]["objects"] == {"hit": 1}
    assert [row.kind for row in service.store.job_cycles(id)] == ["approach", "approach", "throw"]
    plan = orjson.loads(service.store.plan(carrying.ran[1]).document)  # type: ignore[union-attr]
    assert plan["trajectory"]["positions"][0] == pytest.approx(moved[0], abs=1e-9)


@pytest.mark.parametrize(
    ("shows", "reason"),
    [({"gripper_open": False}, "the gripper is closed: "), ({"gripper_holds": True}, "the gripper holds an object: ")],
)
def test_no_pick_is_approached_with_a_closed_or_full_gripper(
    service: RunningService,
    carrying: CarryingExecutor,
    monkeypatch: pytest.MonkeyPatch,
    shows: dict[str, bool],
    reason: str,
):
    monkeypatch.setattr(run, "READY_S", 0.2)
    carrying.ends = [("protective_stop", {"released": False})]
    id = post(service, picks=PICKS[:2])
    finished(service, id)
    carrying.shows = shows
    carrying.beat()
    service.client.post(f"/jobs/{id}/resume")
    job = finished(service, id)
    assert (job["outcome"], job["reason"]) == ("stopped", f"{reason}empty and open it, then resume")
    assert len(carrying.ran) == 2
    carrying.shows = {"gripper_open": True, "gripper_holds": False}
    carrying.beat()
    service.client.post(f"/jobs/{id}/resume")
    assert finished(service, id)["record"]["objects"] == {"kept": 1, "hit": 1}


def test_a_target_that_was_missed_gets_another_object(service: RunningService, carrying: CarryingExecutor):
    carrying.off_m = 1.0
    id = post(service, policy={"missed_throw": "retry", "attempts": 2})
    job = finished(service, id)
    assert job["record"]["misses"] == {"miss": 3}
    assert len({each["turn"] for each in results(service, id)}) == 2
    assert [each["error_m"] for each in results(service, id)] == pytest.approx([1.0] * 3, abs=0.02)


def test_a_missed_throw_stops_a_job_whose_policy_says_so(service: RunningService, carrying: CarryingExecutor):
    carrying.off_m = 1.0
    id = post(service, policy={"missed_throw": "stop"})
    job = finished(service, id)
    assert (job["outcome"], job["reason"]) == ("stopped", "the object of pick 0 landed beside target 0")
    assert [each["result"] for each in results(service, id)] == ["miss", "waiting", "waiting"]


@pytest.mark.parametrize(
    ("outcome", "metrics", "result"),
    [
        ("protective_stop", {"released": False}, "kept"),
        ("executor_lost", None, "unknown"),
    ],
)
def test_a_fault_stops_the_job_and_nothing_is_thrown_again(
    service: RunningService, carrying: CarryingExecutor, outcome: str, metrics: Any, result: str
):
    carrying.ends = [(outcome, metrics)]
    id = post(service, picks=PICKS[:2])
    job = finished(service, id)
    assert job["outcome"] == "stopped"
    assert outcome in job["reason"]
    first, second = results(service, id)
    assert (first["result"], second["result"]) == (result, "waiting")
    assert "gripper" in first["object_at"]
    service.client.post(f"/jobs/{id}/resume")
    finished(service, id)
    after = results(service, id)
    assert after[0] == first  # put aside
    assert after[1]["result"] == "hit"


def test_a_job_pauses_at_the_next_pick_and_goes_on(service: RunningService, carrying: CarryingExecutor):
    carrying.gate.clear()
    id = post(service, picks=PICKS[:2])
    wait_until(service, id, lambda job: job["current"] is not None)
    assert service.client.post(f"/jobs/{id}/pause").json()["pause_requested"] is True
    carrying.gate.set()
    paused = wait_until(service, id, lambda job: job["state"] == "paused")
    assert paused["current"] is None
    ran = list(carrying.ran)
    assert len(ran) == 1
    service.client.post(f"/jobs/{id}/resume")
    assert finished(service, id)["outcome"] == "completed"
    assert carrying.ran[:1] == ran


def test_a_cancelled_job_ends_after_its_motion(service: RunningService, carrying: CarryingExecutor):
    carrying.gate.clear()
    id = post(service, picks=PICKS[:2])
    wait_until(service, id, lambda job: job["current"] is not None)
    service.client.post(f"/jobs/{id}/cancel")
    carrying.gate.set()
    assert finished(service, id)["outcome"] == "cancelled"
    assert len(carrying.ran) == 1
    assert [each["result"] for each in results(service, id)] == ["waiting", "waiting"]


def test_a_pick_that_cannot_be_reached_is_put_aside_with_its_reason(
    service: RunningService, carrying: CarryingExecutor
):
    far = {"pose": {"position": [3.0, 0.0, 0.1], "rotation_vector": DOWN}}
    id = post(service, picks=[PICKS[0], far, PICKS[1]])
    job = finished(service, id)
    assert job["outcome"] == "completed"
    assert job["record"]["misses"] == {"not_planned": 1}
    put_aside = results(service, id)[1]
    assert (put_aside["result"], put_aside["object_at"]) == ("not_planned", "at its pick")
    assert put_aside["reason"]


def test_events_tell_the_progress_to_the_end(service: RunningService, carrying: CarryingExecutor):
    id = post(service, picks=PICKS[:1])
    with service.client.stream("GET", f"/jobs/{id}/events") as answer:
        lines = [line for line in answer.iter_lines() if line.startswith(("id:", "data:"))]
    told = [orjson.loads(line[5:]) for line in lines if line.startswith("data:")]
    ids = [int(line[3:]) for line in lines if line.startswith("id:")]
    assert ids == sorted(ids)
    assert told[-1] == service.client.get(f"/jobs/{id}").json()
    assert told[-1]["outcome"] == "completed"


def test_a_driver_that_takes_a_job_over_asks_for_nothing_twice(service: RunningService, carrying: CarryingExecutor):
    """The first driver dies without a word in mid motion; another one finds the motion in the record."""
    carrying.gate.clear()
    id = post(service, picks=PICKS[:2])
    wait_until(service, id, lambda job: job["current"] is not None)
    other = JobDrivers(service.client.app.state.service)  # type: ignore[attr-defined]
    with pytest.raises(JobLost):
        service.store.beat_job(id, other._name, "running")
    service.store.release_job(id, service.store.job(id).driver_id)  # type: ignore[union-attr,arg-type]
    carrying.gate.set()
    job = finished(service, id)
    assert job["record"]["objects"] == {"hit": 2}
    assert len(carrying.ran) == 3
    cycles = service.store.job_cycles(id)
    assert len({row.execution_id for row in cycles}) == len(cycles) == 3


def test_a_motion_is_stored_with_its_execution_or_not_at_all(service: RunningService, executor: FakeExecutor):
    store = service.store
    plan_id = service.plan()["id"]
    row = store.add_job("ur5e-sim", {}, 1)
    cycle = JobCycleRow(row.id, 0, "throw", 0, None, plan_id=plan_id)
    store.claim_job(row.id, "first")
    open_id = store.queue_execution(plan_id, "ur5e-sim").id
    with pytest.raises(CellBusy):
        store.ask_job_cycle("first", cycle, "ur5e-sim", "me")
    assert store.job_cycles(row.id) == []
    store.finish_execution(open_id, "aborted")
    with pytest.raises(JobLost):
        store.ask_job_cycle("second", cycle, "ur5e-sim", "me")
    assert store.open_execution("ur5e-sim") is None
    asked = store.ask_job_cycle("first", cycle, "ur5e-sim", "me")
    assert store.job_cycles(row.id) == [asked]
    assert store.open_execution("ur5e-sim") == asked.execution_id
    store.finish_job(row.id, "first", "cancelled")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"picks": [{"pose": {"position": [0.4, 0.0, 0.1], "rotation_vector": [0.0, 0.0]}}]}, "picks[0].pose"),
        ({"targets": [{**POINT, "opening": {"radius_m": 0.01, "rim_height_m": 0.1}}]}, "targets[0]"),
        ({"line_speed_m_s": 1.5}, "approach_m"),
        ({"polcy": {}}, "polcy"),
    ],
)
def test_a_job_that_is_refused_names_its_field_and_leaves_nothing(
    service: RunningService, change: dict[str, Any], field: str
):
    before = service.client.get("/jobs").json()
    problem = problem_of(service.client.post("/jobs", json={**JOB, **change}), 422, "invalid-request")
    assert any(error["field"].startswith(field) for error in problem["errors"]), problem
    assert service.client.get("/jobs").json() == before


def test_a_job_is_made_once_for_its_key(service: RunningService, carrying: CarryingExecutor):
    key = {"Idempotency-Key": new_id()}
    first, second = (service.client.post("/jobs", json=JOB, headers=key) for _ in range(2))
    assert first.json()["id"] == second.json()["id"]
    service.client.post(f"/jobs/{first.json()['id']}/cancel")
    assert first.json()["id"] in [row["id"] for row in service.client.get("/jobs").json()["jobs"]]


def test_a_job_or_a_cell_that_is_not_there(service: RunningService):
    problem_of(service.client.get(f"/jobs/{NO_ID}"), 404, "not-found")
    problem_of(service.client.post("/jobs", json={**JOB, "cell": "nowhere"}), 404, "not-found")


def test_only_operators_of_guarded_services_move_real_arms(service: RunningService):
    problem = problem_of(service.client.post("/jobs", json={**JOB, "cell": "real"}), 403, "forbidden")
    assert "simulated cells only" in problem["detail"]


@pytest.mark.slow
def test_what_a_lost_executor_tells_late_is_learnt_when_the_job_goes_on(
    service: RunningService, carrying: CarryingExecutor
):
    carrying.ends = [("executor_lost", None)]
    id = post(service, picks=PICKS[:2])
    finished(service, id)
    lost = results(service, id)[0]
    assert lost["result"] == "unknown"
    assert service.store.finish_execution(lost["execution_id"], "completed", None, {"released": True}, is_known=True)
    service.client.post(f"/jobs/{id}/resume")
    finished(service, id)
    assert [each["result"] for each in results(service, id)] == ["thrown", "hit"]


def test_a_job_whose_driver_cannot_read_it_stops_and_the_next_one_runs(
    service: RunningService, carrying: CarryingExecutor
):
    broken = service.store.add_job("ur5e-sim", {"picks": "of another version"}, 1).id
    id = post(service, picks=PICKS[:1])
    deadline = time.monotonic() + DONE_S
    while (row := service.store.job(broken)) is not None and row.state != "finished":
        assert time.monotonic() < deadline
        time.sleep(TICK_S)
    assert row is not None
    assert row.outcome == "stopped"
    assert "InvalidProblem" in (row.reason or "")
    assert finished(service, id)["outcome"] == "completed"
