"""Straight lines in motions: what is passed is judged by foreign code, refusals say where on the line."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from audit.judge import find_faults
from planner.answer import plan_document, plan_from_document
from planner.cell import Cell, cell_of_keys
from planner.certificate import certify
from planner.errors import Infeasible
from planner.geometry import tool_state
from planner.passages import output_edges
from planner.planning import Plan, plan
from planner.releases import SteadyLine
from planner.request import problem_from_request, request_document
from planner.rotations import rotation_vector_to_matrix
from planner.search import tool_lines
from planner.trajectory import interpolate
from tests.planner.problems import cell

DOWN = [math.pi, 0.0, 0.0]
SIZES = {"ur3e-sim": 0.6, "ur5e-sim": 1.0, "ur10e-sim": 1.3, "ur5-sim": 1.0}


def line(start: list[float], end: list[float], speed: float, first: Any = DOWN, last: Any = None) -> dict[str, Any]:
    """Returns a line from one place to another, with the tool turned from one orientation to the other."""
    return {
        "from": {"position": start, "rotation_vector": first},
        "to": {"position": end, "rotation_vector": last or first},
        "speed_m_s": speed,
    }


def bead(speed: float = 0.4, size: float = 1.0, **fields: Any) -> dict[str, Any]:
    """Returns a passage along a line of 0.4 m, about the height of a table."""
    place = [0.5 * size, 0.2 * size, 0.25 * size]
    return {"name": "bead", "line": line([place[0], -place[1], place[2]], place, speed), **fields}


def planned(request: dict[str, Any], here: Cell | None = None) -> Plan:
    """Returns the plan of a request, whose motion the audit finds faultless."""
    found = plan(problem_from_request(request, here or cell()))
    assert found.certificate.valid
    assert find_faults(found.problem, found.trajectory) == []
    return found


def only_line(found: Plan) -> tuple[SteadyLine, int, int]:
    """Returns a plan's one line, with the samples of its start and end."""
    (index,) = found.trajectory.passed
    (passage,) = found.problem.passages
    assert isinstance(passage.state, SteadyLine)
    return passage.state, index, index + passage.ticks(found.trajectory.sample_rate_hz)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.1, 0.37, 0.8])
@pytest.mark.parametrize("name", SIZES)
def test_a_line_is_passed_at_its_speed_at_all_times(name: str, speed: float) -> None:
    """The audit looks at every millisecond with Pinocchio, between ticks as well; ur5-sim has 125 Hz."""
    found = planned({"passages": [bead(speed, SIZES[name])], "end": {"kind": "home"}}, cell(name))
    _, first, last = only_line(found)
    lasts_s = 0.4 * SIZES[name] / speed
    assert 0.0 <= (last - first) * found.trajectory.dt - lasts_s < found.trajectory.dt - 1e-9


def test_the_tool_turns_evenly_along_a_line() -> None:
    turned = line([0.45, -0.2, 0.4], [0.5, 0.2, 0.3], 0.4, DOWN, [2.6, 0.3, -0.2])
    found = planned({"passages": [{"name": "arc", "line": turned}]})
    at, first, last = only_line(found)
    motion = found.trajectory
    middle = 0.5 * at.lasts_s
    q, qd, _ = motion.at(first * motion.dt + middle)
    X_WT, V_WT = tool_state(found.problem.cell, q, qd)
    start, end = rotation_vector_to_matrix(DOWN), rotation_vector_to_matrix([2.6, 0.3, -0.2])
    turns = [np.arccos(0.5 * (np.trace(X_WT[:3, :3].T @ R) - 1.0)) for R in (start, end)]
    assert turns[0] == pytest.approx(turns[1], abs=1e-6)
    assert np.linalg.norm(V_WT[3:]) == pytest.approx(2.0 * turns[0] / at.lasts_s, abs=1e-6)
    assert np.linalg.norm(V_WT[:3]) == pytest.approx(0.4, abs=1e-6)
    assert last > first


def test_states_and_lines_are_passed_one_after_another() -> None:
    state = {"kind": "point", "position": [0.35, 0.35, 0.5], "velocity": [-0.3, 0.3, 0.2]}
    back = line([0.3, 0.3, 0.3], [0.55, 0.1, 0.35], 0.5)
    passages = [bead(at_s=1.5), {"name": "by", "state": state}, {"name": "back", "line": back, "not_before_s": 4.0}]
    found = planned({"passages": passages, "end": {"kind": "home"}})
    passed = found.trajectory.passed
    assert passed[0] == 750
    assert passed[2] >= 2000
    document = plan_document(found, request_document(found.problem, found.problem.release), "", "")
    ends = [each["end_index"] for each in document["passages"]]
    assert ends == [passed[0] + 500, passed[1], passed[2] + math.ceil(0.324037 / 0.5 * 500)]
    problem, motion = plan_from_document(document, found.problem.cell)
    assert certify(problem, motion).valid


