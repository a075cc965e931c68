"""Certified plans are proven, what breaks a limit by a thousandth or a millimetre is not, nor what is not covered."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from api.cli import main
from benchmarks.mutations import cell_of_arm, mutations
from benchmarks.proofs import INSIDE, document_of, is_accepted
from planner.certificate import certify
from planner.certificate.flight.flights import Flights
from planner.errors import InvalidProblem
from planner.planning import plan
from planner.problem import JointRelease, Opening, TargetRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.planner import problems
from verifier import NotAPlan, Status, verify

EVERY = 3  # [-] mutants of which one is tried here: `python -m benchmarks.proofs` tries all, of many plans
TRIED = range(EVERY)


@cache
def planned(name: str) -> tuple[ThrowProblem, Trajectory]:
    """Problems with their certified motions."""
    if name == "joint":
        problem = problems.joint_problem(backend="ruckig")
    elif name == "every limit":
        here = cell_of_arm("ur5e")
        release = TargetRelease(np.array([0.9, 0.3, 0.0]))
        problem = ThrowProblem(here, here.home, release, here.limits, 0.005, 0.02)
    else:
        here = problems.cell({"bin": "ur5e-sim", "CB3": "ur5-sim", "target": "ur10e-sim"}[name])
        opening = Opening(0.12, 0.15) if name == "bin" else None
        release = TargetRelease(np.array([1.1, 0.3, 0.0]), opening=opening)
        problem = ThrowProblem(here, here.home, release, here.limits, 0.005, 0.05)
    return problem, plan(problem).trajectory


@pytest.mark.parametrize("name", ["joint", "bin", "CB3", "target", "every limit"])
def test_a_certified_plan_is_proven(name: str):
    verdict = verify(*document_of(*planned(name)))
    assert verdict.status is Status.PROVEN, list(map(str, verdict.open))


def test_every_check_of_the_certificate_is_made():
    """What a certificate claims of a throw in a cell with every limit, the verifier proves under the same name."""
    problem, trajectory = planned("every limit")
    certified = {check.name for check in certify(problem, trajectory).checks}
    proven = {finding.name for finding in verify(*document_of(problem, trajectory)).findings}
    assert certified <= proven


@pytest.mark.parametrize(("holds_m_s2", "status"), [(9.5, Status.VIOLATED), (100.0, Status.PROVEN)])
def test_what_is_not_let_go_is_held_to_the_end(holds_m_s2: float, status: Status):
    """At rest a grip has to withstand 9.81 m/s^2."""
    problem = problems.joint_problem(backend="ruckig")
    assert isinstance(problem.release, JointRelease)
    move = replace(problem, release=replace(problem.release, qd=np.zeros(6)))
    document, cell = document_of(move, plan(move).trajectory)
    gripper = replace(cell.gripper, hold_acceleration_m_s2=np.array([holds_m_s2]))
    verdict = verify(document, replace(cell, gripper=gripper, content=""))
    assert [each.status for each in verdict.findings if each.name == "grip_acceleration"] == [status]


@pytest.mark.parametrize("turn", TRIED)
def test_no_plan_that_breaks_a_limit_is_accepted(turn: int):
    problem, trajectory = planned("every limit")
    accepted = []
    for mutation in list(mutations(problem, trajectory, INSIDE))[turn::EVERY]:
        try:
            mutant = mutation.problem()
        except InvalidProblem:
            continue  # its start is beyond the limit
        if is_accepted(mutant, trajectory):
            accepted.append(mutation.limit)
    assert accepted == []


START = (problems.cell().home + 1e-3).tolist()
CHANGES = {
    "start": lambda d: d["request"].update(start={"positions": START}),
    "continuity": lambda d: d["trajectory"]["positions"][40].__setitem__(2, d["trajectory"]["positions"][40][2] + 1e-3),
    "end_at_rest": lambda d: d["trajectory"]["velocities"][-1].__setitem__(5, 0.01),
    "release_position": lambda d: d["request"]["release"]["positions"].__setitem__(
        1, d["request"]["release"]["positions"][1] + 1e-3
    ),
    "release_velocity": lambda d: d["request"]["release"]["velocities"].__setitem__(
        1, d["request"]["release"]["velocities"][1] * 1.01
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_document_is_violated(name: str):
    document, cell = document_of(*planned("joint"))
    CHANGES[name](document)
    verdict = verify(document, cell)
    assert verdict.status is Status.VIOLATED
    assert name in {finding.name for finding in verdict.open}


@pytest.mark.parametrize("off", [[1e-3, 0.0, 0.0], [0.0, -1e-3, 0.0]])
def test_a_landing_a_millimetre_off_is_violated(off: list[float]):
    document, cell = document_of(*planned("target"))
    document["request"]["release"]["position"] = (np.array(document["request"]["release"]["position"]) + off).tolist()
    verdict = verify(document, cell)
    assert "landing" in {finding.name for finding in verdict.open if finding.status is Status.VIOLATED}


THROW = {"kind": "target", "position": [1.1, 0.3, 0.0]}  # of the plan "target"
NOT_COVERED = {
    "landing": {"profile": "ball"},
    "landing_window": {"request": {"min_hit_probability": 0.5, "release_window_s": None}},
}


@pytest.mark.parametrize("name", NOT_COVERED)
def test_what_is_not_covered_is_not_proven(name: str):
    document, cell = document_of(*planned("target"))
    more = dict(NOT_COVERED[name])
    document["request"].update(more.pop("request", {}))
    document.update(more)
    verdict = verify(document, cell)
    assert verdict.status is Status.NOT_PROVEN
    assert any(each.name == name and each.detail.startswith("not covered: ") for each in verdict.open)


def test_a_plan_of_another_cell_is_refused():
    document, _ = document_of(*planned("joint"))
    with pytest.raises(NotAPlan, match="another cell"):
        verify(document, problems.cell("ur3e-sim"))


@pytest.mark.parametrize(("name", "limit"), [("min_elevation_rad", np.pi / 2), ("max_elevation_rad", -np.pi / 2)])
def test_a_throw_beside_the_vertical_that_was_asked_for_is_violated(name: str, limit: float):
    document, cell = document_of(*planned("target"))
    document["request"]["release"][name] = limit
    assert verify(document, cell).status is Status.VIOLATED


@pytest.mark.parametrize(
    "changes",
    [
        {"request": None},
        {"request": {"release": None}},
        {"request": {"frame": "BASE"}},
        {"request": {"landing_tolerance_m": float("nan")}},
        {"request": {"landing_tolerance_m": -1.0}},
        {"request": {"release_window_s": -0.1}},
        {"request": {"release_window_s": float("inf")}},
        {"request": {"release_window_s": 0.201}},
        {"request": {"limits": {"velocity": "3"}}},
        {"request": {"limits": []}},
        {"request": {"limits": False}},
        {"request": {"start": []}},
        {"request": {"start": False}},
        {"request": {"start": ""}},
        {"request": {"release": {**THROW, "max_release_speed_m_s": -5.0}}},
        {"request": {"release": {**THROW, "min_elevation_rad": float("nan")}}},
        {"request": {"release": {**THROW, "opening": {}}}},
        {"request": {"release": {**THROW, "opening": {"radius_m": -0.12, "rim_height_m": 0.1}}}},
        {"request": {"release": {**THROW, "position": []}}},
        {"request": {"release": {**THROW, "release_position": [1.0]}}},
        {"request": {"release": {**THROW, "release_position": [0.4, "0", 0.5]}}},
        {"request": {"release": {**THROW, "min_elevation_rad": "0"}}},
        {"request": {"release": {**THROW, "max_elevation_rad": {}}}},
        {"request": {"release": {**THROW, "max_elevation_rad": True}}},
        {"sample_rate_hz": float("inf")},
    ],
)
def test_what_no_request_can_say_switches_no_check_off(changes: dict[str, Any]):
    document, cell = document_of(*planned("target"))
    asked = changes.pop("request", {})
    document["request"] = None if asked is None else {**document["request"], **asked}
    document.update(changes)
    with pytest.raises(NotAPlan):
        verify(document, cell)


@pytest.mark.parametrize("document", [None, [], "plan", 1.0])
def test_what_is_no_mapping_is_no_plan(document: Any):
    with pytest.raises(NotAPlan, match="no mapping"):
        verify(document, problems.cell())


def test_a_release_between_two_samples_is_no_release():
    document, cell = document_of(*planned("target"))
    document["release"]["index"] += 0.9
    with pytest.raises(NotAPlan):
        verify(document, cell)


def test_positions_that_shake_within_the_rounding_of_samples_are_no_motion():
    document, cell = document_of(*planned("joint"))
    for k, row in enumerate(document["trajectory"]["positions"][10:-10]):
        row[0] += 9.5e-7 * (-1) ** k
    assert verify(document, cell).status is Status.VIOLATED


def test_samples_that_are_not_numbers_are_refused():
    document, cell = document_of(*planned("joint"))
    document["trajectory"]["positions"][3][0] = float("nan")
    with pytest.raises(NotAPlan, match="not finite"):
        verify(document, cell)


def test_a_certificate_that_looks_at_samples_alone_is_found_out(monkeypatch: pytest.MonkeyPatch):
    problem, trajectory = planned("every limit")
    true_peaks = np.abs(trajectory.at(np.linspace(0.0, trajectory.duration_s, 40 * len(trajectory.q)))[1]).max(axis=0)
    at_samples = np.abs(trajectory.qd).max(axis=0)
    joint = int((true_peaks / at_samples).argmax())
    assert true_peaks[joint] > at_samples[joint] * (1.0 + 1e-5)
    limit = np.array(problem.limits.qd_max)
    limit[joint] = 0.5 * (true_peaks[joint] + at_samples[joint])
    tight = replace(problem, limits=replace(problem.limits, qd_max=limit))

    def of_samples(moved: Trajectory) -> np.ndarray:
        rows = [-moved.q, moved.q, abs(moved.qd), abs(moved.qdd), abs(moved.jerk), np.zeros_like(moved.q)]
        return np.array([[row.max(axis=0) for row in rows], [row.argmax(axis=0) for row in rows]])

    assert not certify(tight, trajectory).check("joint_velocity").ok
    monkeypatch.setattr("planner.certificate.joints._extremes", of_samples)
    assert certify(tight, trajectory).valid
    assert verify(*document_of(tight, trajectory)).status is Status.VIOLATED


def test_a_certificate_with_the_sign_of_a_clearance_turned_is_found_out(monkeypatch: pytest.MonkeyPatch):
    problem, trajectory = planned("joint")
    through = problems.tool_state(problem.cell, trajectory.q[100], trajectory.qd[100]).p_WT
    blocked = problems.with_boxes(problem.cell, (through - 0.03, through + 0.03))
    mutant = replace(problem, cell=blocked)
    assert not certify(mutant, trajectory).check("keep_out").ok
    from planner.certificate import clearance

    right = clearance.shape_distances
    monkeypatch.setattr(clearance, "shape_distances", lambda *given: 1.0 - right(*given))
    assert certify(mutant, trajectory).check("keep_out").ok
    found = verify(*document_of(mutant, trajectory))
    assert "keep_out" in {each.name for each in found.open if each.status is Status.VIOLATED}


def test_a_certificate_that_forgets_a_wall_is_found_out(monkeypatch: pytest.MonkeyPatch):
    problem, trajectory = planned("bin")
    assert isinstance(problem.release, TargetRelease)
    walled = replace(problem, release=replace(problem.release, opening=Opening(0.12, 0.45)))
    assert not certify(walled, trajectory).check("flight_clearance").ok
    monkeypatch.setattr(Flights, "opening", None)
    assert certify(walled, trajectory).valid
    verdict = verify(*document_of(walled, trajectory))
    assert "flight_clearance" in {each.name for each in verdict.open}


@pytest.mark.parametrize(("change", "status"), [("", 0), ("profile", 1), ("velocity", 2), ("learnt", 0)])
def test_the_command_tells_by_its_status(tmp_path: Path, root: Path, change: str, status: int):
    document, _ = document_of(*planned("joint"))
    document["cell_sha256"] = problems.cell().sha256
    for key in ("certificate", "flight", "solver", "id"):
        document[key] = {}
    more: list[str] = []
    if change in ("profile", "learnt"):
        document["profile"] = "ball"
    if change == "learnt":
        numbers = {"lag_s": 0.02, "delay_s": 0.04, "jitter_s": 0.0, "drag_coefficient": 0.0}
        profile = {"id": "ball", "cell_sha256": document["cell_sha256"], "speed_factor": 1.0, **numbers}
        (tmp_path / "profile.json").write_text(json.dumps(profile))
        more = ["--profile", str(tmp_path / "profile.json")]
    if change == "velocity":
        document["request"]["limits"]["velocity"] = [0.5] * 6
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(document))
    made = CliRunner().invoke(main, ["verify", str(file), "--cells", str(root / "cells"), *more])
    assert made.exit_code == status, made.output
    assert made.output.splitlines()[-1].startswith(["proven: ", "not proven: ", "violated: "][status])
    as_json = CliRunner().invoke(main, ["verify", str(file), "--cells", str(root / "cells"), *more, "--json"])
    assert json.loads(as_json.output)["status"] == ["proven", "not proven", "violated"][status]
