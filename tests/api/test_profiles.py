from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.api.conftest import NO_ID, FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of

CELL = "ur5e-sim"
TARGET = {"kind": "target", "position": [1.2, 0.3, 0.0]}


@pytest.fixture
def profile(service: RunningService) -> Iterator[dict[str, Any]]:
    """A profile of a cell that nothing is known of; the cell file's numbers are used again afterwards."""
    response = service.client.post(f"/cells/{CELL}/profiles")
    assert response.status_code == 201, response.text
    assert response.headers["location"] == f"/profiles/{response.json()['id']}"
    yield response.json()
    service.store.close_open_executions(CELL)
    service.client.post(f"/cells/{CELL}/profiles/revert")


def test_a_profile_is_stored_but_not_adopted(service: RunningService, profile: dict[str, Any]):
    assert profile["adopted"] is False
    assert profile["delay_s"] == pytest.approx(0.040)
    assert profile["delay_std_s"] == pytest.approx(0.020)
    listed = service.client.get(f"/cells/{CELL}/profiles").json()
    assert listed["adopted"] is None
    assert listed["profiles"][0]["id"] == profile["id"]
    assert "mixture" not in listed["profiles"][0]
    assert service.client.get(f"/profiles/{profile['id']}").json() == profile
    problem_of(service.client.get("/profiles/nothing"), 404, "not-found")
    problem_of(service.client.post("/profiles/nothing/adopt"), 404, "not-found")


def test_the_newest_profile_of_a_real_arm_is_read_as_latest_but_adopted_by_its_id(service: RunningService):
    profile = service.client.post("/cells/real/profiles").json()
    assert service.client.get("/profiles/latest").json()["id"] == profile["id"]
    problem = problem_of(service.client.post("/profiles/latest/adopt"), 403, "forbidden")
    assert problem["detail"] == "on a real arm a profile is adopted by its own id, not by 'latest'"


def test_the_landings_behind_a_profile_are_drawn(service: RunningService, profile: dict[str, Any]):
    assert (profile["landings"], profile["landing_error_before_m"]) == ([], None)
    drawn = service.client.get(f"/profiles/{profile['id']}/picture.svg")
    assert (drawn.status_code, drawn.headers["content-type"]) == (200, "image/svg+xml")
    assert "0 throws" in drawn.text
    problem_of(service.client.get("/profiles/nothing/picture.svg"), 404, "not-found")


def test_plans_name_the_profile_and_old_ones_are_not_executable(
    service: RunningService, executor: FakeExecutor, profile: dict[str, Any]
):
    old = service.plan()
    assert old["profile"] is None
    adopted = service.client.post(f"/profiles/{profile['id']}/adopt").json()
    assert adopted == {"cell": CELL, "profile": profile["id"], "adopted_by": "local"}
    assert service.client.get(f"/cells/{CELL}/profiles").json()["adopted"] == profile["id"]
    problem = problem_of(service.client.post("/execute", json={"plan_id": old["id"]}), 409, "plan-not-executable")
    assert profile["id"] in problem["detail"]
    new = service.plan()
    assert new["profile"] == profile["id"]
    assert service.client.post("/execute", json={"plan_id": new["id"]}).status_code == 202
    problem_of(service.client.post(f"/profiles/{profile['id']}/adopt"), 409, "robot-busy")
    service.store.close_open_executions(CELL)
    assert service.client.post(f"/cells/{CELL}/profiles/revert").json()["profile"] is None
    problem_of(service.client.post("/execute", json={"plan_id": new["id"]}), 409, "plan-not-executable")
    actions = [line["action"] for line in service.store.audit_lines(10)]
    assert {"adopt", "revert"} <= set(actions)


def test_a_profile_is_not_used_with_another_version_of_the_cell_file(service: RunningService, cells: Path):
    """A gripper that was exchanged has another delay: what was learnt of the old one says nothing of it."""
    profile = service.client.post("/cells/changing/profiles").json()
    service.client.post(f"/profiles/{profile['id']}/adopt")
    assert service.plan(cell="changing")["profile"] == profile["id"]
    assert service.client.get("/cells/changing/profiles").json()["warning"] is None
    file = cells / "changing.toml"
    before = file.read_text()
    try:
        file.write_text(before.replace("delay_s = 0.040", "delay_s = 0.090"))
        plan = service.plan(cell="changing")
        assert plan["profile"] is None
        lead = plan["release_time_s"] - plan["release"]["command_time_s"]
        assert lead == pytest.approx(0.020 + 0.090)
        listed = service.client.get("/cells/changing/profiles").json()
        assert (listed["adopted"], listed["profiles"][0]["adopted"]) == (None, False)
        assert profile["id"] in listed["warning"]
    finally:
        file.write_text(before)
        service.client.post("/cells/changing/profiles/revert")


def test_a_target_has_odds_and_other_releases_have_none(service: RunningService):
    plan = service.plan(release=TARGET, backend="auto")
    odds = plan["hit_probability"]
    ellipse = plan["landing_ellipse"]
    assert 0.0 <= odds["interval"][0] <= odds["value"] <= odds["interval"][1] <= 1.0
    assert (odds["profile"], plan["aim"]) == (None, None)
    assert ellipse["center"] == pytest.approx(TARGET["position"][:2], abs=0.15)  # nothing is measured yet
    assert ellipse["covariance_m2"][0][1] == pytest.approx(ellipse["covariance_m2"][1][0])
    soonest = service.plan(release=TARGET, backend="auto", release_window_s=0.0)
    assert soonest["hit_probability"]["value"] < odds["value"]
    assert service.plan()["hit_probability"] is None


def test_a_preview_tells_the_odds_of_a_profile_that_is_not_adopted(service: RunningService, profile: dict[str, Any]):
    request = {"release": TARGET, "backend": "ruckig", "release_window_s": 0.0}

    def preview(profile_id: str) -> Any:
        return service.client.post(f"/plan?store=false&trajectory=false&profile={profile_id}", json=request)

    as_if = preview(profile["id"])
    assert as_if.status_code == 200, as_if.text
    assert (as_if.json()["profile"], as_if.json()["hit_probability"]["profile"]) == (profile["id"],) * 2
    assert service.client.get(f"/cells/{CELL}/profiles").json()["adopted"] is None
    problem_of(preview(NO_ID), 404, "not-found")
    problem_of(preview(service.client.post("/cells/real/profiles").json()["id"]), 404, "not-found")
    stored = problem_of(service.client.post(f"/plan?profile={profile['id']}", json=request), 422, "invalid-request")
    assert stored["errors"][0]["field"] == "profile"


def test_the_moves_of_a_calibration_can_be_planned(service: RunningService):
    moves = service.client.get(f"/cells/{CELL}/calibration?throws=2").json()
    assert (len(moves["motions"]), len(moves["throws"]), moves["outputs"]) == (4, 10, [])
    request = {**moves["motions"][0][0], "backend": "ruckig"}
    plan = service.client.post("/plan?trajectory=false", json=request)
    assert plan.status_code == 201, plan.text
    assert plan.json()["flight"] is None  # nothing leaves the gripper
    problem_of(service.client.get("/cells/nowhere/calibration"), 404, "not-found")
    problem_of(service.client.get(f"/cells/{CELL}/calibration?throws=1"), 422, "invalid-request")