@pytest.mark.slow
def test_a_line_after_the_throw_and_one_before_it() -> None:
    throw = {"name": "throw", "state": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "releases": True}
    for passages in ([bead(), throw], [throw, bead()]):
        found = planned({"passages": passages})
        assert found.certificate.check("landing").ok


def test_lines_are_in_the_frame_of_the_request() -> None:
    base = {"position_m": [0.1, 0.0, 0.5], "rotation_vector_rad": [0.0, 0.0, 0.5]}
    here = cell_of_keys({"robot": "ur5e", "link": {"kind": "sim"}, "base_in_world": base})
    found = planned({"passages": [bead()], "frame": "base"}, here)
    at, *_ = only_line(found)
    assert at.X_WE[:3, 3] == pytest.approx((here.X_WB @ [0.5, 0.2, 0.25, 1.0])[:3])
    again = problem_from_request(request_document(found.problem, found.problem.release), here).passages[0].state
    assert isinstance(again, SteadyLine)
    assert np.abs(again.poses(np.array([0.3])) - at.poses(np.array([0.3]))).max() < 1e-12


def test_outputs_switch_where_the_tool_is_at_their_places() -> None:
    places = [(0.0, 0.0), (0.113, 0.0), (0.4, 0.0), (0.25, -0.03)]
    outputs = [
        {"output": "standard_digital", "index": i, "level": True, "offset_m": along_m, "offset_s": offset_s}
        for i, (along_m, offset_s) in enumerate(places)
    ]
    found = planned({"passages": [bead(outputs=outputs)]})
    edges = output_edges(found.problem.cell, found.problem.passages, found.trajectory)
    for edge in edges:
        along_m, offset_s = places[edge.switch.index]
        q, qd, _ = found.trajectory.at(edge.edge_time_s - offset_s)
        X_WT, _ = tool_state(found.problem.cell, q, qd)
        assert X_WT[:3, 3] == pytest.approx([0.5, along_m - 0.2, 0.25], abs=1e-6)
    document = plan_document(found, request_document(found.problem, found.problem.release), "", "")
    assert [each["offset_m"] for each in document["passages"][0]["outputs"]] == [along_m for along_m, _ in places]


@pytest.mark.parametrize("name", ["ur5e-sim", "ur5-sim"])
def test_the_certificate_bounds_what_deviates_between_samples(name: str) -> None:
    """A joint swings by 0.2 mrad/s, once in twelve ticks; the largest effect is found at 14 instants a tick."""
    found = planned({"passages": [bead()]}, cell(name))
    at, first, last = only_line(found)
    motion = found.trajectory
    n = last - first
    bump = np.zeros((n + 1, 6))
    zero = np.zeros(6)
    ticks = np.arange(n + 1)
    bump[:, 3] = 2e-4 * 12.0 * motion.dt / np.pi * np.sin(ticks * np.pi / 12.0) ** 2 * np.sin(ticks * np.pi / n) ** 6
    off = interpolate(bump, zero, zero, motion.dt)
    arrays = [x.copy() for x in (motion.q, motion.qd, motion.qdd)]
    for x, extra in zip(arrays, off, strict=True):
        x[first : last + 1] += extra
    (q, qd, qdd) = arrays
    disturbed = replace(motion, q=q, qd=qd, qdd=qdd)
    q, qd, _ = disturbed.at(first * motion.dt + np.linspace(0.0, n * motion.dt, 14 * n + 1))
    V = np.array([tool_state(found.problem.cell, *state).V_WT for state in zip(q, qd, strict=True)])
    worst = float(np.linalg.norm((V - at.V_WT)[:, :3], axis=1).max())
    turning = float(np.linalg.norm((V - at.V_WT)[:, 3:], axis=1).max())
    check = certify(found.problem, disturbed).check("passage")
    assert not check.ok
    assert check.detail.startswith("bead: orientation [rad/s]")
    assert turning > worst
    assert turning <= check.value < 1.2 * turning


def test_the_certificate_finds_a_line_that_is_not_kept() -> None:
    found = planned({"passages": [bead()]})
    at, first, _ = only_line(found)
    (passage,) = found.problem.passages
    aside = at.X_WE.copy()
    aside[0, 3] += 1e-4
    aslant = replace(at, X_WE=aside, V_WT=at.V_WT + 1e-4 / at.lasts_s * np.eye(6)[0])
    faster = replace(at, speed_m_s=0.401, V_WT=at.V_WT * 0.401 / 0.4)
    spun = replace(at, V_WT=at.V_WT + 1e-3 * np.eye(6)[5])
    for wrong in (aslant, faster, spun):
        problem = replace(found.problem, release=wrong, passages=(replace(passage, state=wrong),))
        assert [each.name for each in certify(problem, found.trajectory).failures] == ["passage"]
        if wrong is not spun:  # the audit has the twist from both ends
            rules = {fault.rule for fault in find_faults(problem, found.trajectory)}
            assert rules & {"release_position", "release_velocity"}
    later = replace(found.trajectory, passage_indices=(first + 1,))
    assert [each.name for each in certify(found.problem, later).failures] == ["passage"]
    late = replace(found.trajectory, passage_indices=(len(found.trajectory.q) - 5,))
    assert "passage" in [each.name for each in certify(found.problem, late).failures]


