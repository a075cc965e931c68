"""Motions through several passages: what they pass and keep is judged by foreign code, refusals name the leg."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from audit.judge import find_faults
from planner.backends import ruckig_otg
from planner.cell import Cell
from planner.certificate import certify
from planner.errors import Infeasible, InvalidProblem, SolverFailed, nothing_found
from planner.geometry import tool_state
from planner.planning import Plan, plan
from planner.request import problem_from_request, request_document
from planner.rotations import matrix_to_rotation_vector
from planner.search import PlanningSearch, chain, search_chain
from planner.search.chain import _Legs
from planner.trajectory import Trajectory
from tests.planner.problems import cell

DOWN = [np.pi, 0.0, 0.0]
TARGET = {"kind": "target", "position": [1.2, 0.3, 0.0]}


def over(x: float, y: float, speed: float = 1.0, z: float = 0.35) -> dict[str, Any]:
    """Returns the state of a tool that looks down and moves along y."""
    twist = {"linear": [0.0, speed, 0.0], "angular": [0.0, 0.0, 0.0]}
    return {"kind": "pose", "pose": {"position": [x, y, z], "rotation_vector": DOWN}, "twist": twist}


def row(count: int = 5, **fields: Any) -> dict[str, Any]:
    """Returns a request that passes over a row of parts."""
    states = [over(0.5, 0.12 * i - 0.24) for i in range(count)]
    return {"passages": [{"name": f"part {i}", "state": state} for i, state in enumerate(states)], **fields}


def planned(request: dict[str, Any], here: Cell | None = None) -> Plan:
    """Returns the plan of a request, whose motion the audit finds faultless."""
    found = plan(problem_from_request(request, here or cell()))
    assert found.certificate.valid
    assert find_faults(found.problem, found.trajectory) == []
    return found


@pytest.mark.parametrize("end", [{"kind": "rest"}, {"kind": "home"}, {"kind": "pose", "pose": over(0.3, 0.4)["pose"]}])
def test_a_row_of_parts_is_passed_in_one_sweep(end: dict[str, Any]) -> None:
    found = planned(row(end=end))
    passed = found.trajectory.passed
    assert len(passed) == 5
    assert max(np.diff(passed)) * found.trajectory.dt < 0.12 / 1.0  # sooner than at the speed of passing
    if end["kind"] == "home":
        assert np.array_equal(found.trajectory.q[-1], found.problem.cell.home)
    if end["kind"] == "pose":
        X, _ = tool_state(found.problem.cell, found.trajectory.q[-1], np.zeros(6))
        assert X[:3, 3] == pytest.approx([0.3, 0.4, 0.35], abs=1e-6)


@pytest.mark.parametrize("kind", ["joint", "pose", "point"])
@pytest.mark.parametrize("name", ["ur3e-sim", "ur5e-sim", "ur10e-sim", "ur5-sim"])
def test_states_of_a_known_motion_are_passed_again(name: str, kind: str) -> None:
    """Three states of slow sines about the cell's home, which a motion within the limits passes."""
    here = cell(name)
    swing = np.array([0.5, 0.15, 0.2, 0.2, 0.25, 0.4])
    phases = np.array([0.0, 0.3, 0.6, 0.9, 1.2, 1.5])
    passages = []
    for i, t in enumerate((0.4, 1.0, 1.7)):
        q = here.home + swing * (np.sin(1.3 * t + phases) - np.sin(phases))
        qd = 1.3 * swing * np.cos(1.3 * t + phases)
        passages.append({"name": str(i), "state": stated(here, kind, q, qd)})
    found = planned({"passages": passages}, here)
    assert found.certificate.check("passage").ok


def stated(here: Cell, kind: str, q: np.ndarray, qd: np.ndarray) -> dict[str, Any]:
    """Returns a joint state as a state of a kind."""
    X, V = tool_state(here, q, qd)
    place = X[:3, 3].tolist()
    if kind == "joint":
        return {"kind": "joint", "positions": q.tolist(), "velocities": qd.tolist()}
    if kind == "point":
        return {"kind": "point", "position": place, "velocity": V[:3].tolist()}
    pose = {"position": place, "rotation_vector": matrix_to_rotation_vector(X[:3, :3]).tolist()}
    return {"kind": "pose", "pose": pose, "twist": {"linear": V[:3].tolist(), "angular": V[3:].tolist()}}


