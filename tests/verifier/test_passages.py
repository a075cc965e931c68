"""Certified motions of passages are proven; of those with a fault in a passage, a line, a time or an output, none."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.proofs import document_of
from planner.geometry import tool_state
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from tests.planner import problems
from verifier import NotAPlan, Status, findings, verify

DOWN = [math.pi, 0.0, 0.0]
VALVE = {"output": "standard_digital", "index": 3}
PASSED = [
    {
        "name": "joint",
        "state": {
            "kind": "joint",
            "positions": [0.1, -1.6, 1.7, -1.6, -1.5, 0.1],
            "velocities": [0.3, 0.2, 0.0, 0.0, -0.2, 0.1],
        },
        "not_before_s": 0.6,
    },
    {
        "name": "pose",
        "state": {
            "kind": "pose",
            "pose": {"position": [0.5, -0.2, 0.35], "rotation_vector": DOWN},
            "twist": {"linear": [0.0, 0.4, 0.0], "angular": [0.0, 0.0, 0.0]},
        },
        "outputs": [{**VALVE, "index": 2, "level": True, "offset_s": -0.02}],
    },
    {
        "name": "bead",
        "line": {
            "from": {"position": [0.5, -0.1, 0.3], "rotation_vector": DOWN},
            "to": {"position": [0.5, 0.1, 0.3], "rotation_vector": [3.0, 0.1, 0.3]},
            "speed_m_s": 0.3,
        },
        "outputs": [{**VALVE, "level": True, "offset_m": 0.02}, {**VALVE, "level": False, "offset_m": 0.18}],
    },
    {"name": "point", "state": {"kind": "point", "position": [0.45, 0.3, 0.4], "velocity": [0.0, 0.2, 0.2]}},
]
THROW = {"name": "throw", "state": {"kind": "target", "position": [1.1, 0.3, 0.0]}, "releases": True, "at_s": 2.5}


@cache
def planned(name: str) -> tuple[ThrowProblem, Trajectory]:
    """Motions of passages, and one that throws at their end."""
    request: dict[str, Any] = {"passages": PASSED, "end": {"kind": "home"}}
    if name == "throw":
        request = {"passages": [PASSED[1], THROW]}
    problem = problem_from_request(request, problems.cell())
    return problem, plan(problem).trajectory


@pytest.mark.parametrize("name", ["passed", "throw"])
def test_a_certified_motion_of_passages_is_proven(name: str):
    verdict = verify(*document_of(*planned(name)))
    assert verdict.status is Status.PROVEN, list(map(str, verdict.open))
    assert {"passage", "singularity_distance"} <= {finding.name for finding in verdict.findings}


def shifted(value: list[float], by: float) -> list[float]:
    """A vector that is longer by so much along its first axis."""
    return [value[0] + by, *value[1:]]


def asked(document: dict[str, Any], name: str) -> dict[str, Any]:
    """A passage of a document's request."""
    return next(each for each in document["request"]["passages"] if each["name"] == name)


def told(document: dict[str, Any], name: str) -> dict[str, Any]:
    """A passage of a document."""
    return next(each for each in document["passages"] if each["name"] == name)


def joint_off(document: dict[str, Any]) -> None:
    state = asked(document, "joint")["state"]
    state["positions"] = shifted(state["positions"], 1e-3)


def joint_too_fast(document: dict[str, Any]) -> None:
    state = asked(document, "joint")["state"]
    state["velocities"] = shifted(state["velocities"], 0.003)


def pose_off(document: dict[str, Any]) -> None:
    pose = asked(document, "pose")["state"]["pose"]
    pose["position"] = shifted(pose["position"], 1e-3)


def pose_turned(document: dict[str, Any]) -> None:
    pose = asked(document, "pose")["state"]["pose"]
    pose.pop("quaternion", None)
    pose["rotation_vector"] = [math.pi, 0.0, 2e-3]


def pose_spins(document: dict[str, Any]) -> None:
    twist = asked(document, "pose")["state"]["twist"]
    twist["angular"] = shifted(twist["angular"], 0.002)


def point_off(document: dict[str, Any]) -> None:
    state = asked(document, "point")["state"]
    state["position"] = shifted(state["position"], 1e-3)


def point_too_fast(document: dict[str, Any]) -> None:
    state = asked(document, "point")["state"]
    state["velocity"] = shifted(state["velocity"], 0.002)


