"""Throws at targets that move: met where the audit finds them, and judged against a bin where it is at each instant."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from audit.judge import find_faults, flight_faults
from learning.throws import STEP_S, Circumstances, Throws, throw_table
from planner.answer import Plan, aimed_problem, plan_document, plan_from_document
from planner.certificate import certify, window_landing_points
from planner.errors import Infeasible, InvalidProblem
from planner.planning import SPARE_S, SearchHints, plan
from planner.problem import SWEPT_S, ThrowProblem
from planner.progress import Progress, ProgressMeter
from planner.releases import Target, release_document
from planner.request import problem_from_request, request_document
from tests.planner.problems import cell

SEEN_S = 1000.0
BIN = {"radius_m": 0.1, "rim_height_m": 0.15}
WIDE = {"radius_m": 0.12, "rim_height_m": 0.15}
ACROSS = {"kind": "target", "position": [1.1, -0.5, 0.0], "velocity": [0.0, 0.4, 0.0], "observed_at_s": SEEN_S}
ASLANT = {**ACROSS, "position": [0.9, 0.5, 0.0], "velocity": [0.2, -0.3, 0.0]}
MOUTH = "bin_mouth"  # the audit's word for a flight beside it
MUCH_M = 0.004  # [m] by which the audit's steps and the certificate's bounds may differ


def request(release: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"release": release, "starts_not_before_s": SEEN_S + 0.5, **more}


@pytest.fixture(scope="module", params=[ACROSS, {**ACROSS, "opening": BIN}, {**ASLANT, "opening": BIN}])
def asked(request: pytest.FixtureRequest) -> dict[str, Any]:
    return {"release": request.param, "starts_not_before_s": SEEN_S + 0.5}


@pytest.fixture(scope="module")
def found(asked: dict[str, Any]) -> Plan:
    return plan(problem_from_request(asked, cell()))


def moving(problem: ThrowProblem) -> Target:
    assert problem.moving is not None
    return problem.moving


def check(problem: ThrowProblem, found: Plan, name: str) -> Any:
    return next(each for each in certify(problem, found.trajectory).checks if each.name == name)


def test_the_object_meets_the_target_and_the_audit_finds_no_fault(found: Plan, asked: dict[str, Any]) -> None:
    assert found.certificate.valid
    assert find_faults(found.problem, found.trajectory) == []
    document = plan_document(found, asked, "", "")
    assert document["starts_at_s"] >= asked["starts_not_before_s"]
    lands_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"]
    seen = asked["release"]
    there = np.array(seen["position"]) + (lands_s - SEEN_S) * np.array(seen["velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)


def test_the_throw_found_for_the_first_landing_is_moved_to_that_of_the_earliest_start(
    found: Plan, asked: dict[str, Any]
) -> None:
    first, *_, last = (each.result for each in found.attempts)
    assert first.startswith("TargetRelease")
    assert last == "moved throw: certified"
    assert found.problem.starts_at_s == pytest.approx(asked["starts_not_before_s"] + SPARE_S, abs=0.05)


@pytest.mark.parametrize(
    "release",
    [
        {**ACROSS, "position": [1.8207, -1.1622, 0.0], "velocity": [-0.2474, 0.4657, 0.0]},
        {**ACROSS, "position": [1.979, 0.7888, 0.0], "velocity": [-0.5558, -0.4363, 0.0], "opening": WIDE},
    ],
)
def test_far_from_the_first_landing_the_throw_is_searched_for_anew(release: dict[str, Any]) -> None:
    """What is a slow throw at a guessed landing stays one when it is moved, where others are twice as soon."""
    found = plan(problem_from_request({"release": release, "starts_not_before_s": SEEN_S}, cell()))
    assert found.trajectory.release_time_s < 0.25
    assert not any("moved throw" in each.result for each in found.attempts)


def test_of_a_throw_nearby_the_first_landing_is_that_of_the_earliest_start(found: Plan, asked: dict[str, Any]) -> None:
    """A throw that was planned for another aim, or waits, tells how long one takes."""
    beside = aimed_problem(problem_from_request(asked, cell()), np.array([0.03, -0.02, 0.0]))
    steps: list[Progress] = []
    again = plan(beside, SearchHints(nearby=found.trajectory, meter=ProgressMeter(steps.append)))
    assert [each.result for each in again.attempts] == ["moved throw: certified"]
    assert steps[-1].candidates == 1
    assert again.certificate.valid
    assert abs(again.trajectory.release_time_s - found.trajectory.release_time_s) < 0.03


def test_a_plan_is_certified_again_from_its_document(found: Plan, asked: dict[str, Any]) -> None:
    document = plan_document(found, asked, "", "")
    problem, motion = plan_from_document(document, cell())
    again = certify(problem, motion)
    assert again.valid
    assert {each.name for each in again.checks} == {each.name for each in found.certificate.checks}
    later = {**document, "starts_at_s": document["starts_at_s"] + 0.01}
    moved, _ = plan_from_document(later, cell())
    way = moving(moved).p_W - moving(problem).p_W
    np.testing.assert_allclose(way, 0.01 * moving(problem).v_W, atol=1e-9)
    assert not certify(moved, motion).valid
    with pytest.raises(InvalidProblem, match="starts_at_s"):
        plan_from_document({name: value for name, value in document.items() if name != "starts_at_s"}, cell())


def test_a_start_that_is_off_misses_by_the_way_of_the_target(found: Plan) -> None:
    assert found.problem.starts_at_s is not None
    late = replace(found.problem, starts_at_s=found.problem.starts_at_s + 0.02)
    missed = check(late, found, "landing")
    assert not missed.ok
    assert missed.value == pytest.approx(0.02 * np.linalg.norm(moving(found.problem).v_W), rel=1e-3)


def test_the_window_is_judged_beside_the_moving_target(found: Plan) -> None:
    within = check(found.problem, found, "landing_window")
    standing = replace(found.problem, starts_at_s=None)
    target = replace(moving(found.problem), v_W=np.zeros(3))
    standing = standing.with_release(standing.release.with_target(target))
    assert within.value != pytest.approx(check(standing, found, "landing_window").value, rel=1e-3)
    assert flight_faults(found.problem, found.trajectory) == []


@pytest.fixture(scope="module")
def on_time() -> Plan:
    """A throw into a bin that moves, by a gripper that opens exactly on time: one flight to judge."""
    own = cell()
    own = replace(own, gripper=replace(own.gripper, jitter_s=0.0))
    return plan(problem_from_request(request({**ACROSS, "opening": BIN}, release_window_s=0.0), own))


def coming(found: Plan, velocity: list[float]) -> ThrowProblem:
    """Returns the problem of a plan with the bin met as before, but on its way there at another velocity."""
    target = replace(moving(found.problem), v_W=np.array(velocity))
    return found.problem.with_release(found.problem.release.with_target(target))


@pytest.mark.parametrize("speed", [-4.0, -2.0, -1.0, 0.4, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("direction", [[1.0, 0.0], [0.0, 1.0]])
def test_certificate_and_audit_agree_on_walls_that_move(on_time: Plan, speed: float, direction: list[float]) -> None:
    problem = coming(on_time, [*(speed * x for x in direction), 0.0])
    judged = check(problem, on_time, "flight_clearance")
    faults = [each for each in flight_faults(problem, on_time.trajectory) if each.rule in ("flight_clearance", MOUTH)]
    if judged.ok:
        assert faults == []
    elif judged.value < judged.limit - MUCH_M:
        assert faults
        assert judged.detail == "rim"


def test_there_are_walls_that_are_met_and_walls_that_are_not(on_time: Plan) -> None:
    outcomes = {check(coming(on_time, [0.0, v, 0.0]), on_time, "flight_clearance").ok for v in (-4.0, 0.4, 4.0)}
    assert outcomes == {True, False}


def test_the_arm_keeps_out_of_the_path_of_the_bin() -> None:
    problem = problem_from_request(request({**ASLANT, "opening": BIN}), cell()).met_at(SEEN_S + 2.0)
    target = moving(problem)
    path = problem.cell_with_bin.surroundings.keep_out[-1]
    around = np.linspace(0.0, 2.0 * np.pi, 24)
    ring = BIN["radius_m"] * np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=1)
    for t in np.linspace(-SWEPT_S[0], SWEPT_S[1], 7):
        for height in (0.001, BIN["rim_height_m"] - 0.001):
            places = target.p_W + t * target.v_W + 0.99 * ring + [0.0, 0.0, height]
            assert (path.depth(places) > 0.0).all()


def test_forecasts_are_beside_the_moving_target(found: Plan) -> None:
    delays = STEP_S * np.array([-4.0, 0.0, 4.0])
    table = throw_table(found.problem, found.trajectory, beside_target=True)
    none = np.zeros(3)
    landed = Throws([table]).landings(
        Circumstances(delays[:, None], np.ones((3, 1)), np.zeros((3, 1, 2)), none[:, None], none[:, None])
    )
    exact = window_landing_points(found.problem, found.trajectory, delays)[:, :2]
    np.testing.assert_allclose(landed[:, 0], exact, atol=2e-4)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"starts_not_before_s": None}, "starts_not_before_s"),
        ({"release": {**ACROSS, "velocity": [0.0, 0.0, 0.0]}}, "starts_not_before_s"),
        ({"release": {**ACROSS, "velocity": [0.0, 0.1, 0.1]}}, "release.velocity"),
        ({"release": {**ACROSS, "velocity": [0.0, 9.0, 0.0]}}, "release.velocity"),
        ({"release": {name: value for name, value in ACROSS.items() if name != "observed_at_s"}}, "observed_at_s"),
        ({"start": {"positions": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0], "velocities": [0.1] * 6}}, "start"),
    ],
)
def test_what_does_not_go_together_is_refused_by_its_field(changes: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidProblem, match=field):
        problem_from_request({**request(ACROSS), **changes}, cell())


@pytest.mark.slow
def test_a_motion_of_passages_throws_at_a_target_that_moves() -> None:
    passages = [
        {"name": "throw", "state": {**ACROSS, "opening": BIN}, "releases": True},
        {"name": "camera", "state": {"kind": "point", "position": [0.5, 0.2, 0.5], "velocity": [0.0, -0.5, 0.0]}},
    ]
    asked = {"passages": passages, "end": {"kind": "home"}, "starts_not_before_s": SEEN_S + 0.5}
    chained = plan(problem_from_request(asked, cell()))
    assert chained.certificate.valid
    assert find_faults(chained.problem, chained.trajectory) == []
    document = plan_document(chained, asked, "", "")
    assert document["starts_at_s"] >= SEEN_S + 0.5
    lands_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"]
    there = np.array(ACROSS["position"]) + (lands_s - SEEN_S) * np.array(ACROSS["velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)
    problem, motion = plan_from_document(document, cell())
    assert certify(problem, motion).valid
    later, _ = plan_from_document({**document, "starts_at_s": document["starts_at_s"] + 0.01}, cell())
    assert not certify(later, motion).valid


def test_passages_before_and_after_the_throw_keep_their_times_from_the_start() -> None:
    """The bin is out of reach while the camera has not been passed, and the arm goes on for seconds after it."""
    sideways = {"kind": "point", "position": [0.5, 0.3, 0.5], "velocity": [0.0, -0.4, 0.0]}
    coming = {**ACROSS, "position": [1.1, -1.5, 0.0], "opening": BIN}
    passages = [
        {"name": "camera", "state": sideways, "at_s": 2.0},
        {"name": "throw", "state": coming, "releases": True},
        {"name": "again", "state": sideways, "not_before_s": 6.0},
    ]
    asked = {"passages": passages, "starts_not_before_s": SEEN_S + 0.5}
    chained = plan(problem_from_request(asked, cell()))
    assert find_faults(chained.problem, chained.trajectory) == []
    document = plan_document(chained, asked, "", "")
    camera, throw, again = document["passages"]
    assert camera["time_s"] == pytest.approx(2.0)
    assert again["time_s"] >= 6.0
    lands_s = document["starts_at_s"] + throw["time_s"] + document["flight"]["time_of_flight_s"]
    assert again["time_s"] - (lands_s - document["starts_at_s"]) > SWEPT_S[1]
    there = np.array(coming["position"]) + (lands_s - SEEN_S) * np.array(coming["velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)


@pytest.mark.parametrize(
    ("number", "times", "field", "words"),
    [
        (1, {"at_s": 10.0}, "passages[1].at_s", "must be below 10, as the target moves: .* it is 10$"),
        (1, {"not_before_s": 12.5}, "passages[1].not_before_s", "must be below 10, .* it is 12.5$"),
        (0, {"at_s": 11.0}, "passages[0].at_s", "must be below 10, .* it is 11$"),
        (2, {"at_s": 20.0}, "passages[2].at_s", "must be below 20, .* at rest within 10 s of that; it is 20$"),
        (2, {"at_s": 19.9}, None, ""),
        (1, {"at_s": 9.9}, None, ""),
    ],
)
def test_a_passage_later_than_the_motion_may_go_on_is_refused_at_once(
    number: int, times: dict[str, float], field: str | None, words: str
) -> None:
    camera = {"kind": "point", "position": [0.5, 0.2, 0.5], "velocity": [0.0, -0.5, 0.0]}
    states: list[dict[str, Any]] = [{"state": camera}, {"state": ACROSS, "releases": True}, {"state": camera}]
    passages = [{"name": f"{i}", **each} for i, each in enumerate(states)]
    passages[number] |= times
    asked = {"passages": passages, "starts_not_before_s": SEEN_S + 0.5}
    if field is None:
        assert problem_from_request(asked, cell()).moving is not None
        return
    with pytest.raises(InvalidProblem) as refused:
        problem_from_request(asked, cell())
    assert [each.field for each in refused.value.errors] == [field]
    assert re.search(words, refused.value.errors[0].reason)
    standing = {name: value for name, value in ACROSS.items() if name not in ("velocity", "observed_at_s")}
    passages[1]["state"] = standing
    problem_from_request({"passages": passages}, cell())


@pytest.mark.parametrize(("before_s", "after_s"), [(SWEPT_S[0], 0.0), (0.0, 2.0 * SWEPT_S[1])])
def test_a_motion_outlasts_no_way_that_the_arm_keeps_clear(found: Plan, before_s: float, after_s: float) -> None:
    """Held at rest before the launch, or at its end, the same throw is refused by how much too long it takes."""
    motion = found.trajectory
    counts = [round(s * motion.sample_rate_hz) for s in (before_s, after_s)]
    q, qd, qdd = (np.pad(x, (counts, (0, 0)), mode="edge") for x in (motion.q, motion.qd, motion.qdd))
    release_index = motion.release_index + counts[0]
    held = replace(motion, q=q, qd=qd, qdd=qdd, release_index=release_index)
    assert found.problem.starts_at_s is not None
    earlier = replace(found.problem, starts_at_s=found.problem.starts_at_s - counts[0] * motion.dt)
    refused = next(each for each in certify(earlier, held).checks if each.name == "landing")
    flight = plan_document(found, {}, "", "")["flight"]["time_of_flight_s"]
    lands_s = held.release_time_s + flight
    limit_s, takes_s = (SWEPT_S[0], lands_s) if before_s else (SWEPT_S[1], held.duration_s - lands_s)
    assert (refused.ok, refused.unit, refused.limit) == (False, "s", limit_s)
    assert refused.value == pytest.approx(takes_s, abs=1e-6)


def test_a_request_is_written_as_it_was_read() -> None:
    problem = problem_from_request(request(ACROSS), cell())
    again = problem_from_request(request_document(problem, problem.release), cell())
    assert release_document(again.release) == release_document(problem.release)
    assert again.starts_not_before_s == problem.starts_not_before_s


def test_window_and_rim_keep_room_for_a_start_on_the_nearest_tick(found: Plan) -> None:
    """Half a cycle late, the target is on: audited as it is then, the throw still has no fault."""
    late = replace(found.problem, starts_at_s=found.problem.starts_at_s + 0.5 * found.problem.dt)
    faults = [each for each in find_faults(late, found.trajectory) if each.name not in ("landing", "landing_point")]
    assert faults == []


def test_a_refusal_is_proven_of_no_landing_but_those_that_were_tried() -> None:
    """A target that comes from afar is out of reach at all of them, and in reach later."""
    afar = {**ACROSS, "position": [1.1, -12.0, 0.0]}
    with pytest.raises(Infeasible) as refused:
        plan(problem_from_request({"release": afar, "starts_not_before_s": SEEN_S + 0.5}, cell()))
    assert not any(each.proven for each in refused.value.violations)
    assert "s after the earliest start" in str(refused.value)


KNOWN = {"position_std_m": 0.003, "velocity_std_m_s": 0.01, "correlation": 0.7, "drift_m_s": 0.005}
UNCERTAIN = {**ACROSS, "opening": BIN, "uncertainty": KNOWN}


def test_an_uncertain_target_is_met_as_a_certain_one(found: Plan, asked: dict[str, Any]) -> None:
    uncertain = {**asked["release"], "uncertainty": {**KNOWN, "velocity_std_m_s": 0.0, "drift_m_s": 0.0}}
    other = plan(problem_from_request({**asked, "release": uncertain}, cell()))
    np.testing.assert_array_equal(other.trajectory.q, found.trajectory.q)
    assert other.problem.starts_at_s == found.problem.starts_at_s


def test_what_is_known_at_the_landing_is_what_is_known_at_the_observation_and_the_time_since() -> None:
    found = plan(problem_from_request(request(UNCERTAIN), cell()))
    document = plan_document(found, request(UNCERTAIN), "", "")
    after_s = document["starts_at_s"] + document["release_time_s"] + document["flight"]["time_of_flight_s"] - SEEN_S
    rng = np.random.default_rng(0)
    both = KNOWN["correlation"] * KNOWN["position_std_m"] * KNOWN["velocity_std_m_s"]
    P = [[KNOWN["position_std_m"] ** 2, both], [both, KNOWN["velocity_std_m_s"] ** 2]]
    p, v = rng.multivariate_normal([0.0, 0.0], P, 20_000).T
    wanders = KNOWN["drift_m_s"] * np.sqrt(after_s**3 / 3.0) * rng.standard_normal(len(p))
    known = moving(found.problem).uncertainty
    assert known is not None
    assert known.position_std_m == pytest.approx((p + after_s * v + wanders).std(), rel=0.02)
    again, _ = plan_from_document(document, cell())
    read = moving(again).uncertainty
    assert read is not None
    np.testing.assert_allclose(read.covariance, known.covariance, rtol=1e-9)


def test_a_target_that_may_be_elsewhere_is_refused_by_its_field_with_numbers() -> None:
    """Three standard deviations at the earliest start, or at the landing, are more than the bin's room."""
    room = BIN["radius_m"] - cell().object.radius_m
    unseen = {**UNCERTAIN, "uncertainty": {"position_std_m": 0.003, "velocity_std_m_s": 5.0}}
    with pytest.raises(InvalidProblem, match=r"release.position: the target may be 7\.5 m off at 1000\.5 s"):
        problem_from_request(request(unseen), cell())
    at_start = {"position_std_m": 0.0, "velocity_std_m_s": room / 3.0 / 0.55, "drift_m_s": 0.0}
    problem = problem_from_request(request({**UNCERTAIN, "uncertainty": at_start}), cell())
    with pytest.raises(InvalidProblem, match="the room of a hit") as refused:
        plan(problem)
    assert f"the room of a hit is {room:.3g} m" in str(refused.value)


