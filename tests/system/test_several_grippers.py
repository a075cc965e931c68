"""Two objects thrown in one motion on a simulated cell: each leaves by its own output, and lands at its own target."""

from __future__ import annotations

import socket
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from executor.streaming.state_checks import OUTPUT_SHIFT
from planner.answer import plan_document
from planner.planning import plan
from planner.request import problem_from_request
from store import new_id
from tests.planner.two_grippers import TARGETS, two_grippers, two_throws
from tests.system.rig import Rig
from tests.system.test_moving_target import READY_S, begun_later
from tests.system.test_passages import stored

HIDDEN_DELAYS_S = {"": 0.044, "left": 0.033}  # of the true grippers: later than the cell file says
LANDED_M = 0.01  # of 0.5 s of flight at 2 m/s, on an arm that follows its plan
TICK_S = 0.002
BELT_M_S = np.array([0.0, 0.2, 0.0])


class LoadedRig(Rig):
    """A rig at which somebody closes the further gripper before each run."""

    def queue_plan(self, plan_id: str, mode: str = "speedj", dry_run: bool = False) -> str:
        """Queues an execution of a stored plan, both grippers loaded; returns its id."""
        with socket.create_connection((self.host, 30002)) as pendant:
            pendant.sendall(b"sec load():\n  set_standard_digital_out(1, False)\nend\n")
            self.until(lambda: self.state()["grippers_hold"]["left"] is not None)
        return super().queue_plan(plan_id, mode, dry_run)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """A rig of this test only, with a tool of two grippers, not started."""
    rig = LoadedRig(tmp_path)
    rig.rewrite(two_grippers(rig.path.read_text()))
    return rig


@pytest.mark.parametrize("mode", ["speedj", pytest.param("servoj", marks=pytest.mark.slow)])
def test_two_balls_land_at_their_two_targets(rig: Rig, mode: str) -> None:
    try:
        rig.start()
        row = rig.quiet_run(stored(rig, two_throws()), mode)
        assert row.outcome == "completed", row.reason
        landed = {each.get("gripper", ""): each for each in rig.world()["landings"] if each["bounce"] == 0}
        assert set(landed) == {"", "left"}
        for name, target in TARGETS.items():
            assert np.linalg.norm(np.array(landed[name]["position_m"]) - target) < LANDED_M
        assert row.metrics is not None
        assert row.metrics["landing_error_m"] < LANDED_M
        (further,) = row.metrics["grippers"]
        assert further["gripper"] == "left"
        assert further["landing_error_m"] < LANDED_M
        assert further["opened_late_s"] == pytest.approx(0.0, abs=4e-3)
        document = rig.document(row.id)
        assert further["commanded_s"] == pytest.approx(
            document["passages"][1]["command_time_s"], abs=0.5 * TICK_S + 1e-6
        )
        state = rig.state()
        assert state["gripper_holds"] is None
        assert state["grippers_hold"] == {"left": None}
    finally:
        rig.stop()


@pytest.mark.slow
def test_the_first_ball_meets_a_target_that_moves(rig: Rig) -> None:
    try:
        rig.start()
        request = {"cell": "rig", **two_throws(starts_not_before_s=0.0)}
        moves = {"position": (np.array(TARGETS[""]) - BELT_M_S).tolist(), "velocity": BELT_M_S.tolist()}
        request["passages"][0]["state"] |= {**moves, "observed_at_s": 0.0}
        found = plan(problem_from_request(request, rig.cell))
        document = plan_document(found, request, new_id(), "2026-01-01T00:00:00Z")
        document = begun_later(document, rig.state()["t"] + READY_S - document["starts_at_s"])
        rig.add_plan(document)
        row = rig.end(rig.queue_plan(document["id"]))
        assert row.outcome == "completed", row.reason
        landed = {each.get("gripper", ""): each for each in rig.world()["landings"] if each["bounce"] == 0}
        asked = document["request"]["passages"][0]["state"]
        there = np.array(asked["position"]) + (landed[""]["t"] - asked["observed_at_s"]) * BELT_M_S
        for name, target in {"": there, "left": TARGETS["left"]}.items():
            assert np.linalg.norm(np.array(landed[name]["position_m"]) - target) < LANDED_M
    finally:
        rig.stop()


@pytest.mark.slow
def test_each_gripper_has_a_delay_of_its_own_which_only_the_simulator_knows(rig: Rig) -> None:
    try:
        truth = rig.folder / "truth.toml"
        own, left = HIDDEN_DELAYS_S.values()
        truth.write_text(f"[gripper]\ndelay_s = {own}\n[grippers.left]\ndelay_s = {left}\njitter_s = 0.0\n")
        rig.start_simulator("--truth", str(truth), "--reveal")
        rig.start_executor()
        row = rig.quiet_run(stored(rig, two_throws()))
        assert row.outcome == "completed", row.reason
        changes = rig.state()["output_changes"]
        for name, (kind, index) in {"": ("tool_digital", 0), "left": ("standard_digital", 1)}.items():
            bit = 1 << OUTPUT_SHIFT[kind] + index
            opened = [t for (_, before), (t, bits) in pairwise([(0.0, 0), *changes]) if bits & bit and not before & bit]
            (left,) = [each["t"] for each in rig.world()["releases"] if each.get("gripper", "") == name][-1:]
            assert left - max(t for t in opened if t <= left) == pytest.approx(HIDDEN_DELAYS_S[name], abs=1e-6)
    finally:
        rig.stop()


@pytest.mark.slow
def test_a_stop_between_two_releases_keeps_the_second_object(rig: Rig) -> None:
    try:
        rig.start()
        id = rig.queue_plan(stored(rig, two_throws()))
        rig.until(lambda: len(rig.world()["releases"]) == 1, period=0.001)
        rig.store.request_abort(id)
        row = rig.end(id)
        assert row.outcome == "aborted", row.reason
        assert "the object of 'second' is held" in row.reason
        assert len(rig.world()["releases"]) == 1
        state = rig.state()
        assert state["grippers_hold"] == {"left": 2}
        assert not state["digital_outputs"] >> OUTPUT_SHIFT["standard_digital"] + 1 & 1
    finally:
        rig.stop()


@pytest.mark.slow
def test_a_run_without_one_of_its_objects_is_refused(rig: Rig) -> None:
    try:
        rig.start()
        plan_id = stored(rig, two_throws())
        with socket.create_connection((rig.host, 30002)) as pendant:
            pendant.sendall(b"sec open():\n  set_standard_digital_out(1, True)\nend\n")
            rig.until(lambda: rig.state()["grippers_hold"]["left"] is None)
        row = rig.end(Rig.queue_plan(rig, plan_id))
        assert (row.outcome, row.reason) == (
            "refused",
            "the gripper 'left' is open: standard_digital 1 is on; load and close it",
        )
    finally:
        rig.stop()