def line_ends_elsewhere(document: dict[str, Any]) -> None:
    end = asked(document, "bead")["line"]["to"]
    end["position"] = shifted(end["position"], 1e-3)


def line_ends_turned(document: dict[str, Any]) -> None:
    line = asked(document, "bead")["line"]
    line["to"] = {"position": line["to"]["position"], "rotation_vector": [3.0, 0.1, 0.301]}


def line_too_fast(document: dict[str, Any]) -> None:
    asked(document, "bead")["line"]["speed_m_s"] *= 1.001


def line_ends_a_tick_early(document: dict[str, Any]) -> None:
    told(document, "bead")["end_index"] -= 1


def line_begins_a_tick_late(document: dict[str, Any]) -> None:
    for key in ("index", "end_index"):
        told(document, "bead")[key] += 1


def state_a_tick_late(document: dict[str, Any]) -> None:
    for key in ("index", "end_index"):
        told(document, "point")[key] += 1


def too_early(document: dict[str, Any]) -> None:
    asked(document, "joint")["not_before_s"] = (told(document, "joint")["index"] + 1) / document["sample_rate_hz"]


def off_its_time(document: dict[str, Any]) -> None:
    passage = asked(document, "pose")
    passage["at_s"] = (told(document, "pose")["index"] + 1) / document["sample_rate_hz"]


def edge_a_tick_late(document: dict[str, Any]) -> None:
    for key in ("edge_time_s", "command_time_s"):
        told(document, "bead")["outputs"][1][key] += 1.0 / document["sample_rate_hz"]


def commanded_a_tick_late(document: dict[str, Any]) -> None:
    told(document, "pose")["outputs"][0]["command_time_s"] += 1.0 / document["sample_rate_hz"]


def edges_within_a_tick(document: dict[str, Any]) -> None:
    asked_, told_ = (find(document, "bead")["outputs"] for find in (asked, told))
    asked_[1]["offset_m"] = asked_[0]["offset_m"] + 0.3 * 0.001
    for key in ("edge_time_s", "command_time_s"):
        told_[1][key] = told_[0][key] + 0.001


def switches_no_output(document: dict[str, Any]) -> None:
    for passage in (asked(document, "bead"), told(document, "bead")):
        passage["outputs"][0]["index"] = 99


def opens_the_gripper(document: dict[str, Any]) -> None:
    for passage in (asked(document, "bead"), told(document, "bead")):
        passage["outputs"][0].update(output="tool_digital", index=0)


def ends_elsewhere(document: dict[str, Any]) -> None:
    document["request"]["end"] = {"kind": "joint", "positions": shifted(list(problems.cell().home), 1e-3)}


FAULTS: list[Callable[[dict[str, Any]], None]] = [
    *(joint_off, joint_too_fast, pose_off, pose_turned, pose_spins, point_off, point_too_fast),
    *(line_ends_elsewhere, line_ends_turned, line_too_fast, line_ends_a_tick_early, line_begins_a_tick_late),
    *(state_a_tick_late, too_early, off_its_time, edge_a_tick_late, commanded_a_tick_late, edges_within_a_tick),
    *(switches_no_output, opens_the_gripper, ends_elsewhere),
]


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_in_a_passage_is_violated(fault: Callable[[dict[str, Any]], None]):
    document, cell = document_of(*planned("passed"))
    document = copy.deepcopy(document)
    fault(document)
    found = [each for each in findings(document, cell) if each.status is Status.VIOLATED]
    assert "passage" in {each.name for each in found}, list(map(str, found))


@pytest.mark.parametrize(
    ("fault", "status"), [(commanded_a_tick_late, Status.NOT_PROVEN), (edge_a_tick_late, Status.VIOLATED)]
)
def test_when_an_output_is_commanded_is_open_without_the_profile_alone(
    fault: Callable[[dict[str, Any]], None], status: Status
):
    document, cell = document_of(*planned("passed"))
    document = {**copy.deepcopy(document), "profile": "learnt"}
    fault(document)
    found = list(findings(document, cell))
    assert {each.status for each in found if each.name == "passage"} == {Status.PROVEN} | {status} - {Status.NOT_PROVEN}
    assert [each.status for each in found if each.name == "command_time"] == [Status.NOT_PROVEN]


