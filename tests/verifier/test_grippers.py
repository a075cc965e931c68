"""Certified motions in which two grippers let go are proven, and what is wrong with either object is not."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from itertools import pairwise, product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from audit.judge import arm_model
from learning import cell_with_profile
from planner.answer import plan_document
from planner.cell import Box, Cell, shape_of
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.request import problem_from_request
from tests.planner.two_grippers import LEFT, cell_of_two, two_throws
from verifier import Finding, NotAPlan, Status, Verification, verify

QUICK = SearchHints(offers_nearest=False)
G = 9.81
SPREADS_S = (0.005, 0.006)  # the default window; of the second half a tick more
TICKS_S = 0.006  # both, outwards to whole ticks: so long either load counts
NOT_FAR = 1e-3  # [-] of a limit, or [m]


@cache
def made() -> tuple[dict[str, Any], Cell]:
    here = cell_of_two()
    document = plan_document(plan(problem_from_request(two_throws(), here), QUICK), two_throws(), "", "")
    return document, here


def judged(document: dict[str, Any], cell: Cell) -> Verification:
    """Returns what is found of a plan's document in another cell than its own."""
    return verify({**document, "cell_sha256": cell.sha256}, cell)


def of_check(verdict: Verification, name: str) -> list[Finding]:
    return [each for each in verdict.findings if each.name == name]


def statuses(verdict: Verification, name: str) -> set[Status]:
    return {each.status for each in of_check(verdict, name)}


def changed() -> dict[str, Any]:
    """Returns a copy of the plan's document that may be changed, all but its samples."""
    document, _ = made()
    copied = copy.deepcopy({key: value for key, value in document.items() if key != "trajectory"})
    return {**copied, "trajectory": document["trajectory"]}


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray, list[int], float]:
    """Returns samples, the two releases and the time of a tick [s]."""
    document, _ = made()
    rows = (np.array(document["trajectory"][key]) for key in ("positions", "velocities", "accelerations"))
    return *rows, [each["index"] for each in document["passages"]], 1.0 / document["sample_rate_hz"]  # type: ignore[return-value]


def test_every_check_of_the_certificate_is_proven() -> None:
    document, here = made()
    verdict = verify(document, here)
    assert verdict.status is Status.PROVEN, verdict.reasons
    certified = {check["name"] for check in document["certificate"]["checks"]}
    assert {"releases_apart", "flights_apart"} <= certified <= {each.name for each in verdict.findings}
    for name in ("landing", "landing_window", "flight_clearance", "opening_direction"):
        assert {each.detail.split(":")[0] for each in of_check(verdict, name)} == {"first", "second"}


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, "left"])
def test_one_gripper_alone_is_proven_beside_what_the_other_holds(first: bool | str) -> None:
    here = cell_of_two()
    over = {"kind": "joint", "positions": here.home.tolist(), "velocities": [0.1] * 6}
    throw = {"name": "throw", "state": {"kind": "target", "position": [1.1, -0.2, 0.0]}, "releases": first}
    request = {"passages": [{"name": "camera", "state": over}, throw], "end": {"kind": "home"}}
    document = plan_document(plan(problem_from_request(request, here), QUICK), request, "", "")
    verdict = verify(document, here)
    assert verdict.status is Status.PROVEN, verdict.reasons
    weak = here.grippers["left" if first is True else ""]
    weak = replace(weak, gripper=replace(weak.gripper, hold_acceleration_m_s2=np.array([15.0])))
    own = {} if first is True else {"gripper": weak.gripper}
    loose = replace(here, grippers={**here.grippers, "left" if first is True else "": weak}, content="", **own)
    assert Status.VIOLATED in statuses(verify(document, loose), "grip_acceleration")


