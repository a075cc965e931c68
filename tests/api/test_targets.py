"""Tracked targets over HTTP: observed, read, named by plans; with an executor simulated by the test."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import orjson
import pytest

from api.routes.following import FollowedThrow
from planner.answer import plan_from_document
from planner.cell import load_cell
from planner.certificate import certify
from planner.tracking import TargetObservation, TargetTrack
from store import new_id
from tests.api.conftest import NO_ID, FakeExecutor, RunningService, running
from tests.api.test_bad_input import problem_of

PATH = "/cells/ur5e-sim/targets"
BIN = {"radius_m": 0.12, "rim_height_m": 0.2}
NOW_S = 700.0
STEP_S = 1.0 / 30.0
STD_M = 0.003
PLACE = np.array([1.1, -0.9, 0.0])
VELOCITY = np.array([0.0, 0.3, 0.0])


def seen(k: int, **changes: Any) -> dict[str, Any]:
    """Returns the k-th observation of a bin on a belt, with noise."""
    noise = STD_M * np.random.default_rng(k).standard_normal(3)
    place = PLACE + k * STEP_S * VELOCITY + noise
    return {"position": place.tolist(), "std_m": STD_M, "observed_at_s": NOW_S + k * STEP_S, **changes}


def observe(service: RunningService, count: int) -> dict[str, Any]:
    """Tracks a bin; returns what is known of it after so many observations."""
    answer = service.client.post(PATH, json=seen(0))
    assert answer.status_code == 201, answer.text
    for k in range(1, count):
        answer = service.client.post(f"{PATH}/{answer.json()['id']}/observations", json=seen(k))
        assert answer.status_code == 201, answer.text
    return answer.json()


@pytest.fixture
def clock(executor: FakeExecutor) -> FakeExecutor:
    """Has the executor report the controller's time of the last observation."""
    executor.robot = {**executor.robot, "timestamp_s": NOW_S + 1.0}
    executor.beat()
    return executor


@pytest.fixture
def no_targets(service: RunningService) -> Iterator[None]:
    yield
    for row in service.store.targets_of_cell("ur5e-sim"):
        service.store.delete_target("ur5e-sim", row.id)


def test_observations_are_filtered_and_read(service: RunningService, no_targets: None):
    known = observe(service, 20)
    track = TargetTrack.begun(TargetObservation(tuple(seen(0)["position"]), STD_M, NOW_S))
    for k in range(1, 20):
        track = track.observed(TargetObservation(tuple(seen(k)["position"]), STD_M, seen(k)["observed_at_s"]))
    assert known["observations"] == 20
    assert known["position"] == list(track.position)
    assert known["uncertainty"] == vars(track.uncertainty)
    np.testing.assert_allclose(known["velocity"], VELOCITY, atol=4.0 * known["uncertainty"]["velocity_std_m_s"])
    assert service.client.get(f"{PATH}/{known['id']}").json() == known
    assert service.client.get(f"{PATH}/latest").json() == known
    assert service.client.get(PATH).json()["targets"][0] == known


def test_an_encoder_tells_the_velocity_at_once(service: RunningService, no_targets: None):
    body = seen(0, velocity=[0.0, 0.3, 0.0], velocity_std_m_s=0.003, drift_m_s=0.0)
    known = service.client.post(PATH, json=body).json()
    assert known["velocity"] == pytest.approx([0.0, 0.3, 0.0], abs=1e-6)
    assert known["uncertainty"]["velocity_std_m_s"] == pytest.approx(0.003, rel=1e-6)
    assert known["uncertainty"]["drift_m_s"] == 0.0


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"std_m": 0.0}, "std_m"),
        ({"position": [1.1, 0.0]}, "position"),
        ({"position": [1100.0, 0.0, 0.0]}, "position[0]"),
        ({"observed_at_s": -1.0}, "observed_at_s"),
        ({"observed_at_s": NOW_S + 10.0}, "observed_at_s"),
        ({"velocity": [0.0, 0.3, 0.0]}, "body"),
        ({"velocity": [0.0, 0.3, 0.1], "velocity_std_m_s": 0.01}, "velocity[2]"),
        ({"velocity": [0.0, 9.0, 0.0], "velocity_std_m_s": 0.01}, "velocity"),
        ({"stdm": 0.1}, "stdm"),
    ],
)
def test_wrong_observations_are_refused_by_their_field(
    service: RunningService, clock: FakeExecutor, no_targets: None, changes: dict[str, Any], field: str
):
    for path in (PATH, f"{PATH}/{observe(service, 1)['id']}/observations"):
        answer = problem_of(service.client.post(path, json=seen(1, **changes)), 422, "invalid-request")
        assert answer["errors"][0]["field"] == field, answer
    assert service.client.get(f"{PATH}/latest").json()["observations"] == 1


