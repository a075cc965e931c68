"""Executions on a simulated cell with a truth of its own: what is known of them afterwards."""

from __future__ import annotations

import math
import re

import pytest

from learning import cell_with_profile, estimate_profile, profile_bytes
from planner.answer import plan_document
from planner.planning import plan
from planner.request import problem_from_request
from store import new_id
from tests.system.rig import LOB, Rig

TRUTH = """
seed = 3
[timing]
gain = 1.01
[gripper]
delay_s = 0.048
[arm]
disturbance = "ur5-measured"
[camera]
std_m = 0.003
"""
OBSERVED_M = 0.02  # [m] six standard deviations of the camera


@pytest.mark.slow
def test_a_hidden_truth_leaves_the_cameras_observation_alone(own_rig: Rig) -> None:
    truth = own_rig.folder / "truth.toml"
    truth.write_text(TRUTH)
    own_rig.start_simulator("--truth", str(truth))
    own_rig.start_executor()
    row = own_rig.quiet_throw(LOB)
    assert row.outcome == "completed", row.reason
    assert "warning: at the release a joint's speed was" in row.reason
    for name in ("gripper_opened_s", "gripper_opened_late_s", "landing_point", "landing_error_m"):
        assert row.metrics[name] is None
    assert row.metrics["landed_on"] == "floor"
    assert set(own_rig.world()) == {"ok", "t", "hidden", "observations"}
    (landing,) = own_rig.store.landings(row.id)
    assert (landing.source, landing.std_m, landing.position[2]) == ("sim-camera", 0.003, 0.0)
    assert 0.02 < math.dist(landing.position, LOB["position"]) < 0.5


@pytest.mark.slow
def test_revealed_the_truth_is_known_beside_the_observation(own_rig: Rig) -> None:
    truth = own_rig.folder / "truth.toml"
    truth.write_text(TRUTH)
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    own_rig.start_executor()
    row = own_rig.quiet_throw(LOB)
    assert row.outcome == "completed", row.reason
    assert 0.005 < row.metrics["gripper_opened_late_s"] < 0.011  # 8 ms, and a lag that differs from run to run
    (landing,) = own_rig.store.landings(row.id)
    assert 0.0 < math.dist(landing.position, row.metrics["landing_point"]) < OBSERVED_M


@pytest.mark.slow
def test_an_object_that_leaves_slower_lands_on_target_once_the_profile_knows(own_rig: Rig) -> None:
    """The plan's own flight has the object's speed: its end is where the object lands, without a shift of the aim."""
    truth = own_rig.folder / "truth.toml"
    truth.write_text("[release]\nspeed_factor = 0.95\n[gripper]\njitter_s = 0.0\n")
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    learnt = estimate_profile(own_rig.store, own_rig.cell) | {"speed_factor": 0.95}
    profile = own_rig.store.add_profile("rig", own_rig.cell.sha256, "test", profile_bytes(learnt))
    own_rig.store.adopt_profile("rig", profile.id, "test")
    own_rig.start_executor()
    request = {"cell": "rig", "release": LOB, "backend": "ruckig", "release_window_s": 0.0}
    found = plan(problem_from_request(request, cell_with_profile(own_rig.cell, learnt)))
    document = plan_document(found, request, new_id(), "2026-01-01T00:00:00Z") | {"profile": profile.id}
    own_rig.add_plan(document)
    row = own_rig.quiet_run(document["id"])
    assert row.outcome == "completed", row.reason
    assert row.metrics["landing_error_m"] < 0.006  # 2 ms of the simulated arm
    assert math.dist(row.metrics["landing_point"], LOB["position"]) < 0.006
    assert math.dist(document["flight"]["object_path"][-1], LOB["position"]) < 0.001


@pytest.mark.slow
def test_an_object_that_would_miss_is_kept(own_rig: Rig) -> None:
    """R17: the arm flies on to the release and brakes, and neither is a fault latched nor an object lost."""
    truth = own_rig.folder / "truth.toml"
    truth.write_text("[timing]\ngain = 1.03\n")
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    own_rig.start_executor()
    robust = own_rig.plan(LOB, backend="casadi", release_window_s=0.005, landing_tolerance_m=0.02)
    row = own_rig.quiet_run(robust)
    assert row.outcome == "held", row.reason
    assert re.search(r"kept: it would have landed \d+ mm \(± \d+\) off, beyond its tolerance of 20 mm", row.reason)
    assert (row.metrics["released"], row.metrics["landing_point"]) == (False, None)
    assert row.metrics["timing"]["gain"][1] == pytest.approx(1.03, abs=0.01)
    assert own_rig.world()["releases"] == []
    assert own_rig.world()["gripper_holds"] is not None
    assert max(map(abs, own_rig.state()["qd"])) < 0.01
    assert not own_rig.is_latched()
    soonest = own_rig.quiet_throw(LOB)  # asks for no tolerance: it is let go
    assert soonest.outcome == "completed", soonest.reason
    assert math.dist(soonest.metrics["landing_point"], LOB["position"]) > 0.04