def test_an_object_is_thrown_between_two_passages() -> None:
    camera = {"name": "camera", "state": over(0.1, -0.45, 0.4, 0.45)}
    back = {"name": "back", "state": over(0.3, -0.3, -0.4, 0.45)}
    found = planned({"passages": [camera, {"name": "throw", "state": TARGET, "releases": True}, back]})
    assert found.trajectory.release_index == found.trajectory.passed[1]
    assert found.certificate.check("landing").ok
    assert found.certificate.check("flight_clearance").ok


def test_an_object_is_thrown_into_a_bin_in_passing() -> None:
    camera = {"name": "camera", "state": {"kind": "point", "position": [0.5, 0.2, 0.5], "velocity": [0.0, -0.5, 0.0]}}
    into = {**TARGET, "position": [1.1, -0.1, 0.0], "opening": {"radius_m": 0.12, "rim_height_m": 0.2}}
    throw = {"name": "throw", "state": into, "releases": True}
    found = planned({"passages": [camera, throw], "end": {"kind": "home"}})
    assert found.certificate.check("landing_window").ok


def test_one_passage_that_lets_nothing_go_has_no_flight() -> None:
    """An object let go there would fly into the arm's base: as a release the state is refused."""
    inwards = {"kind": "point", "position": [-0.4, 0.0, 0.6], "velocity": [0.9, 0.0, 0.0]}
    with pytest.raises(Infeasible, match="flight_clearance"):
        plan(problem_from_request({"release": inwards}, cell()))
    found = planned({"passages": [{"name": "by", "state": inwards}]})
    assert not found.problem.throws
    names = {check.name for check in found.certificate.checks}
    assert {"passage", "grip_acceleration"} <= names
    assert names.isdisjoint(
        {"flight_clearance", "release_position", "release_velocity", "landing", "opening_direction"}
    )


def test_a_release_asked_for_as_a_passage_is_the_same_motion() -> None:
    release = {
        "kind": "joint",
        "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1],
        "velocities": [1.2, 0.6, -0.6, 0.3, 0.5, 0.2],
    }
    alone = planned({"release": release})
    passage = planned({"passages": [{"name": "throw", "state": release, "releases": True}]})
    for name in ("q", "qd", "qdd"):
        assert np.array_equal(getattr(alone.trajectory, name), getattr(passage.trajectory, name))
    assert alone.trajectory.release_index == passage.trajectory.release_index


@pytest.mark.parametrize(
    "times",
    [
        {0: ("at_s", 1.5)},
        {2: ("not_before_s", 1.5), 4: ("at_s", 2.4001)},
        {i: ("at_s", 1.3 + 0.14 * i) for i in range(5)},
    ],
)
def test_passages_are_at_their_times(times: dict[int, tuple[str, float]]) -> None:
    request = row()
    for i, (name, at_s) in times.items():
        request["passages"][i][name] = at_s
    found = planned(request)
    tick_s = found.trajectory.dt
    for i, (name, at_s) in times.items():
        passed_s = found.trajectory.passed[i] * tick_s
        assert passed_s >= at_s if name == "not_before_s" else abs(passed_s - at_s) <= 0.5 * tick_s
    later = replace(found.problem, passages=tuple(
        replace(each, not_before_s=0.0, at_s=found.trajectory.passed[i] * tick_s + tick_s)
        for i, each in enumerate(found.problem.passages)
    ))  # fmt: skip
    (failure,) = certify(later, found.trajectory).failures
    assert (failure.name, failure.detail) == ("passage", "part 0: time")


def test_passages_at_the_soonest_times_are_in_time() -> None:
    """The sum of their legs' times in floating point is beyond the last one's."""
    here = cell()
    rng = np.random.default_rng(0)
    passages: list[dict[str, Any]] = []
    for i in range(int(rng.integers(2, 7))):
        q = here.home + rng.uniform(-0.3, 0.3, 6)
        state = {"kind": "joint", "positions": q.tolist(), "velocities": rng.uniform(-0.3, 0.3, 6).tolist()}
        passages.append({"name": str(i), "state": state})
    request = {"passages": passages, "end": {"kind": "home"}}
    passed = planned(request, here).trajectory.passed
    for each, tick in zip(passages, passed, strict=True):
        each["at_s"] = tick / here.robot.sample_rate_hz
    assert planned(request, here).trajectory.passed == passed


def test_a_passage_that_cannot_be_in_time_is_refused_with_the_soonest_time() -> None:
    request = row()
    request["passages"][2]["at_s"] = 1.0
    with pytest.raises(Infeasible, match="to passage 'part 2': the soonest that was found") as refused:
        plan(problem_from_request(request, cell()))
    (violation,) = refused.value.violations
    soonest_s = violation.value
    assert soonest_s is not None
    assert violation.limit == 1.0
    assert soonest_s == pytest.approx(planned(row()).trajectory.passed[2] / 500.0, abs=0.02)
    request["passages"][2]["at_s"] = soonest_s + 0.05
    assert planned(request).trajectory.passed[2] == round((soonest_s + 0.05) * 500.0)


