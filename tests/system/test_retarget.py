"""A running throw gets another target in one call over HTTP, on a simulated cell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from planner.answer import plan_from_document
from tests.system.rig import LOB, Rig
from tests.system.service import RigService
from tests.system.test_replacement import follows, streaming, swing

LANDING_M = 0.01  # [m] of the default landing tolerance
OTHER = {"kind": "target", "position": [1.1, -0.3, 0.0]}
AT_S = 0.6  # [s] into the motion at which it is retargeted


def waiting_throw(rig: Rig) -> dict[str, Any]:
    """Returns a request for a throw that swings from side to side for some seconds before."""
    before = swing(rig, "+-+")["passages"]
    times = [{**each, "not_before_s": 0.8 * number} for number, each in enumerate(before, 1)]
    throw = {"name": "throw", "state": LOB, "releases": True}
    return {"cell": "rig", "passages": [*times, throw], "release_window_s": 0.0}


@pytest.fixture(scope="module")
def service(shared_rig: Rig) -> Iterator[RigService]:
    with RigService(shared_rig) as running:
        shared_rig.until(lambda: running.http.get("/readyz").status_code == 200, 120.0)
        yield running


def planned(service: RigService, request: dict[str, Any]) -> dict[str, Any]:
    response = service.http.post("/plan", json=request)
    assert response.status_code == 201, response.text
    return response.json()


@pytest.mark.slow
def test_a_running_throw_lands_at_its_new_target(rig: Rig, service: RigService) -> None:
    first = planned(service, waiting_throw(rig))
    id = streaming(rig, first["id"], AT_S)
    response = service.http.post("/cells/rig/retarget", json={"release": OTHER})
    assert response.status_code == 202, response.text
    second = response.json()
    assert response.headers["Location"] == f"/plans/{second['id']}"
    assert second["request"]["start"]["execution"] == id
    row = rig.end(id)
    (answer,) = [each for each in row.replacements or () if each["joins_s"] is not None]
    assert answer["plan_id"] == second["id"]
    assert answer["joins_s"] > AT_S
    motions = [plan_from_document(each, rig.cell)[1] for each in (first, second)]
    follows(rig, row, [(0.0, motions[0]), (answer["joins_s"], motions[1])])
    assert row.metrics is not None
    assert np.linalg.norm(np.subtract(row.metrics["landing_point"], OTHER["position"])) < LANDING_M


@pytest.mark.slow
def test_a_refused_target_leaves_the_running_throw_untouched(rig: Rig, service: RigService) -> None:
    first = planned(service, waiting_throw(rig))
    id = streaming(rig, first["id"], AT_S)
    far = service.http.post("/cells/rig/retarget", json={"release": {**OTHER, "position": [9.0, 0.0, 0.0]}})
    assert (far.status_code, far.json()["type"]) == (422, "/problems/infeasible")
    row = rig.end(id)
    assert not row.replacements
    follows(rig, row, [(0.0, plan_from_document(first, rig.cell)[1])])
    assert row.metrics is not None
    assert row.metrics["landing_point"] == pytest.approx(LOB["position"], abs=LANDING_M)
    over = service.http.post("/cells/rig/retarget", json={"release": OTHER})
    assert (over.status_code, over.json()["type"]) == (409, "/problems/cannot-join")
    assert "no motion to join" in over.json()["detail"]