@pytest.mark.parametrize(("off_m", "open_checks"), [(0.95e-5, []), (1.01e-5, ["passage"])])
def test_a_line_off_by_its_tolerance_and_a_hundredth_is_not_proven(off_m: float, open_checks: list[str]):
    problem, trajectory = planned("passed")
    document, cell = document_of(problem, trajectory)
    line = asked(document, "bead")["line"]
    bead = told(document, "bead")
    apart = 0.0
    for index in range(bead["index"], bead["end_index"] + 1):  # at samples: between them it is no less
        p_WT = tool_state(problem.cell, trajectory.q[index], trajectory.qd[index]).p_WT
        apart = max(apart, p_WT[0] - line["from"]["position"][0])  # it leads along y
    for end in ("from", "to"):
        line[end]["position"] = shifted(line[end]["position"], apart - off_m)
    found = [each for each in findings(document, cell) if each.status is not Status.PROVEN]
    assert [each.name for each in found] == open_checks, list(map(str, found))


@pytest.mark.slow
def test_a_limit_exceeded_by_a_hundredth_between_samples_is_not_proven():
    problem, trajectory = planned("passed")
    document, cell = document_of(problem, trajectory)
    between = trajectory.at(np.linspace(0.0, trajectory.duration_s, 40 * len(trajectory.q)))[1]
    peaks = np.abs(between).max(axis=0)
    for joint in range(6):
        limits = np.array(problem.limits.qd_max)
        limits[joint] = peaks[joint] / 1.01
        document["request"]["limits"]["velocity"] = limits.tolist()
        assert verify(document, cell).status is Status.VIOLATED


def test_an_object_let_go_at_another_sample_is_violated():
    document, cell = document_of(*planned("throw"))
    document["release"]["index"] += 1
    found = [each for each in findings(document, cell) if each.status is Status.VIOLATED]
    assert "passage" in {each.name for each in found}


@pytest.mark.parametrize("short_rad", [0.0, 1e-9, 4e-4])
def test_a_line_that_turns_by_half_a_turn_is_no_request(short_rad: float):
    """Half a turn about x, as the axis of a turn without a sine would be taken to be, from the line's begin."""
    document, cell = document_of(*planned("passed"))
    document = copy.deepcopy(document)
    line = asked(document, "bead")["line"]
    line["to"] = {"position": line["to"]["position"], "rotation_vector": [short_rad, 0.0, 0.0]}
    with pytest.raises(NotAPlan, match=r"passages\[2\].line.to: is turned by half a turn: which way round is open"):
        verify(document, cell)
    line["to"]["rotation_vector"] = [1e-3, 0.0, 0.0]
    assert "passage" in {each.name for each in findings(document, cell) if each.status is Status.VIOLATED}


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("passages"),
        lambda d: d["passages"].pop(),
        lambda d: told(d, "bead").update(name="other"),
        lambda d: told(d, "bead").update(index=1.5),
        lambda d: told(d, "bead").update(end_index=10**6),
        lambda d: told(d, "bead")["outputs"].pop(),
        lambda d: told(d, "bead")["outputs"][0].update(level=False),
        lambda d: told(d, "bead")["outputs"][0].update(command_time_s=float("nan")),
        lambda d: told(d, "bead")["outputs"][0].update(edge_time_s="0.5"),
        lambda d: asked(d, "pose")["state"]["pose"].update(quaternion=[0, 0, 1]),
        lambda d: asked(d, "pose")["state"]["pose"].update(quaternion=[0, 0, 0, 0]),
        lambda d: asked(d, "joint")["state"]["positions"].__setitem__(0, 10**400),
        lambda d: asked(d, "joint").update(at_s=10**400),
        lambda d: asked(d, "bead").update(state=PASSED[0]["state"]),
        lambda d: asked(d, "bead")["line"].update(speed_m_s=0.0),
        lambda d: asked(d, "bead")["line"].update(speed_m_s=float("nan")),
        lambda d: asked(d, "bead")["line"]["to"].update(asked(d, "bead")["line"]["from"]),
        lambda d: asked(d, "joint").update(at_s=-1.0),
        lambda d: asked(d, "joint").update(state=THROW["state"]),
        lambda d: asked(d, "joint").update(name="point"),
        lambda d: d["request"].update(end={"kind": "somewhere"}),
        lambda d: d["request"].update(end={"kind": "joint", "positions": [0.0]}),
    ],
)
def test_what_no_document_of_passages_can_say_is_refused(change: Callable[[dict[str, Any]], None]):
    document, cell = document_of(*planned("passed"))
    document = copy.deepcopy(document)
    change(document)
    with pytest.raises(NotAPlan):
        verify(document, cell)