def test_a_leg_that_lasts_too_long_is_refused_with_the_limit() -> None:
    request = row(1)
    request["passages"][0]["at_s"] = 60.0
    with pytest.raises(Infeasible, match=r"passage 'part 0': the motion would take .* s, and may 40 s"):
        plan(problem_from_request(request, cell()))


def changed(motion: Trajectory, **fields: Any) -> Trajectory:
    return replace(motion, **fields)


def test_the_certificate_finds_a_passage_that_is_not_there() -> None:
    found = planned(row())
    motion = found.trajectory
    first, *others = motion.passed
    swapped = (others[0], first, *others[1:])
    for passed in ((first + 1, *others), (first, *others[:-1]), swapped, ()):
        failures = certify(found.problem, changed(motion, passage_indices=passed)).failures
        assert "passage" in [check.name for check in failures], passed
    elsewhere = replace(found.problem, end=problem_from_request(row(end={"kind": "home"}), cell()).end)
    (failure,) = certify(elsewhere, motion).failures
    assert failure.name == "passage"
    assert failure.detail.startswith("end: ")


def test_the_certificate_watches_singularities_at_every_passage() -> None:
    found = planned(row())
    least = found.certificate.check("singularity_distance")
    asked = replace(found.problem.limits, singularity_distance_min=least.value + 0.01)
    names = [check.name for check in certify(replace(found.problem, limits=asked), found.trajectory).failures]
    assert names == ["singularity_distance"]


def test_an_output_is_not_switched_twice_in_a_tick_by_two_passages() -> None:
    """Which of them came last was a matter of rounding."""
    request = row(2)
    flash = {"output": "standard_digital", "index": 2}
    for number, (at_s, level, offset_s) in enumerate([(1.5, True, 0.2), (3.0, False, -1.299)]):
        request["passages"][number] |= {"at_s": at_s, "outputs": [flash | {"level": level, "offset_s": offset_s}]}
    with pytest.raises(Infeasible, match="part 0 and part 1: between two edges of standard_digital 2"):
        plan(problem_from_request(request, cell()))
    request["passages"][1]["outputs"][0]["offset_s"] = -1.298
    assert planned(request).certificate.valid


def test_a_passage_after_the_throw_is_without_the_object() -> None:
    """The tool alone passes where the object that it held would touch the floor."""
    here = replace(cell(), object=replace(cell().object, radius_m=0.06))
    low = {"name": "low", "state": over(0.45, -0.2, -0.3, 0.07)}
    throw = {"name": "throw", "state": TARGET, "releases": True}
    assert planned({"passages": [throw, low]}, here).certificate.valid
    with pytest.raises(Infeasible, match="object") as refused:
        plan(problem_from_request({"passages": [low, throw]}, here))
    assert refused.value.violations[0].proven


def test_a_refusal_names_the_passage_that_is_out_of_reach() -> None:
    request = row()
    request["passages"][3]["state"] = over(1.5, 0.0)
    with pytest.raises(Infeasible, match="passage 'part 3'") as refused:
        plan(problem_from_request(request, cell()))
    assert refused.value.violations[0].constraint == "reach"
    assert refused.value.violations[0].proven


@pytest.mark.parametrize("state", [over(0.5, 0.0, 5.0), over(0.5, 0.0, z=0.03), over(0.42, 0.0, 3.3)])
def test_a_refusal_of_what_lets_nothing_go_speaks_of_no_release(state: dict[str, Any]) -> None:
    """The first is refused for its speed, the second for the floor, the third for its joints."""
    for request in ({"passages": [{"name": "part 0", "state": state}]}, row(end={"kind": "home"})):
        request["passages"][0]["state"] = state
        with pytest.raises(Infeasible, match="passage 'part 0'") as refused:
            plan(problem_from_request(request, cell()))
        assert "release" not in str(refused.value)


def test_a_refusal_names_the_leg_in_whose_way_something_stands() -> None:
    """The last passage moves towards a wall that is too near to stop before it."""
    here = cell().with_obstacles({"lower_m": [0.3, 0.106, 0.0], "upper_m": [0.8, 0.14, 0.8]})
    request = {"passages": [{"name": "first", "state": over(0.5, -0.3)}, {"name": "last", "state": over(0.5, 0.0)}]}
    with pytest.raises(Infeasible, match="leg 3, from passage 'last' to rest") as refused:
        plan(problem_from_request(request, here))
    assert [each.constraint for each in refused.value.violations] == ["keep_out"]
    assert not refused.value.violations[0].proven