@pytest.mark.slow
def test_a_profile_teaches_the_own_gripper_alone() -> None:
    here = cell_of_two()
    profile = {
        **{"id": "p1", "cell_sha256": here.sha256, "outputs": {}},
        **{"lag_s": 0.03, "delay_s": 0.05, "jitter_s": 0.001, "speed_factor": 0.97, "drag_coefficient": 0.3},
    }
    learnt = cell_with_profile(here, profile)
    document = plan_document(plan(problem_from_request(two_throws(), learnt), QUICK), two_throws(), "", "")
    verdict = verify({**document, "profile": "p1"}, here, profile)
    assert verdict.status is Status.PROVEN, verdict.reasons
    faster = verify({**document, "profile": "p1"}, here, {**profile, "speed_factor": 0.98})
    missed = {each.detail.split(":")[0] for each in faster.open if each.name == "landing"}
    assert missed == {"first"}


def peaks_with_what_is_held() -> np.ndarray:
    """Returns the largest torques (6,) [N m] by Pinocchio, with both objects, one and none on the flange."""
    _, here = made()
    q, qd, qdd, released, dt = motion()
    jerk = np.diff(qdd, axis=0) / dt
    ends = [0.0, *(index * dt for index in released), (len(q) - 1) * dt]
    model = arm_model(here.seen_from("", ["left"]), False)
    found = np.zeros(6)
    for number, (begin, end) in enumerate(pairwise(ends)):
        loaded = model.copy()
        for name in list(here.grippers)[number:]:
            each = here.grippers[name]
            ball = pin.Inertia(each.object.mass_kg, each.X_FT[:3, 3], np.zeros((3, 3)))
            loaded.appendBodyToJoint(6, ball, pin.SE3.Identity())
        data = loaded.createData()
        early_s, late_s = (np.array([number > 0, number < 2]) * TICKS_S).tolist()
        for t in np.linspace(begin - early_s, end + late_s, 1500):
            k = min(int(t / dt), len(jerk) - 1)
            s = t - k * dt
            state = (
                q[k] + s * (qd[k] + s * (qdd[k] / 2 + s * jerk[k] / 6)),
                qd[k] + s * (qdd[k] + s * jerk[k] / 2),
                qdd[k] + s * jerk[k],
            )
            found = np.maximum(found, np.abs(pin.rnea(loaded, data, *state)))
    return found


@pytest.mark.slow
def test_the_torques_are_those_of_what_is_held_at_each_instant() -> None:
    document, here = made()
    peaks = peaks_with_what_is_held()

    def within(limits: np.ndarray) -> set[Status]:
        return statuses(
            verify(document, replace(here, limits=replace(here.limits, tau_max=limits), content="")), "joint_torque"
        )

    assert within(peaks * (1.0 + NOT_FAR)) == {Status.PROVEN}
    for joint in range(6):
        tight = np.array(here.limits.tau_max)
        tight[joint] = peaks[joint] * (1.0 - NOT_FAR)
        assert within(tight) == {Status.VIOLATED}


def flown(here: Cell, name: str, index: int, late_s: float, t: np.ndarray) -> np.ndarray:
    """Returns the flight (n, 3) [m] without air of an object that is let go so much after a sample; NaN before."""
    q, qd, qdd, _, dt = motion()
    k = index + int(np.floor(late_s / dt + 1e-9))
    s = late_s + (index - k) * dt
    jerk = (qdd[k + 1] - qdd[k]) / dt
    X, V = tool_state(
        here.seen_from(name),
        q[k] + s * (qd[k] + s * (qdd[k] / 2 + s * jerk / 6)),
        qd[k] + s * (qdd[k] + s * jerk / 2),
    )
    s = (t - index * dt - late_s)[:, None]
    path = X[:3, 3] + V[:3] * s - np.array([0.0, 0.0, 0.5 * G]) * s * s
    return np.where(s >= 0.0, path, np.nan)


