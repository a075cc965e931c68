"""Throws at a target that moves, on a simulated cell whose belt carries the bin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planner.answer import plan_document
from planner.planning import plan
from planner.problem import SWEPT_S
from planner.request import problem_from_request, states_of, with_states
from store import ExecutionRow, new_id
from tests.system.rig import Rig

BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
BELT_M_S = [0.0, 0.4, 0.0]
PASSES_M = np.array([1.1, -0.2, 0.0])  # a second after the earliest start
READY_S = 8.0  # [s] from now to the start: a busy machine takes some to verify the plan and to start the stream
LANDING_M = 0.006  # [m] of a throw that missed no tick: 2 mm of it are the belt's in a tick or two


def planned(rig: Rig, starts_in_s: float) -> dict[str, Any]:
    """Stores a throw into a bin that passes, and starts `starts_in_s` [s] from now.

    It is planned by another clock, and moved to the controller's then: a busy machine takes seconds to plan.
    """
    seen_m = (PASSES_M - np.array(BELT_M_S)).tolist()
    release = {"kind": "target", "position": seen_m, "velocity": BELT_M_S, "observed_at_s": 0.0, "opening": BIN}
    request = {"cell": "rig", "release": release, "starts_not_before_s": 0.0}
    found = plan(problem_from_request(request, rig.cell))
    document = plan_document(found, request, new_id(), "2026-01-01T00:00:00Z")
    document = begun_later(document, rig.state()["t"] + starts_in_s - document["starts_at_s"])
    rig.add_plan(document)
    return document


def begun_later(document: dict[str, Any], later_s: float) -> dict[str, Any]:
    """Returns a plan as if all of its request had been so much later."""
    asked = document["request"]
    states = {path: dict(state) for path, state in states_of(asked).items()}
    for state in states.values():
        if "observed_at_s" in state:
            state["observed_at_s"] += later_s
    moved = {**with_states(asked, states), "starts_not_before_s": asked["starts_not_before_s"] + later_s}
    return {**document, "request": moved, "starts_at_s": document["starts_at_s"] + later_s}


def thrown(rig: Rig, starts_in_s: float) -> tuple[dict[str, Any], ExecutionRow]:
    rig.throw_when_ready()  # to near home
    document = planned(rig, starts_in_s)
    return document, rig.end(rig.queue_plan(document["id"]))


@pytest.mark.slow
def test_the_object_lands_in_a_bin_that_passes(rig: Rig) -> None:
    document, row = thrown(rig, READY_S)
    assert row.outcome == "completed", row.reason
    assert row.metrics is not None
    assert row.metrics["landed_on"] == "bin"
    assert row.metrics["landing_error_m"] < LANDING_M
    landing = rig.world()["landings"][-1]
    seen = document["request"]["release"]
    there = np.array(seen["position"]) + (landing["t"] - seen["observed_at_s"]) * np.array(BELT_M_S)
    assert np.linalg.norm(np.array(landing["position_m"]) - there) < LANDING_M
    lands_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"]
    assert landing["t"] == pytest.approx(lands_s, abs=0.004)


@pytest.mark.parametrize(("starts_in_s", "reason"), [(0.1, "too late"), (SWEPT_S[0] + 5.0, "too early")])
def test_what_cannot_start_on_its_tick_is_refused_and_nothing_moves(rig: Rig, starts_in_s: float, reason: str) -> None:
    before = rig.newest_object()
    _, row = thrown(rig, starts_in_s)
    assert row.outcome == "refused"
    assert reason in (row.reason or "")
    assert rig.newest_object() == before
    assert rig.speed() == pytest.approx(0.0, abs=1e-3)
    assert not rig.is_latched()