@pytest.mark.parametrize("bound", [2, 3])
def test_no_more_motions_are_looked_at_than_its_bound(bound: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two along a way: an odd bound is reached between them."""
    here = cell().with_obstacles({"lower_m": [0.3, 0.106, 0.0], "upper_m": [0.8, 0.14, 0.8]})
    request = {"passages": [{"name": "first", "state": over(0.5, -0.3)}, {"name": "last", "state": over(0.5, 0.0)}]}
    search = PlanningSearch(problem_from_request(request, here), math.inf)
    monkeypatch.setattr(chain, "MOTIONS", bound)
    with pytest.raises(Infeasible):
        search_chain(search)
    assert len(search.rejected) == bound


def test_a_refusal_names_the_leg_that_begins_where_no_leg_leads() -> None:
    """Each leg has states left, but the second one none that the first one leads to."""
    problem = problem_from_request(row(2), cell())
    names = ["the start", "part 0", "part 1", "rest"]
    state = tuple(np.zeros((1, 6)) for _ in range(3))
    ticks = [np.array([[9.0, np.inf]]), np.array([[np.inf, np.inf], [9.0, 9.0]]), np.array([[9.0], [9.0]])]
    paces = [np.zeros(each.shape, np.int64) for each in ticks]
    legs = _Legs(problem, names, [[state], [state, state], [state, state], [None]], [0] * 4, ticks, paces)
    assert legs.shortest() is None
    for number in range(3):
        legs.obstacles[number] = nothing_found("motion", "stands there").within(legs.leg_name(number))
    assert "leg 2, from part 0 to part 1" in str(legs.obstacle())


def test_a_refusal_names_an_end_that_is_blocked() -> None:
    here = cell().with_obstacles({"lower_m": [0.3, 0.106, 0.0], "upper_m": [0.8, 0.14, 0.8]})
    request = row(2, end={"kind": "pose", "pose": over(0.5, 0.1)["pose"]})
    with pytest.raises(Infeasible, match="the end: ") as refused:
        plan(problem_from_request(request, here))
    assert refused.value.violations[0].constraint == "keep_out"


def test_the_time_limit_ends_a_search_without_a_motion() -> None:
    problem = problem_from_request(row(time_limit_s=1e-6), cell())
    with pytest.raises(SolverFailed, match="time_limit"):
        plan(problem)


def test_a_back_end_that_cannot_is_refused_by_name() -> None:
    with pytest.raises(InvalidProblem, match="backend: 'toppra' makes no motion through several states"):
        problem_from_request(row(backend="toppra"), cell())


def test_a_problem_of_passages_is_stated_as_the_request_that_it_answers() -> None:
    request = row(end={"kind": "home"})
    request["passages"][0]["outputs"] = [{"output": "standard_digital", "index": 2, "level": True, "offset_s": -0.01}]
    problem = problem_from_request(request, cell())
    again = problem_from_request(request_document(problem, problem.release), cell())
    assert [each.outputs for each in again.passages] == [each.outputs for each in problem.passages]
    assert [each.name for each in again.passages] == [each.name for each in problem.passages]
    assert np.array_equal(again.end.q, cell().home)  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]


@pytest.mark.parametrize("seed", range(4))
def test_a_point_before_a_joint_state_is_passed_near_both(seed: int) -> None:
    """As soon as the motion through a posture that is known, which the request does not tell."""
    here = cell()
    rng = np.random.default_rng(seed)
    zero = np.zeros(6)
    first = here.home + rng.uniform(-0.6, 0.6, 6)
    last = first + rng.uniform(-0.6, 0.6, 6)
    passages = [
        {"name": "point", "state": stated(here, "point", first, 0.2 * here.limits.qd_max)},
        {"name": "joints", "state": stated(here, "joint", last, 0.1 * here.limits.qd_max)},
    ]
    found = planned({"passages": passages}, here)
    states = [(here.home, zero, zero), (first, 0.2 * here.limits.qd_max, zero), (last, 0.1 * here.limits.qd_max, zero)]
    known_s = sum(ruckig_otg.least_leg_time(found.problem, a, b) for a, b in pairwise(states))
    assert found.trajectory.passed[-1] * found.trajectory.dt < known_s