def test_what_does_not_fit_the_track_is_refused_and_changes_nothing(service: RunningService, no_targets: None):
    known = observe(service, 10)
    path = f"{PATH}/{known['id']}/observations"
    wrong = {
        "observed_at_s": seen(9),
        "position": seen(10, position=[1.3, -0.8, 0.0]),
        "velocity": seen(10, velocity=[0.0, -0.3, 0.0], velocity_std_m_s=0.01),
    }
    for field, body in wrong.items():
        answer = problem_of(service.client.post(path, json=body), 422, "invalid-request")
        assert [each["field"] for each in answer["errors"]] == [field], answer
    assert service.client.get(f"{PATH}/{known['id']}").json() == known


def test_of_many_at_once_each_is_taken_once_or_refused(service: RunningService, no_targets: None):
    known = observe(service, 1)
    path = f"{PATH}/{known['id']}/observations"
    bodies = [seen(k) for k in (*range(1, 16), *range(1, 16))]
    with ThreadPoolExecutor(6) as pool:
        taken = [answer.status_code for answer in pool.map(lambda body: service.client.post(path, json=body), bodies)]
    assert set(taken) <= {201, 422}
    assert service.client.get(f"{PATH}/{known['id']}").json()["observations"] == 1 + taken.count(201)


def test_a_target_is_forgotten_and_what_is_not_there_is_not_found(service: RunningService, no_targets: None):
    known = observe(service, 1)
    assert service.client.delete(f"{PATH}/{known['id']}").json() == known
    for call in (service.client.get, service.client.delete):
        problem_of(call(f"{PATH}/{known['id']}"), 404, "not-found")
        problem_of(call(f"/cells/nowhere/targets/{NO_ID}"), 404, "not-found")
    problem_of(service.client.post(f"{PATH}/{known['id']}/observations", json=seen(1)), 404, "not-found")
    problem_of(service.client.get("/cells/nowhere/targets"), 404, "not-found")


def test_a_key_stands_for_the_first_target(service: RunningService, no_targets: None):
    headers = {"Idempotency-Key": new_id()}
    first = service.client.post(PATH, json=seen(0), headers=headers)
    assert service.client.post(PATH, json=seen(0), headers=headers).json() == first.json()
    assert first.headers["Location"] == f"{PATH}/{first.json()['id']}"
    ids = [each["id"] for each in service.client.get(PATH).json()["targets"]]
    assert ids.count(first.json()["id"]) == 1


