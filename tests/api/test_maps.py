"""Maps over HTTP: made by a runner, read in every format, void where the cell changes; bad input is refused."""

from __future__ import annotations

import time

import pytest

from tests.api.conftest import RunningService

ONE = {"extent_m": [1.0, 1.5, 0.0, 0.5], "resolution_m": 0.5}  # a map of one landing cell
MADE_S = 180.0  # [s] a runner loads its planner first, on a busy machine


def read(service: RunningService, cell: str = "ur5e-sim", accept: str = "application/json", **query):
    return service.client.get(f"/cells/{cell}/map", params=query, headers={"Accept": accept})


@pytest.fixture(scope="module")
def made(shared: RunningService):
    """A finished map of one landing cell: its answer to GET."""
    begun = shared.client.post("/cells/ur5e-sim/map", json=ONE)
    assert begun.status_code == 202, begun.text
    assert begun.json()["state"] == "running" and begun.json()["progress"] == {"done": 0, "total": 1}
    deadline = time.monotonic() + MADE_S
    while (found := shared.client.get(begun.headers["Location"]).json())["state"] == "running":
        assert time.monotonic() < deadline
        time.sleep(0.1)
    return found


@pytest.mark.slow
def test_a_map_is_made_by_its_runner_and_its_plan_throws_there(shared, made):
    assert (made["state"], made["void_because"], made["level_m"]) == ("finished", None, 0.5)
    assert (made["origin"], made["shape"], made["plane_z_m"]) == ([1.25, 0.25], [1, 1], 0.0)
    values = made["values"]
    assert values["state"] == [[1]] and 0.0 < values["release_time_s"][0][0] < 1.0
    plan = shared.client.get(f"/plans/{made['plans'][0][0]}").json()
    assert plan["request"]["release"]["position"] == [1.25, 0.25, 0.0]
    assert plan["certificate"]["valid"] and plan["release_time_s"] == values["release_time_s"][0][0]
    shift = plan["flight"]["landing_shift_10ms_m"]
    assert values["landing_shift_10ms_m"][0][0] == max(shift["early"], shift["late"])
    assert values["hit_probability"][0][0] == plan["hit_probability"]["value"]


def test_the_same_request_is_the_same_map(shared, made):
    again = shared.client.post("/cells/ur5e-sim/map", json=ONE)
    assert (again.status_code, again.json()["id"], again.json()["state"]) == (202, made["id"], "finished")
    assert "values" not in again.json()


@pytest.mark.parametrize(
    ("media", "begins"), [("image/png", b"\x89PNG"), ("application/zip", b"PK"), ("text/html", b"<!doctype html>")]
)
def test_a_map_is_answered_in_the_media_type_that_is_asked_for(shared, made, media, begins):
    pytest.importorskip("zarr" if media == "application/zip" else "PIL", reason="make setup")
    answer = read(shared, accept=media)
    assert answer.headers["Content-Type"].partition(";")[0] == media and answer.content.startswith(begins)
    assert read(shared, accept="text/csv").status_code == 406


def test_a_client_that_has_the_map_is_not_sent_it_again(shared, made):
    tag = read(shared).headers["ETag"]
    assert shared.client.get("/cells/ur5e-sim/map", headers={"If-None-Match": tag}).status_code == 304


def test_a_map_is_chosen_by_id_or_kind(shared, made):
    assert read(shared, id=made["id"]).json()["id"] == made["id"]
    assert read(shared, robust=False, resolution_m=0.5, plane_z_m=3.0).json()["id"] == made["id"]
    for query in (
        {"robust": True, "resolution_m": 0.5},
        {"resolution_m": 0.07},
        {"id": "00000000-0000-7000-8000-000000000000"},
    ):
        assert read(shared, **query).status_code == 404


def test_a_map_is_void_when_the_cell_file_changes_and_holds_again_when_it_is_back(service, cells):
    file = cells / "changing.toml"
    before = file.read_text()
    begun = service.client.post("/cells/changing/map", json=ONE).json()
    cancelled = service.client.post("/cells/changing/map/cancel")
    assert (cancelled.status_code, cancelled.json()["id"]) == (202, begun["id"])
    try:
        file.write_text(before + "\n# a word\n")
        void = read(service, "changing").json()
        assert (void["state"], void["id"]) == ("void", begun["id"]) and "has changed" in void["void_because"]
    finally:
        file.write_text(before)
    assert read(service, "changing").json()["void_because"] is None


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"resolution_m": 0.0001}, "resolution_m"),
        ({"resolution_m": "wide"}, "resolution_m"),
        ({"extent_m": [1, 0, 0, 1]}, "extent_m"),
        ({"extent_m": [0, 1]}, "extent_m"),
        ({"plane_z_m": 9.0}, "plane_z_m"),
        ({"plane_z_m": 0.0, "volume_m": [0.0, 1.0]}, "volume_m"),
        ({"volume_m": [1.0, 0.0]}, "volume_m"),
        ({"sharp": True}, "sharp"),
    ],
)
def test_what_makes_no_map_is_refused_by_field(service, body, field):
    answer = service.client.post("/cells/ur5e-sim/map", json=body)
    assert answer.status_code == 422 and answer.json()["type"].endswith("invalid-request")
    assert {error["field"].partition(".")[0] for error in answer.json()["errors"]} == {field}


def test_a_cell_without_a_map_or_without_a_file_is_not_found(service):
    assert "POST /cells/real/map makes one" in read(service, "real").json()["detail"]
    assert read(service, "nothing").status_code == 404
    assert service.client.post("/cells/nothing/map", json=ONE).status_code == 404