def least_gap(here: Cell, released: list[int]) -> float:
    """Returns the least distance of the two balls while both are above what they touch [m], by dense sampling."""
    t = np.arange(released[1] * 0.002 - SPREADS_S[1], released[1] * 0.002 + 1.0, 0.0005)
    paths = [
        [flown(here, name, index, late_s, t) for late_s in np.linspace(-spread_s, spread_s, 9)]
        for name, index, spread_s in zip(("", "left"), released, SPREADS_S, strict=True)
    ]
    radii = [here.grippers[name].object.radius_m for name in ("", "left")]
    gaps = []
    for a, b in product(*paths):
        flies = (a[:, 2] > radii[0]) & (b[:, 2] > radii[1])
        gaps.append(np.linalg.norm(a - b, axis=1)[flies].min(initial=np.inf) - sum(radii))
    return float(min(gaps))


@pytest.mark.parametrize(("more_m", "status"), [(-5e-3, Status.PROVEN), (5e-3, Status.VIOLATED)])
def test_how_far_the_objects_are_apart_in_the_air_is_proven_to_millimetres(more_m: float, status: Status) -> None:
    document, here = made()
    _, _, _, released, _ = motion()
    around = replace(here.surroundings, flight_clearance_m=least_gap(here, released) + more_m)
    found = of_check(verify(document, replace(here, surroundings=around, content="")), "flights_apart")
    assert [each.status for each in found] == [status]


MEET = (129, 141)  # samples of this motion from which two balls that are 5 cm apart in the tool fly into each other


def test_flights_that_are_made_to_meet_are_violated() -> None:
    near = cell_of_two(LEFT.replace("[0.0, -0.06, 0.17]", "[0.0, 0.01, 0.17]"))
    document = changed()
    assert statuses(judged(document, near), "flights_apart") == {Status.PROVEN}
    for told, index in zip(document["passages"], MEET, strict=True):
        told["index"] = told["end_index"] = index
    document["release"]["index"] = MEET[0]
    assert least_gap(near, list(MEET)) < 0.0
    verdict = judged(document, near)
    assert statuses(verdict, "releases_apart") == {Status.PROVEN}
    assert statuses(verdict, "flights_apart") == {Status.VIOLATED}


@pytest.mark.parametrize("number", [0, 1])
def test_a_release_that_is_a_tick_off_is_violated(number: int) -> None:
    _, here = made()
    document = changed()
    told = document["passages"][number]
    told["index"] += 1
    told["end_index"] += 1
    if number == 0:
        assert "first: the object is let go elsewhere" in {each.detail for each in verify(document, here).open}
        document["release"]["index"] += 1
    missed = [each for each in verify(document, here).open if each.name == "landing"]
    assert [(each.status, each.detail.split(":")[0]) for each in missed] == [(Status.VIOLATED, told["name"])]


def test_the_window_of_the_second_release_is_half_a_tick_longer() -> None:
    """Of a tolerance between what it misses half a window late and half a tick later, without air."""
    document, here = made()
    _, _, _, released, _ = motion()
    radius_m = here.grippers["left"].object.radius_m
    t = np.arange(released[1] * 0.002, released[1] * 0.002 + 1.0, 1e-5)
    missed = []
    for late_s in (-0.006, -0.0055, -0.005, 0.005, 0.0055, 0.006):
        path = flown(here, "left", released[1], late_s, t)
        lands = path[np.nonzero(path[:, 2] < 0.0)[0][0]]
        missed.append(float(np.linalg.norm(lands[:2] - np.array([1.1, -0.2]))))
    longest, middle, asked = (max(missed[i], missed[-1 - i]) for i in range(3))
    assert asked + 1e-4 < middle < longest - 1e-4 < radius_m
    document = changed()
    document["request"] |= {"release_window_s": 0.005, "landing_tolerance_m": middle}
    found = [each for each in of_check(verify(document, here), "landing_window") if each.detail.startswith("second")]
    assert [each.status for each in found] == [Status.VIOLATED]