BOX = {"lower_m": [0.4, -0.05, 0.0], "upper_m": [0.6, 0.05, 0.3]}


@pytest.mark.parametrize(
    ("asked", "obstacle", "constraint", "reason", "limit"),
    [
        (line([0.5, 0.0, 0.3], [1.5, 0.0, 0.3], 0.4), None, "reach", "end of the line", None),
        (line([1.5, 0.0, 0.3], [0.5, 0.0, 0.3], 0.4), None, "reach", "start of the line", None),
        (line([0.4, 0.0, 0.3], [-0.4, 0.05, 0.3], 0.4), None, "singularity_distance", "shoulder, 0.2", 0.05),
        (line([0.5, -0.3, 0.2], [0.5, 0.3, 0.2], 0.4), BOX, "keep_out", "box 0, 0.2", 0.02),
        (line([0.4, -0.3, 0.3], [-0.4, -0.3, 0.3], 1.4), None, "joint_acceleration", "shoulder_pan_joint, 0.3", 15.0),
        (line([0.6, 0.0, 0.3], [0.82, 0.0, 0.3], 0.4), None, "singularity_distance", "elbow, 0.21", 0.4),
        (line([0.5, 0.0, 0.3], [0.5, 0.0, 0.02], 0.4), None, "floor", "end of the line", 0.02),
        (line([0.5, 0.0, 0.3], [0.5, 0.2, 0.3], 5.0), None, "tcp_speed", "start of the line", 4.0),
    ],
)
def test_a_refusal_says_what_is_in_the_way_and_where(
    asked: dict[str, Any], obstacle: Any, constraint: str, reason: str, limit: float | None
) -> None:
    here = cell().with_obstacles(obstacle) if obstacle else cell()
    least = {"singularity_distance_min": limit} if constraint == "singularity_distance" else {}
    with pytest.raises(Infeasible, match="passage 'bead'") as refused:
        plan(problem_from_request({"passages": [{"name": "bead", "line": asked}], **least}, here))
    (violation, *_) = refused.value.violations
    assert violation.constraint == constraint, violation
    assert reason in violation.detail, violation
    assert limit is None or violation.limit == pytest.approx(limit), violation
    assert "release" not in violation.detail, violation


@pytest.mark.parametrize(("goes_out", "what"), [(True, "fades, 0.182 m"), (False, "builds up, 0.000 m")])
def test_a_line_at_whose_end_a_joint_cannot_stay_within_its_speed_is_refused_for_that(
    goes_out: bool, what: str
) -> None:
    """The elbow is within its speed all along, and stretches ever faster towards the end that is far out."""
    aslant = [-2.950774482, -0.387746186, -0.09831947]
    ends = [[0.6, 0.0, 0.3], [0.7824116989, 0.0027831146, 0.3]]
    asked = line(*(ends if goes_out else ends[::-1]), 0.46443221, aslant)
    with pytest.raises(Infeasible, match=f"elbow_joint as its acceleration {what} along the line") as refused:
        plan(problem_from_request({"passages": [{"name": "bead", "line": asked}]}, cell()))
    (violation,) = refused.value.violations
    assert violation.constraint == "joint_velocity"
    assert 3.0 < (violation.value or 0.0) < 3.3


def test_a_line_of_the_least_length_is_drawn_wherever_it_lies() -> None:
    asked = line([0.5, -0.118, 0.3], [0.5, -0.117, 0.3], 0.1)  # which is 0.001 less a rounding
    found = planned({"passages": [{"name": "dash", "line": asked}]})
    _, first, last = only_line(found)
    assert last - first == 5


def test_what_the_certificate_finds_on_a_line_is_told_of_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """The box stands in the middle, and only both ends are looked at before."""
    monkeypatch.setattr(tool_lines, "CLEAR_M", 1.0)
    with pytest.raises(Infeasible, match="passage 'bead': ") as refused:
        plan(problem_from_request({"passages": [bead()], "end": {"kind": "home"}}, cell().with_obstacles(BOX)))
    (violation,) = refused.value.violations
    assert violation.constraint == "keep_out"
    assert violation.at_s is not None


def test_interpolation_is_the_clamped_spline() -> None:
    random = np.random.default_rng(1)
    for count in (2, 3, 4, 50):
        q = random.normal(size=(count, 6))
        first, last = random.normal(size=(2, 6))
        t = 0.002 * np.arange(count)
        spline = CubicSpline(t, q, bc_type=((1, first), (1, last)))  # pyright: ignore[reportArgumentType]
        for order, found in enumerate(interpolate(q, first, last, 0.002)):
            expected = spline(t, order)
            assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()
