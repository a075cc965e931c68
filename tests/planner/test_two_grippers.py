"""Motions in which two grippers let go: judged by foreign code, by what is held at each instant, and by mutations."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from audit.judge import arm_model, find_faults
from planner.answer import plan_document, plan_from_document
from planner.cell import Cell
from planner.certificate import certify
from planner.errors import CellError, InvalidProblem
from planner.geometry import tool_state
from planner.planning import Plan, plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request, request_document
from planner.trajectory import Trajectory
from tests.planner.problems import cell
from tests.planner.two_grippers import LEFT, TARGETS, cell_of_two, two_throws

G = 9.81
SEEN_S = 100.0
BELT_M_S = np.array([0.0, 0.2, 0.0])


@pytest.fixture(scope="module")
def here() -> Cell:
    return cell_of_two()


@pytest.fixture(scope="module")
def made(here: Cell) -> Plan:
    return plan(problem_from_request(two_throws(), here))


def refused(request: dict[str, Any], here: Cell) -> list[tuple[str, str]]:
    with pytest.raises(InvalidProblem) as caught:
        problem_from_request(request, here)
    return [(error.field, error.reason) for error in caught.value.errors]


@pytest.mark.slow
def test_the_audit_finds_no_fault_in_what_either_gripper_sees(made: Plan) -> None:
    assert made.certificate.valid
    assert len(made.problem.parts) == 2
    for part in made.problem.parts:
        assert find_faults(part.problem, part.of(made.trajectory)) == []


def test_the_torques_are_those_of_what_is_held_at_each_instant(here: Cell, made: Plan) -> None:
    """Pinocchio's, with both objects, one and none on the flange; the certificate's bound is above each."""
    motion = made.trajectory
    names = list(here.grippers)
    first, second = (np.array(motion.passed) * motion.dt).tolist()
    empty = here.seen_from("", names[1:])
    data = [arm_model(empty, False).copy() for _ in range(3)]
    for held, model in zip(([0, 1], [1], []), data, strict=True):
        for i in held:
            each = here.grippers[names[i]]
            ball = pin.Inertia(each.object.mass_kg, each.X_FT[:3, 3], np.zeros((3, 3)))
            model.appendBodyToJoint(6, ball, pin.SE3.Identity())
    spans = ((0.0, first), (first, second), (second, motion.duration_s))
    found = np.zeros(6)
    for (begin, end), model in zip(spans, data, strict=True):
        work = model.createData()
        for t in np.linspace(begin, end, 150):
            tau = pin.rnea(model, work, *motion.at(np.array(t)))
            found = np.maximum(found, np.abs(tau) / made.problem.limits.tau_max)
    check = made.certificate.check("joint_torque")
    assert found.max() <= check.value / check.limit + 1e-6
    assert found.max() > 0.9 * check.value / check.limit


def test_each_object_lands_at_its_own_target(here: Cell, made: Plan) -> None:
    """In free flight from the place of its own gripper."""
    motion = made.trajectory
    for (name, target), index in zip(TARGETS.items(), motion.passed, strict=True):
        X, V = tool_state(here.seen_from(name), motion.q[index], motion.qd[index])
        p, v = X[:3, 3], V[:3]
        t = (v[2] + np.sqrt(v[2] ** 2 + 2.0 * G * (p[2] - target[2]))) / G
        assert p + v * t - np.array([0.0, 0.0, 0.5 * G * t * t]) == pytest.approx(target, abs=1e-3)


def test_the_other_object_is_a_load_and_a_shape(here: Cell) -> None:
    own = here.seen_from("")
    assert own is here
    left = here.seen_from("left")
    assert left.sha256 == here.sha256
    assert pytest.approx(here.tool.X_FT) == left.seen_from("").tool.X_FT
    assert left.seen_from("left") is left
    assert [each.gripper for each in left.carried] == [""]
    assert len(left.tool.capsules) == len(here.tool.capsules) == 3
    assert len(here.seen_from("left", [""]).tool.capsules) == 2
    assert left.tool.capsules[-1].from_m == pytest.approx([0.0, 0.06, 0.17])
    assert left.tool.capsules[-1].radius_m == 0.02


def test_the_objects_keep_apart_in_the_air(here: Cell, made: Plan) -> None:
    """As far as any pair of releases within their spreads, by flights of ten times as many instants."""
    motion = made.trajectory
    check = made.certificate.check("flights_apart")
    parts = made.problem.parts
    released = [part.of(motion).release_time_s for part in parts]
    t = np.arange(released[1], released[1] + 1.0, 0.0005)
    flights = []
    for part, at in zip(parts, released, strict=True):
        spread = part.problem.opening_spread_s
        for r in (at - spread, at, at + spread):
            q, qd, _ = motion.at(np.array(r))
            X, V = tool_state(part.problem.cell, q, qd)
            s = (t - r)[:, None]
            flights.append(X[:3, 3] + V[:3] * s - np.array([0.0, 0.0, 0.5 * G]) * s * s)
    apart = np.inf
    for a, b in product(flights[:3], flights[3:]):
        flies = (a[:, 2] > 0.0) & (b[:, 2] > 0.0)
        apart = min(apart, float(np.linalg.norm(a - b, axis=1)[flies].min()))
    least = apart - 0.02 - 0.025
    assert check.ok
    assert least - 0.06 < check.value <= least


def judged(made: Plan, here: Cell, request: dict[str, Any], motion: Trajectory | None = None) -> set[str]:
    """Returns the checks that a motion fails as an answer to another request, or in another cell."""
    problem = replace(problem_from_request(request, here), limits=made.problem.limits)
    return {check.name for check in certify(problem, motion or made.trajectory).failures}


@pytest.mark.slow
def test_a_wrong_motion_fails(made: Plan) -> None:
    moved = LEFT.replace("[0.0, -0.06, 0.17]", "[0.0, -0.06, 0.18]")
    assert {"landing"} <= judged(made, cell_of_two(moved), two_throws())
    heavy = LEFT.replace("mass_kg = 0.08", "mass_kg = 3.0")
    assert "joint_torque" in judged(made, cell_of_two(heavy), two_throws())
    other = two_throws()
    other["passages"][1]["state"] = {**other["passages"][1]["state"], "position": [1.1, -0.3, 0.0]}
    assert "landing" in judged(made, cell_of_two(), other)
    jumpy = LEFT.replace("jitter_s = 0.0005", "jitter_s = 0.4")
    assert "releases_apart" in judged(made, cell_of_two(jumpy), two_throws(release_window_s=0.005))
    late = LEFT.replace("delay_s = 0.030", f"delay_s = {0.040 + np.diff(made.trajectory.passed)[0] * 0.002:.4f}")
    assert "releases_apart" in judged(made, cell_of_two(late), two_throws())  # both are told to open in one tick
    swapped = replace(made.trajectory, passage_indices=made.trajectory.passed[::-1])
    assert "passage" in judged(made, cell_of_two(), two_throws(), swapped)


def test_the_answer_tells_each_release_and_is_read_back(here: Cell, made: Plan) -> None:
    request = two_throws()
    document = plan_document(made, request, "id", "now")
    first, second = document["passages"]
    assert (first["releases"], second["releases"]) == (True, "left")
    assert document["release"]["index"] == first["index"]
    assert document["flight"] == first["flight"]
    for passed, (name, target) in zip((first, second), TARGETS.items(), strict=True):
        assert passed["flight"]["landing_point"] == pytest.approx(target, abs=1e-3)
        delay_s = here.grippers[name].gripper.delay_s + here.timing.lag_s
        assert passed["command_time_s"] == pytest.approx(passed["time_s"] - delay_s)
    problem, motion = plan_from_document(document, here)
    assert certify(problem, motion).valid
    again = problem_from_request(request_document(problem, problem.release), here)
    assert [each.gripper for each in again.passages] == ["", "left"]


def test_the_other_gripper_alone_throws_from_its_own_place(here: Cell) -> None:
    passage = {"name": "throw", "state": {"kind": "target", "position": [1.1, -0.2, 0.0]}, "releases": "left"}
    found = plan(problem_from_request({"passages": [passage]}, here))
    assert found.problem.cell.mounted == "left"
    assert found.problem.parts == ()
    assert find_faults(found.problem, found.trajectory) == []
    document = plan_document(found, {"passages": [passage]}, "id", "now")
    problem, motion = plan_from_document(document, here)
    assert certify(problem, motion).valid


@pytest.mark.slow
def test_both_throws_end_at_home(here: Cell, made: Plan) -> None:
    found = plan(problem_from_request(two_throws(end={"kind": "home"}), here))
    assert found.trajectory.passed == made.trajectory.passed
    assert np.array_equal(found.trajectory.q[-1], here.home)
    for part in found.problem.parts:
        assert find_faults(part.problem, part.of(found.trajectory)) == []


def test_a_passage_that_lets_nothing_go_is_one_of_the_own_gripper(here: Cell) -> None:
    over = {"kind": "joint", "positions": here.home.tolist(), "velocities": [0.1] * 6}
    request = two_throws()
    request["passages"] = [{"name": "camera", "state": over}, request["passages"][1]]
    problem = problem_from_request(request, here)
    assert [(part.problem.cell.mounted, part.numbers) for part in problem.parts] == [("left", (1,)), ("", (0,))]
    assert [part.problem.throws for part in problem.parts] == [True, False]


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"releases": "right"}, "passages[1].releases", "'right' is no gripper of the cell: there are left"),
        ({"releases": True}, "passages[1].releases", "'first' lets the object go already"),
        ({"releases": False}, "passages[1].releases", "may only be true or a name"),
        ({"releases": ""}, "passages[1].releases", "may only be true or a name"),
        (
            {"outputs": [{"output": "standard_digital", "index": 1, "level": True}]},
            "passages[1].outputs[0]",
            "is the gripper's own output",
        ),
        (
            {
                "state": {
                    "kind": "target",
                    "position": [1.1, -0.2, 0.0],
                    "opening": {"radius_m": 0.1, "rim_height_m": 0.1},
                }
            },
            "passages[1].state.opening",
            "a bin is not supported yet",
        ),
        (
            {
                "state": {
                    "kind": "target",
                    "position": [1.1, -0.2, 0.0],
                    "velocity": [0.1, 0.0, 0.0],
                    "observed_at_s": 1.0,
                }
            },
            "passages[1].state.velocity",
            "is met by the object that leaves first",
        ),
        (
            {
                "state": {
                    "kind": "target",
                    "position": [1.1, -0.2, 0.0],
                    "velocity": [0.0, 0.0, 0.0],
                    "observed_at_s": 1.0,
                    "uncertainty": {"position_std_m": 0.001, "velocity_std_m_s": 0.0},
                }
            },
            "passages[1].state.uncertainty",
            "has no odds",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_field(here: Cell, change: dict[str, Any], field: str, words: str) -> None:
    request = two_throws()
    request["passages"][1] = {**request["passages"][1], **change}
    assert any(name == field and words in reason for name, reason in refused(request, here))


@pytest.mark.slow
def test_the_first_object_meets_a_target_that_moves(here: Cell) -> None:
    request = two_throws(starts_not_before_s=SEEN_S + 0.5)
    place = np.array(TARGETS[""]) - 1.5 * BELT_M_S
    moves = {"position": place.tolist(), "velocity": BELT_M_S.tolist(), "observed_at_s": SEEN_S}
    request["passages"][0]["state"] |= moves
    found = plan(problem_from_request(request, here))
    for part in found.problem.parts:
        assert find_faults(part.problem, part.of(found.trajectory)) == []
    document = plan_document(found, request, "", "")
    first, second = (each["flight"] for each in document["passages"])
    lands_s = document["starts_at_s"] + document["release_time_s"] + first["time_of_flight_s"]
    there = place + (lands_s - SEEN_S) * BELT_M_S
    np.testing.assert_allclose(first["landing_point"], there, atol=5e-4)
    np.testing.assert_allclose(second["landing_point"], TARGETS["left"], atol=5e-4)
    problem, motion = plan_from_document(document, here)
    assert certify(problem, motion).valid
    late, _ = plan_from_document({**document, "starts_at_s": document["starts_at_s"] + 0.02}, here)
    assert not certify(late, motion).valid


def test_what_is_not_supported_with_several_is_refused(here: Cell) -> None:
    moving = two_throws(start={"positions": here.home.tolist(), "velocities": [0.1] * 6})
    assert refused(moving, here)[0][0] == "passages[1].releases"
    odds = refused(two_throws(min_hit_probability=0.5), here)
    assert [field for field, _ in odds] == ["min_hit_probability"]
    (unknown,) = [each for each in refused(two_throws(), cell()) if each[0] == "passages[1].releases"]
    assert "there are none besides [gripper]" in unknown[1]


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('output = "standard_digital"\nindex = 1', 'output = "tool_digital"\nindex = 0', "grippers.left.index"),
        ("index = 1\n", "", "grippers.left.index"),
        ("index = 1\n", "index = 9\n", "grippers.left.index"),
        ("[grippers.left]", '[grippers."l e f t"]', "grippers"),
        ("mass_kg = 0.08", "mass_kg = 9.0", "object.mass_kg"),
        ("radius_m = 0.025", 'shape = "cylinder", radius_m = 0.02, length_m = 0.1', "grippers.left.object.shape"),
        ("radius_m = 0.025", "radius_m = -1.0", "grippers.left.object.radius_m"),
        ("jitter_s = 0.0005", "jitter_s = -1.0", "grippers.left.jitter_s"),
        ("tcp_position_m = [0.0, -0.06, 0.17]\n", "", "grippers.left.tcp_position_m"),
    ],
)
def test_a_wrong_cell_file_names_the_field(old: str, new: str, field: str) -> None:
    with pytest.raises(CellError) as caught:
        cell_of_two(LEFT.replace(old, new))
    assert caught.value.field == field


def test_more_grippers_than_four_are_refused() -> None:
    more = "".join(LEFT.replace("left", f"n{i}").replace("index = 1", f"index = {i}") for i in range(4))
    with pytest.raises(CellError, match="3 at most"):
        cell_of_two(more)


def test_a_cell_with_one_gripper_is_seen_as_it_is() -> None:
    here = cell()
    assert here.seen_from("") is here
    problem = ThrowProblem(here, here.home, made_release(here), here.limits)
    assert problem.parts == ()


def made_release(here: Cell) -> Any:
    return problem_from_request({"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}, here).release


def test_what_no_passage_lets_go_of_is_held_as_firmly_as_its_gripper_can(here: Cell) -> None:
    """The own gripper withstands little more than gravity, and another one throws."""
    throw = {"name": "throw", "state": {"kind": "target", "position": TARGETS["left"]}, "releases": "left"}
    thrown = plan(problem_from_request({"passages": [throw]}, here)).trajectory
    weak = replace(here, gripper=replace(here.gripper, hold_acceleration_m_s2=np.array([12.0])))
    own = here.grippers[""]
    weak = replace(weak, grippers={**here.grippers, "": replace(own, gripper=weak.gripper)})
    check = certify(problem_from_request({"passages": [throw]}, weak), thrown).check("grip_acceleration")
    t = np.arange(0.0, thrown.duration_s, 5e-4)
    points = [tool_state(here.seen_from(""), *thrown.at(np.array(each))[:2]).p_WT for each in t]
    felt = np.gradient(np.gradient(np.reshape(points, (-1, 3)), t, axis=0), t, axis=0) + np.array([0.0, 0.0, G])
    assert check is not None
    assert (check.ok, check.limit, check.detail) == (False, 12.0, "of the own gripper")
    assert check.value == pytest.approx(np.linalg.norm(felt[5:-5], axis=1).max(), rel=0.05)


@pytest.mark.parametrize("apart_m", [0.005, 0.0459])
def test_objects_in_each_other_or_touching_are_refused(apart_m: float) -> None:
    """Beside one that it touches, the thrown object would be judged once it is clear of it only."""
    near = LEFT.replace("[0.0, -0.06, 0.17]", f"[0.0, {0.06 - apart_m}, 0.17]")
    with pytest.raises(CellError, match=r"with their objects' radii and 1 mm between, 0.0460 m at least"):
        cell_of_two(near)
    cell_of_two(LEFT.replace("[0.0, -0.06, 0.17]", "[0.0, 0.0139, 0.17]"))


@pytest.mark.slow
def test_two_objects_are_thrown_after_a_passage_in_whose_posture_no_leg_to_a_throw_begins(here: Cell) -> None:
    """Legs between joint states were refused at singularities, with a leg to rest named that was not in the way."""
    at_home = {"kind": "joint", "positions": here.home.tolist(), "velocities": [0.1] * 6}
    request = two_throws()
    request["passages"] = [{"name": "camera", "state": at_home}, *request["passages"]]
    found = plan(problem_from_request(request, here))
    assert found.status == "one throw after another"
    for part in found.problem.parts:
        assert find_faults(part.problem, part.of(found.trajectory)) == []
    document = plan_document(found, request, "", "")
    camera, first, second = document["passages"]
    assert camera["time_s"] < first["time_s"] < second["time_s"]
    assert np.allclose(found.trajectory.q[camera["index"]], here.home)
    for passed, target in zip((first, second), TARGETS.values(), strict=True):
        np.testing.assert_allclose(passed["flight"]["landing_point"], target, atol=5e-4)
