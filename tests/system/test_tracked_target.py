"""Throws at a target that is tracked: planned again while the arm waits, stopped where it would miss."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from executor.streaming.state_checks import OUTPUT_SHIFT
from tests.system.rig import Rig
from tests.system.service import RigService

BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
ROOM_M = 0.1  # of the object in it
PASSES_M = np.array([1.1, -0.2])  # a second after the earliest start
SPEED_M_S = 0.3
READY_S = 16.0  # [s] from the first observation to the earliest start: a busy machine takes some to plan
WAITS_S = 8.5  # [s] before the start, at which the plan is executed: an arm waits for 9 at most
LANDING_M = 0.008
FLASH_S = 0.03
FLASH = [{"output": "standard_digital", "index": 5, "level": i == 0, "offset_s": FLASH_S * i} for i in range(2)]
CAMERA = {
    "name": "camera",
    "state": {"kind": "point", "position": [0.5, 0.3, 0.5], "velocity": [0.0, -0.4, 0.0]},
    "outputs": FLASH,
}
TARGETS = "/cells/rig/targets"


@pytest.fixture(scope="module")
def service(shared_rig: Rig) -> Iterator[RigService]:
    with RigService(shared_rig) as running:
        shared_rig.until(lambda: running.http.get("/readyz").status_code == 200, within_s=120.0)
        yield running


def place_at(after_s: float, speed_m_s: float) -> np.ndarray:
    """Returns where a bin is after a time on a belt of a speed (2,) [m]."""
    return PASSES_M + np.array([0.0, after_s * speed_m_s - (READY_S + 1.0) * SPEED_M_S])


def seen(rig: Rig, begun_s: float, speed_m_s: float, velocity_std_m_s: float) -> dict[str, Any]:
    """Returns what camera and encoder tell now of a bin that was at its first place at an instant [s]."""
    now_s = rig.state()["t"]
    velocity = {"velocity": [0.0, speed_m_s, 0.0], "velocity_std_m_s": velocity_std_m_s}
    place = [*place_at(now_s - begun_s, speed_m_s).tolist(), 0.0]
    return {"position": place, "std_m": 0.002, "observed_at_s": now_s, **velocity}


def waiting_throw(
    rig: Rig, service: RigService, before: tuple[dict[str, Any], ...] = ()
) -> tuple[float, dict[str, Any], dict[str, Any], str]:
    """Tracks a bin, and queues a throw into it that waits; returns when it was first seen, bin, plan and execution.

    Args:
        rig: the cell.
        service: its service.
        before: passages before the throw.
    """
    rig.throw_when_ready()  # to near home
    begun_s = rig.state()["t"]
    first = {**seen(rig, begun_s, SPEED_M_S, 0.001), "drift_m_s": 0.0003}
    target = service.http.post(TARGETS, json=first).json()
    release = {"kind": "target", "position": {"target": target["id"]}, "opening": BIN}
    passages = [*before, {"name": "throw", "state": release, "releases": True}]
    asked = {"passages": passages} if before else {"release": release}
    made = service.http.post("/plan", json={"cell": "rig", **asked, "starts_not_before_s": begun_s + READY_S})
    assert made.status_code == 201, made.text
    later_s = made.json()["release_time_s"] if before else 0.0  # wait and motion take no more than the arm waits
    rig.until(lambda: rig.state()["t"] > made.json()["starts_at_s"] - WAITS_S + later_s)
    id = service.execute(made.json()["id"])
    rig.until(lambda: rig.row(id).state in ("approaching", "finished"))
    assert rig.row(id).state == "approaching", rig.row(id)
    return begun_s, target, made.json(), id


@pytest.mark.slow
@pytest.mark.parametrize("before", [(), (CAMERA,)])
def test_a_waiting_throw_is_planned_again_to_where_the_bin_passes(
    rig: Rig, service: RigService, before: tuple[dict[str, Any], ...]
) -> None:
    begun_s, target, first, id = waiting_throw(rig, service, before)
    real_m_s = SPEED_M_S + 0.0025  # the first velocity was two and a half deviations off: 4 cm until the landing
    path = f"{TARGETS}/{target['id']}/observations"

    def observed() -> bool:
        answer = service.http.post(path, json=seen(rig, begun_s, real_m_s, 0.0005))
        assert answer.status_code == 201, answer.text
        return bool(rig.row(id).joined) or rig.row(id).state != "approaching"

    rig.until(observed, period=0.1)
    row = rig.end(id)
    assert row.outcome == "completed", row.reason
    assert row.joined, row.replacements
    second = service.http.get(f"/plans/{row.joined[-1]['plan_id']}").json()
    assert second["starts_at_s"] != first["starts_at_s"]
    asked = second["request"]["passages"][-1]["state"] if before else second["request"]["release"]
    assert asked["tracked_target"] == target["id"]
    if before:
        flashed(rig, second)
    landing = rig.world()["landings"][-1]
    there = place_at(landing["t"] - begun_s, real_m_s)
    assert np.linalg.norm(np.array(landing["position_m"][:2]) - there) < LANDING_M
    told = [event.data for event in rig.store.events(id, limit=10_000) if event.kind == "target"]
    assert told[0]["miss_m"] > 0.2 * ROOM_M
    assert not any(each["stopped"] for each in told)


def flashed(rig: Rig, plan: dict[str, Any]) -> None:
    """Asserts that the camera's output changed as a plan has it, on the controller's clock and within two ticks.

    One is that of the start, one that of the edge.
    """
    planned_s = [plan["starts_at_s"] + edge["edge_time_s"] for edge in plan["passages"][0]["outputs"]]
    bit = 1 << OUTPUT_SHIFT["standard_digital"] + 5
    changes = rig.state()["output_changes"]
    switched = [t for (_, was), (t, now) in pairwise(changes) if (was ^ now) & bit]
    np.testing.assert_allclose(switched[-2:], planned_s, atol=2.0 / plan["sample_rate_hz"])


def test_nothing_is_thrown_at_a_bin_that_is_gone(rig: Rig, service: RigService) -> None:
    """Somebody pushed it by 25 cm just before the start: no filter explains that, and the throw is stopped."""
    begun_s, target, plan, id = waiting_throw(rig, service)
    rig.until(lambda: rig.state()["t"] > plan["starts_at_s"] - 0.45)
    now_s = rig.state()["t"]
    place = [*(place_at(now_s - begun_s, SPEED_M_S) + np.array([0.0, 0.25])).tolist(), 0.0]
    body = {"position": place, "std_m": 0.003, "observed_at_s": now_s}
    answer = service.http.post(f"{TARGETS}/{target['id']}/observations", json=body)
    assert answer.status_code == 422
    row = rig.end(id)
    (told,) = [event.data for event in rig.store.events(id, limit=10_000) if event.kind == "target"]
    assert told["stopped"], told
    assert row.outcome == "aborted", row
    assert not (row.metrics or {}).get("released")
    assert not rig.is_latched()


@pytest.mark.slow
def test_a_plan_for_another_place_does_not_replace_a_waiting_one(rig: Rig, service: RigService) -> None:
    _, _, plan, id = waiting_throw(rig, service)
    start = [0.3, -1.57, 1.57, -1.57, -1.57, 0.0]
    request = {**plan["request"], "start": {"positions": start}}
    elsewhere = service.http.post("/plan", json=request).json()
    answer = service.http.post(f"/executions/{id}/replace", json={"plan_id": elsewhere["id"]})
    assert answer.status_code == 409
    assert "from where the arm waits" in answer.json()["detail"]
    at_once = service.http.post(
        "/plan", json={"cell": "rig", "release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
    )
    answer = service.http.post(f"/executions/{id}/replace", json={"plan_id": at_once.json()["id"]})
    assert answer.status_code == 409
    assert "waits at its start" in answer.json()["detail"]
    row = rig.end(id)
    assert row.outcome == "completed", row.reason
    assert row.metrics is not None and row.metrics["landed_on"] == "bin"