def test_a_target_that_may_move_waits_like_one_that_does() -> None:
    standing = {
        **ACROSS,
        "position": [1.1, 0.0, 0.0],
        "velocity": [0.0, 0.0, 0.0],
        "opening": BIN,
        "uncertainty": KNOWN,
    }
    found = plan(problem_from_request(request(standing), cell()))
    assert found.problem.starts_at_s is not None
    assert found.certificate.valid


def test_a_request_with_its_uncertainty_is_written_as_it_was_read() -> None:
    problem = problem_from_request(request({**UNCERTAIN, "tracked_target": "some"}), cell())
    document = request_document(problem, problem.release)
    assert document["release"]["uncertainty"] == KNOWN
    assert document["release"]["tracked_target"] == "some"
    assert release_document(problem_from_request(document, cell()).release) == document["release"]


@pytest.mark.parametrize(
    ("release", "field"),
    [
        ({"kind": "target", "position": {"target": "some"}}, "release.position"),
        ({"kind": "target", "position": {"target": "some"}, "velocity": [0.0, 0.1, 0.0]}, "release.velocity"),
        ({"kind": "target", "position": {"other": "some"}}, "release.position.target"),
        ({"kind": "target", "position": {"target": 7}}, "release.position.target"),
        ({"kind": "target", "position": [1.1, 0.0, 0.0], "uncertainty": KNOWN}, "release.uncertainty"),
        ({**ACROSS, "uncertainty": {**KNOWN, "correlation": 1.1}}, "release.uncertainty.correlation"),
        ({**ACROSS, "uncertainty": {"position_std_m": 0.1}}, "release.uncertainty.velocity_std_m_s"),
    ],
)
def test_what_names_or_doubts_a_target_wrongly_is_refused_by_its_field(release: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidProblem, match=field):
        problem_from_request({"release": release, "starts_not_before_s": SEEN_S}, cell())


def test_a_tracked_target_of_a_passage_is_known_to_a_service_alone() -> None:
    passages = [{"name": "throw", "state": {"kind": "target", "position": {"target": "some"}}, "releases": True}]
    with pytest.raises(InvalidProblem, match=r"passages\[0\].state.position"):
        problem_from_request({"passages": passages}, cell())