@pytest.mark.parametrize("number", [0, 1])
def test_a_wall_in_a_flight_is_found(number: int) -> None:
    document, here = made()
    path = np.array(document["passages"][number]["flight"]["object_path"])
    there = path[len(path) // 2]
    around = here.surroundings
    wall = replace(around, keep_out=(*around.keep_out, Box(there - 0.01, there + 0.01, "wall")))
    found = verify(document, replace(here, surroundings=wall, content="")).open
    assert {(each.name, each.detail.split(",")[0]) for each in found} == {
        ("flight_clearance", f"{('first', 'second')[number]}: wall")
    }


@pytest.mark.parametrize(
    ("old", "new", "check"),
    [
        ("mass_kg = 0.08", "mass_kg = 0.6", "joint_torque"),  # all else is kept
        ("[0.0, -0.06, 0.17]", "[0.0, -0.06, 0.172]", "landing"),
        ("radius_m = 0.025", "radius_m = 0.025, drag_coefficient = 0.1", "landing"),
        ("jitter_s = 0.0005", "jitter_s = 0.1", "releases_apart"),
        ("opening_cone_rad = 2.0", "opening_cone_rad = 1.0", "opening_direction"),
        ("hold_acceleration_m_s2 = 100.0", "hold_acceleration_m_s2 = 30.0", "grip_acceleration"),
    ],
)
def test_another_second_gripper_or_object_is_not_proven(old: str, new: str, check: str) -> None:
    document, _ = made()
    assert old in LEFT
    verdict = judged(document, cell_of_two(LEFT.replace(old, new)))
    assert check in {each.name for each in verdict.open}
    if check == "joint_torque":
        assert {each.name for each in verdict.open} == {"joint_torque"}


@pytest.mark.parametrize(("more_s", "status"), [(-0.0019, Status.VIOLATED), (0.0021, Status.PROVEN)])
def test_two_grippers_are_told_to_open_in_ticks_of_their_own(more_s: float, status: Status) -> None:
    """The second delay so that the commands are `more_s` apart, of which a tick is 2 ms."""
    document, here = made()
    _, _, _, released, dt = motion()
    delay_s = here.gripper.delay_s + (released[1] - released[0]) * dt - more_s
    told = judged(document, cell_of_two(LEFT.replace("delay_s = 0.030", f"delay_s = {delay_s:.6f}")))
    found = [each.status for each in of_check(told, "releases_apart") if "commands" in each.detail]
    assert found == [status]


@pytest.mark.parametrize(("at", "status"), [(0, Status.VIOLATED), (-1, Status.PROVEN)])
def test_what_a_gripper_holds_keeps_clear_of_solids_as_long_as_it_is_held(at: int, status: Status) -> None:
    """A grain in front of the second ball, a millimetre too near: at the start, and at the end, when it is gone."""
    document, here = made()
    q, qd, _, _, _ = motion()
    X_WT, _ = tool_state(here.seen_from("left"), q[at], qd[at])
    ball = here.grippers["left"].object
    away_m = ball.radius_m + here.surroundings.clearance_m + 0.001 - NOT_FAR
    X_WC = np.eye(4)
    X_WC[:3, 3] = X_WT[:3, 3] + away_m * X_WT[:3, 2]
    grain = shape_of("sphere", X_WC, np.array([0.001, 0.001]), "grain")
    around = replace(here.surroundings, keep_out=(*here.surroundings.keep_out, grain))
    found = of_check(verify(document, replace(here, surroundings=around, content="")), "keep_out")
    assert {each.status for each in found} == {status}, found
    assert status is Status.PROVEN or found[0].detail.startswith("object of left, grain")


def test_releases_that_only_the_numbers_of_a_profile_tell_apart_are_not_violated_without_them() -> None:
    document, _ = made()
    scatters = cell_of_two(LEFT.replace("jitter_s = 0.0005", "jitter_s = 0.1"))
    both = judged(document, scatters)
    assert Status.VIOLATED in statuses(both, "releases_apart")
    assert {each.detail for each in of_check(both, "flights_apart")} == {
        "first and second: may be let go in any order"  # and so many pairs of releases are not looked at
    }
    verdict = judged({**document, "profile": "ball"}, scatters)
    assert {each.status for each in verdict.open} == {Status.NOT_PROVEN}
    assert {"releases_apart", "flights_apart"} <= {each.name for each in verdict.open if each.is_not_covered}


def test_what_is_not_covered_is_told_in_one_line_for_each_reason() -> None:
    _, here = made()
    document = changed()
    document["request"]["passages"][1]["state"]["opening"] = {"radius_m": 0.2, "rim_height_m": 0.1}
    verdict = verify({**document, "profile": "ball"}, here)
    assert verdict.status is Status.NOT_PROVEN
    assert [line.split(": not covered: ")[1] for line in verdict.reasons] == [
        "profile ball, whose numbers are not given"
    ]
    assert len(verdict.open) > 10
    (line,) = verify(document, here).reasons
    assert line == (
        "not proven: flight_clearance, landing, landing_window, landing_axis, keep_out: "
        "not covered: a bin beside objects of several grippers"
    )


@pytest.mark.parametrize(("side", "status"), [(1.0, Status.VIOLATED), (-1.0, Status.PROVEN)])
def test_a_flight_into_a_ball_that_is_held_a_tenth_of_a_millimetre_beside_it_is_violated(
    side: float, status: Status, monkeypatch: pytest.MonkeyPatch
):
    """The second ball where the first one is after 30 ms, as the tool sees it, or on the other side."""
    monkeypatch.setattr("planner.cell.gripper.OBJECTS_APART_M", 0.0)  # a cell file is refused below a millimetre
    document = changed()
    for table in (document, document["request"]):
        del table["passages"][1:]
    _, here = made()
    q, qd, _, released, dt = motion()
    own = here.seen_from("")
    later = released[0] + 15
    path = flown(here, "", released[0], 0.0, np.array([later * dt]))
    X_WT, _ = tool_state(own, q[later], qd[later])
    moved_F = own.tool.X_FT[:3, :3] @ X_WT[:3, :3].T @ (path[0] - X_WT[:3, 3])
    away_m = own.object.radius_m + here.grippers["left"].object.radius_m + 1e-4
    p_F = own.tool.X_FT[:3, 3] + side * away_m * moved_F / np.linalg.norm(moved_F)
    verdict = judged(
        document, cell_of_two(LEFT.replace("[0.0, -0.06, 0.17]", str([round(x, 9) for x in p_F.tolist()])))
    )
    assert {each.status for each in verdict.open if each.name == "flight_clearance"} == {status} - {Status.PROVEN}


JOINT = {"kind": "joint", "positions": [0.0] * 6, "velocities": [0.1] * 6}


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["request"]["passages"][1].update(releases="right"),
        lambda d: d["request"]["passages"][1].update(releases=True),
        lambda d: d["request"]["passages"][0].update(releases="left"),
        lambda d: d["request"]["passages"][1].update(releases=1),
        lambda d: d["request"]["passages"][1].update(releases=["left"]),
        lambda d: d["request"]["passages"][1].update(releases=""),
        lambda d: d["request"]["passages"][1].update(state=JOINT | {"velocities": [0.0] * 6}),
        lambda d: d["request"]["passages"].append({"name": "more", "state": JOINT, "releases": ""}),
    ],
)
def test_what_no_request_can_say_of_grippers_is_refused(change: Any) -> None:
    _, here = made()
    document = changed()
    change(document)
    with pytest.raises(NotAPlan):
        verify(document, here)


def test_releases_in_another_order_are_violated() -> None:
    _, here = made()
    document = changed()
    document["passages"][0]["index"], document["passages"][1]["index"] = 428, 142
    document["passages"][0]["end_index"], document["passages"][1]["end_index"] = 428, 142
    document["release"]["index"] = 428
    assert Status.VIOLATED in statuses(verify(document, here), "passage")