def test_a_plan_to_a_tracked_target_holds_its_numbers(service: RunningService, clock: FakeExecutor, no_targets: None):
    known = observe(service, 31)
    release = {"kind": "target", "position": {"target": known["id"]}, "opening": BIN}
    made = service.client.post("/plan", json={"release": release})
    assert made.status_code == 201, made.text
    document = made.json()
    asked = document["request"]["release"]
    assert asked["tracked_target"] == known["id"]
    for name in ("velocity", "observed_at_s", "uncertainty"):
        assert asked[name] == known[name]
    assert asked["position"] == [*known["position"][:2], max(known["position"][2], 0.0)]
    lands_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"]
    since_s = lands_s - known["observed_at_s"]
    there = np.array(asked["position"]) + since_s * np.array(known["velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)
    service.client.delete(f"{PATH}/{known['id']}")  # the plan stands for itself
    problem, motion = plan_from_document(document, load_cell(service.settings.cells / "ur5e-sim.toml"))
    assert certify(problem, motion).valid
    certain = {name: value for name, value in asked.items() if name not in ("uncertainty", "tracked_target")}
    start = document["request"]["starts_not_before_s"]
    other = service.client.post("/plan", json={"release": certain, "starts_not_before_s": start}).json()
    assert other["trajectory"]["positions"] == document["trajectory"]["positions"]
    std_m = TargetTrack.from_document(_track_of(known)).after(since_s).uncertainty.position_std_m
    own = np.array(other["landing_ellipse"]["covariance_m2"])
    spread = np.array(document["landing_ellipse"]["covariance_m2"]) - own
    error = 4.0 * np.sqrt(own.max() / 2000.0) * 2.0 * std_m  # of 2,000 samples: four deviations
    np.testing.assert_allclose(spread, std_m**2 * np.eye(2), atol=error)
    assert document["hit_probability"]["value"] < other["hit_probability"]["value"]


CAMERA = {"name": "camera", "state": {"kind": "point", "position": [0.5, 0.3, 0.5], "velocity": [0.0, -0.4, 0.0]}}


def test_a_passage_throws_at_a_tracked_target(service: RunningService, clock: FakeExecutor, no_targets: None):
    known = observe(service, 31)
    state = {"kind": "target", "position": {"target": known["id"]}, "opening": BIN}
    body = {"passages": [CAMERA, {"name": "throw", "state": state, "releases": True}]}
    made = service.client.post("/plan", json=body)
    assert made.status_code == 201, made.text
    document = made.json()
    camera, throw = document["passages"]
    assert camera["time_s"] < throw["time_s"] == document["release_time_s"]
    assert document["request"]["passages"][0]["state"] == CAMERA["state"]
    asked = document["request"]["passages"][1]["state"]
    assert asked["tracked_target"] == known["id"]
    assert asked["observed_at_s"] == known["observed_at_s"]
    lands_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"]
    there = np.array(asked["position"]) + (lands_s - known["observed_at_s"]) * np.array(known["velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)
    assert 0.0 < document["hit_probability"]["value"] <= 1.0


def test_passages_that_cannot_have_a_tracked_target_are_refused_by_field(
    service: RunningService, clock: FakeExecutor, no_targets: None
):
    position = {"target": observe(service, 31)["id"]}
    throw = {"name": "throw", "state": {"kind": "target", "position": position}, "releases": True}
    unknown = {**throw, "state": {"kind": "target", "position": {"target": NO_ID}}}
    field = "passages[1].state.position"
    for path, body, refused in (
        ("/plan", {"passages": [CAMERA, unknown]}, f"{field}.target"),
        ("/plan", {"passages": [CAMERA, {**throw, "releases": False}]}, "passages[1].releases"),
        ("/batches", {"requests": [{"passages": [CAMERA, throw]}]}, f"requests[0].{field}"),
        ("/cells/ur5e-sim/retarget", {"passages": [CAMERA, throw]}, f"{field}.target"),
    ):
        answer = problem_of(service.client.post(path, json=body), 422, "invalid-request")
        assert [each["field"] for each in answer["errors"]] == [refused], answer


def _track_of(answer: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in answer.items() if name not in ("id", "cell", "created_at", "created_by")}


def test_in_the_base_frame_it_is_where_it_is(service: RunningService, clock: FakeExecutor, no_targets: None):
    known = observe(service, 31)
    release = {"kind": "target", "position": {"target": known["id"]}, "opening": BIN}
    body = {"release": release, "frame": "base", "starts_not_before_s": NOW_S + 3.0}
    answer = service.client.post("/plan?store=false", json=body)
    assert answer.status_code == 200, answer.text
    problem, _ = plan_from_document(answer.json(), load_cell(service.settings.cells / "ur5e-sim.toml"))
    assert problem.moving is not None
    since_s = problem.moving.at_s - known["observed_at_s"]
    there = np.array(known["position"]) + since_s * np.array(known["velocity"])
    np.testing.assert_allclose(problem.moving.p_W[:2], there[:2], atol=1e-9)


@pytest.mark.parametrize(("height_m", "stands_m"), [(-0.005, 0.0), (0.005, 0.005)])
def test_what_seems_to_be_within_the_floor_stands_on_it(
    service: RunningService, clock: FakeExecutor, no_targets: None, height_m: float, stands_m: float
):
    exact = {"velocity": [0.0, 0.3, 0.0], "velocity_std_m_s": 0.001}
    body = seen(0, position=[1.1, -0.9, height_m], std_m=0.002, **exact)
    known = service.client.post(PATH, json=body).json()
    release = {"kind": "target", "position": {"target": known["id"]}, "opening": BIN}
    plan = service.client.post("/plan", json={"release": release})
    assert plan.json()["request"]["release"]["position"][2] == stands_m, plan.text
    given = {**release, "position": {"target": known["id"], "height_m": 0.1}}
    plan = service.client.post("/plan", json={"release": given})
    assert plan.json()["request"]["release"]["position"][2] == 0.1, plan.text


def test_what_is_seen_once_or_long_ago_is_refused_with_numbers(
    service: RunningService, clock: FakeExecutor, no_targets: None
):
    for count, later_s in ((1, 1.0), (31, 60.0)):
        release = {"kind": "target", "position": {"target": observe(service, count)["id"]}, "opening": BIN}
        body = {"release": release, "starts_not_before_s": NOW_S + later_s}
        answer = problem_of(service.client.post("/plan", json=body), 422, "invalid-request")
        assert answer["errors"][0]["field"] == "release.position"
        assert "3 standard deviations" in answer["errors"][0]["reason"]


def test_a_target_that_the_cell_does_not_track_is_refused(service: RunningService, clock: FakeExecutor):
    release = {"kind": "target", "position": {"target": NO_ID}}
    for path in ("/plan", "/plan?store=false"):
        answer = problem_of(service.client.post(path, json={"release": release}), 422, "invalid-request")
        assert answer["errors"][0]["field"] == "release.position.target"
    answer = problem_of(
        service.client.post("/batches", json={"requests": [{"release": release}]}), 422, "invalid-request"
    )
    assert "release.position" in answer["errors"][0]["field"]
    answer = problem_of(
        service.client.post("/cells/ur5e-sim/retarget", json={"release": release}), 422, "invalid-request"
    )
    assert answer["errors"][0]["field"] == "release.position.target"


def test_it_is_there_after_a_restart(service: RunningService, no_targets: None):
    known = observe(service, 5)
    with running(service.settings) as again:
        assert again.client.get(f"{PATH}/{known['id']}").json() == known
        answer = again.client.post(f"{PATH}/{known['id']}/observations", json=seen(5))
        assert answer.json()["observations"] == 6


def test_making_and_forgetting_is_audited(service: RunningService, no_targets: None):
    begun_at = time.time()
    known = observe(service, 3)
    service.client.delete(f"{PATH}/{known['id']}")
    lines = [line for line in service.store.audit_lines() if line["at"] >= begun_at]
    acts = [(line["action"], line["resource"]) for line in lines if known["id"] in line["resource"]]
    assert acts == [("forget-target", f"{PATH}/{known['id']}"), ("target", f"{PATH}/{known['id']}")]
    assert orjson.dumps(known)


def test_a_throw_is_planned_again_only_before_its_first_row_is_sent():
    """Outputs before the start are sent by then: a plan that comes later finds nothing that waits."""
    row: Any = SimpleNamespace(state="approaching")
    seen: dict[str, Any] = {"height_m": 0.0, "miss_m": 0.0, "room_m": 0.1, "hit_probability": 1.0, "motion": None}
    throw = FollowedThrow(row=row, summary={"starts_at_s": 100.0}, now_s=98.0, lead_in_s=1.5, **seen)
    assert throw.waits
    assert throw.left_s == pytest.approx(0.5)
    assert throw.can_be_replanned(0.4)
    assert not throw.can_be_replanned(0.6)
