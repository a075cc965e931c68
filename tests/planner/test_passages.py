"""Passages in requests: what is refused by name, and the rows with which their outputs are switched."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.answer import plan_document, plan_from_document
from planner.approach import find_brakes
from planner.cell import cell_of_keys
from planner.errors import CellError, InvalidProblem
from planner.passages import OutputEdge, OutputSwitch, output_edges
from planner.planning import plan
from planner.request import problem_from_request
from planner.stream_rows import controller_program, sample_rows
from planner.trajectory import Trajectory
from tests.planner.problems import cell

JOINT = {"kind": "joint", "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1],
         "velocities": [1.2, 0.6, -0.6, 0.3, 0.5, 0.2]}  # fmt: skip
REST = {"kind": "joint", "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1], "velocities": [0.0] * 6}
TARGET = {"kind": "target", "position": [1.2, 0.3, 0.0]}
HERE = {"position": [0.5, -0.2, 0.3], "rotation_vector": [np.pi, 0.0, 0.0]}
THERE = {"position": [0.5, 0.2, 0.3], "rotation_vector": [np.pi, 0.0, 0.0]}
LINE = {"from": HERE, "to": THERE, "speed_m_s": 0.4}
FLASH = {"output": "standard_digital", "index": 2, "level": True}


def passage(name: str = "a", state: dict[str, Any] = JOINT, **fields: Any) -> dict[str, Any]:
    return {"name": name, "state": state, **fields}


def along(line: dict[str, Any] = LINE, **fields: Any) -> dict[str, Any]:
    return {"name": "a", "line": line, **fields}


def refusals(request: dict[str, Any]) -> dict[str, str]:
    """Returns the refused fields of a request with their reasons."""
    with pytest.raises(InvalidProblem) as refused:
        problem_from_request(request, cell())
    return {error.field: error.reason for error in refused.value.errors}


@pytest.mark.parametrize(
    ("request_", "field", "reason"),
    [
        ({}, "release", "is missing; or give passages"),
        ({"release": JOINT, "passages": [passage()]}, "release", "give either release or passages"),
        ({"release": JOINT, "end": {"kind": "home"}}, "end", "is for a motion of passages"),
        ({"passages": []}, "passages", "has 0 entries; it may have 1 to 20"),
        ({"passages": [passage(str(i)) for i in range(21)]}, "passages", "has 21 entries; it may have 1 to 20"),
        ({"passages": {}}, "passages", "must be a list, not an object"),
        ({"passages": [{"state": JOINT}]}, "passages[0].name", "is missing"),
        ({"passages": [passage(), passage()]}, "passages[1].name", "'a' is the name of another passage"),
        ({"passages": [passage(at_s=1.0, not_before_s=0.5)]}, "passages[0].not_before_s", "give either"),
        ({"passages": [passage(at_s=61.0)]}, "passages[0].at_s", "must be at most 60"),
        ({"passages": [passage("a", at_s=5.0), passage("b"), passage("c", at_s=3.0)]},
         "passages[2].at_s", "must be above 5, when 'a' before it is passed at the soonest; it is 3"),
        ({"passages": [along(not_before_s=2.0), passage("b", at_s=2.5)]},
         "passages[1].at_s", "must be above 3, when 'a' before it is passed"),
        ({"passages": [{"name": "a"}]}, "passages[0].state", "give either state or line"),
        ({"passages": [passage(line=LINE)]}, "passages[0].state", "give either state or line"),
        ({"passages": [along({"from": THERE})]}, "passages[0].line.to", "is missing"),
        ({"passages": [along(LINE | {"speed_m_s": 0.0})]}, "passages[0].line.speed_m_s", "must be above 0"),
        ({"passages": [along(LINE | {"to": {"position": [0.5, 0.0, 0.3]}})]}, "passages[0].line.to", "give quaternion"),
        ({"passages": [along(LINE | {"to": HERE})]}, "passages[0].line.to", "a line is 0.001 m or more"),
        ({"passages": [along(LINE | {"speed_m_s": 0.001})]}, "passages[0].line.speed_m_s", "would take 400 s"),
        ({"passages": [along(LINE | {"to": THERE | {"rotation_vector": [0.0, 0.0, 0.0]}})]},
         "passages[0].line.to", "is turned by 3.14 rad: which way round is open"),
        ({"passages": [along(releases=True)]}, "passages[0].releases", "a line lets nothing go"),
        ({"release": LINE | {"kind": "line"}}, "release.kind", "'line' is not one of"),
        ({"passages": [along(outputs=[FLASH | {"offset_m": 0.41}])]},
         "passages[0].outputs[0].offset_m", "the line ends after 0.4 m"),
        ({"passages": [along(outputs=[FLASH | {"offset_m": -0.01}])]},
         "passages[0].outputs[0].offset_m", "must be at least 0"),
        ({"passages": [along(outputs=[FLASH | {"offset_s": 0.25}, FLASH | {"offset_m": 0.1, "level": False}])]},
         "passages[0].outputs[1].offset_s", "0.25 s is less than a tick"),
        ({"passages": [passage(state=TARGET)]}, "passages[0].state.kind", "lets the object go"),
        ({"passages": [passage(state=REST, releases=True)]}, "passages[0].state", "nothing is thrown"),
        ({"passages": [passage("a", releases=True), passage("b", releases=True)]},
         "passages[1].releases", "'a' lets the object go already"),
        ({"passages": [passage(outputs=[FLASH | {"level": 1}])]},
         "passages[0].outputs[0].level", "must be true or false"),
        ({"passages": [passage(outputs=[FLASH | {"index": 2.5}])]}, "passages[0].outputs[0].index", "a whole number"),
        ({"passages": [passage(outputs=[FLASH | {"index": 8}])]}, "passages[0].outputs[0].index", "must be at most 7"),
        ({"passages": [passage(outputs=[{"output": "tool_digital", "index": 2, "level": True}])]},
         "passages[0].outputs[0].index", "2 is none of the 2 outputs of kind tool_digital"),
        ({"passages": [passage(outputs=[{"output": "tool_digital", "index": 0, "level": True}])]},
         "passages[0].outputs[0]", "is the gripper's own output"),
        ({"passages": [passage(outputs=[FLASH, FLASH | {"level": False}])]},
         "passages[0].outputs[1].offset_s", "0 s is less than a tick of 2 ms from another edge of this output"),
        ({"passages": [passage(outputs=[FLASH, FLASH | {"level": False, "offset_s": 0.0009}])]},
         "passages[0].outputs[1].offset_s", "0.0009 s is less than a tick of 2 ms from another edge"),
        ({"passages": [passage(outputs=[FLASH | {"offset_m": 0.1}])]},
         "passages[0].outputs[0].offset_m", "a state has no length: give offset_s"),
        ({"passages": [passage(outputs=[FLASH | {"offset_s": 3.0}])]},
         "passages[0].outputs[0].offset_s", "must be at most 2"),
        ({"passages": [passage()], "end": {"kind": "line"}}, "end.kind", "is not one of rest, home, joint, pose"),
        ({"passages": [passage()], "start": {"execution": "x", "at_s": 0.1}},
         "start.execution", "needs a service with an executor"),
        ({"passages": [passage()], "min_hit_probability": 0.5}, "min_hit_probability", "have nothing to hit"),
    ],
)  # fmt: skip
def test_what_is_refused_is_named(request_: dict[str, Any], field: str, reason: str) -> None:
    found = refusals(request_)
    assert reason in found.get(field, ""), found


def test_states_of_passages_are_checked_as_releases_are() -> None:
    wide = {"radius_m": 0.01, "rim_height_m": 0.1}
    found = refusals({"passages": [passage(state=TARGET | {"opening": wide}, releases=True)]})
    assert "too narrow" in found["passages[0].state.opening.radius_m"]


def test_states_are_in_the_frame_of_the_request() -> None:
    here = cell_of_keys({"robot": "ur5e", "link": {"kind": "sim"}, "base_in_world": {"position_m": [0.0, 0.0, 0.5]}})
    state = {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.6]}
    request = {"passages": [passage(state=state)], "frame": "base", "end": {"kind": "home"}}
    problem = problem_from_request(request, here)
    assert problem.passages[0].state.point_state.p_WT == pytest.approx([0.5, 0.2, 1.1])  # pyright: ignore[reportOptionalMemberAccess]


LISTED = {
    "flash": {"output": "standard_digital", "index": 2, "delay_s": 0.006, "jitter_s": 0.001, "sense_input": 5},
}


def test_a_cell_lists_outputs_with_their_delays() -> None:
    keys = {"robot": "ur5e", "link": {"kind": "sim"}, "timing": {"lag_s": 0.02}, "outputs": LISTED}
    here = cell_of_keys(keys)
    assert here.digital_output("standard_digital", 2) == here.outputs["flash"]
    assert vars(here.outputs["flash"]) == LISTED["flash"]
    assert here.digital_output("standard_digital", 3).delay_s == 0.0
    sooner = {"output": "standard_digital", "index": 2, "delay_s": -0.016}
    assert cell_of_keys(keys | {"outputs": {"flash": sooner}}).outputs["flash"].delay_s == -0.016
    assert here.as_document()["outputs"] == LISTED
    for name, wrong, field in (
        ("flash", {"output": "standard_digital", "index": 8}, "outputs.flash.index"),
        ("flash", {"output": "standard", "index": 1}, "outputs.flash.output"),
        ("flash", {"output": "standard_digital", "index": 1, "delay_s": 0.6}, "outputs.flash.delay_s"),
        ("flash", {"output": "standard_digital", "index": 1, "delay_s": -0.021}, "outputs.flash.delay_s"),
        ("flash", {"output": "standard_digital", "index": 1, "jitter_s": 1.0}, "outputs.flash.jitter_s"),
        ("flash", {"output": "standard_digital", "index": 1, "sense_input": 18}, "outputs.flash.sense_input"),
        ("flash", {"output": "standard_digital", "index": 1, "sensed": 5}, "outputs.flash.sensed"),
        ("other", {"output": "standard_digital", "index": 1, "sense_input": 5}, "outputs.other.sense_input"),
        ("other", {"output": "standard_digital", "index": 2}, "outputs.other.index"),
    ):
        with pytest.raises(CellError) as refused:
            cell_of_keys(keys | {"outputs": LISTED | {name: wrong}})
        assert refused.value.field == field


def test_a_plan_says_when_its_outputs_are_commanded_and_read_back_is_the_same() -> None:
    here = cell()
    here = cell_of_keys({**here.document, "name": here.name, "outputs": LISTED})
    switches = [FLASH | {"offset_s": -0.01}, {"output": "standard_digital", "index": 3, "level": False}]
    request = {"passages": [passage("flash", outputs=switches)], "end": {"kind": "home"}}
    found = plan(problem_from_request(request, here))
    document = plan_document(found, request, "", "")
    assert document["release"] is None
    assert document["release_time_s"] is None
    assert document["flight"] is None
    (passed,) = document["passages"]
    assert passed["time_s"] == passed["index"] / 500.0
    lag_s = here.timing.lag_s
    early, late = passed["outputs"]
    assert early["edge_time_s"] == pytest.approx(passed["time_s"] - 0.01)
    assert early["command_time_s"] == pytest.approx(early["edge_time_s"] - 0.006 - lag_s)
    assert late["command_time_s"] == pytest.approx(passed["time_s"] - lag_s)
    problem, motion = plan_from_document(document, here)
    assert motion.passed == found.trajectory.passed
    assert problem.passages[0].outputs == found.problem.passages[0].outputs


def standing(index: int, ticks: int = 400) -> Trajectory:
    """Returns an arm at rest at home, with a passage at a sample."""
    home = np.tile(cell().home, (ticks + 1, 1))
    zero = np.zeros_like(home)
    return Trajectory(500.0, home, zero, zero, release_index=index, passage_indices=(index,))


@pytest.mark.parametrize("offset_s", [-2.0, -0.0123, 0.0, 0.5, 2.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.0203])
def test_outputs_are_switched_with_the_nearest_row(offset_s: float, lag_s: float) -> None:
    """Also long before the motion begins, and long after its end; the first one's command is exact."""
    here = cell()
    here = replace(here, timing=replace(here.timing, lag_s=lag_s))
    first = FLASH | {"offset_s": offset_s}
    request = {"passages": [passage(outputs=[first, FLASH | {"index": 3, "offset_s": 0.0007}])]}
    problem = problem_from_request(request, here)
    motion = standing(150)
    edges = output_edges(here, problem.passages, motion)
    rows = sample_rows(here, motion, False, edges)
    assert len(rows.switches) == 2
    for number, (switch, edge) in enumerate(zip(rows.switches, edges, strict=True)):
        row = switch.row
        assert 0 <= row < len(rows.q)
        happens_s = rows.first_clock_s + row * motion.dt
        assert abs(happens_s - edge.edge_time_s) <= (1e-9 if number == 0 else 0.5 * motion.dt + 1e-9)
    assert rows.first_clock_s <= -lag_s


@pytest.mark.parametrize("lag_s", [0.0, 0.021, 0.0203])
def test_a_pulse_of_one_tick_has_two_rows(lag_s: float) -> None:
    """Also where the edges fall in the middle between two rows, and either row is the nearest."""
    here = replace(cell(), timing=replace(cell().timing, lag_s=lag_s))
    first = FLASH | {"index": 3, "offset_s": -0.1}
    for offset_s in (0.0, 0.001, 0.003, 0.0507):
        pulse = [FLASH | {"offset_s": offset_s}, FLASH | {"level": False, "offset_s": offset_s + 0.002}]
        problem = problem_from_request({"passages": [passage(outputs=[first, *pulse])]}, here)
        motion = standing(150)
        _, on, off = sample_rows(here, motion, False, output_edges(here, problem.passages, motion)).switches
        assert (on.level, off.level) == (True, False)
        assert on.row < off.row <= on.row + 2


def test_outputs_are_in_the_order_of_their_rows() -> None:
    """An edge that is moved on to a row of its own does not end up behind what follows it."""
    here = cell()
    tick_s = 1.0 / here.robot.sample_rate_hz
    moved = 0
    for ticks in range(50):
        at_s = [tick_s * (ticks + k) for k in (0.0, 1.5, 2.5, 2.5)]
        lines = [(0, True), (1, True), (1, False), (2, True)]
        edges = [
            OutputEdge(0, OutputSwitch("standard_digital", index, level), t - here.timing.lag_s, t)
            for t, (index, level) in zip(at_s, lines, strict=True)
        ]
        rows = [each.row for each in sample_rows(here, standing(100), False, edges).switches]
        assert rows == sorted(rows)
        moved += rows[2] == rows[1] + 1
    assert moved > 0


def test_a_program_of_the_controller_switches_outputs_at_their_rows_and_ends_that_in_a_stop() -> None:
    here = cell()
    switches = [FLASH, FLASH | {"level": False, "offset_s": 0.1}, FLASH | {"index": 3, "offset_s": 0.2}]
    problem = problem_from_request({"passages": [passage(outputs=switches)]}, here)
    motion = standing(150)
    rows = sample_rows(here, motion, False, output_edges(here, problem.passages, motion))
    program = controller_program(here, rows, find_brakes(here, rows.q, rows.qd, rows.qdd, motion.dt))
    lines = program.text(None).splitlines()
    follows = [i for i, line in enumerate(lines) if line.startswith("  follow(")]
    first, second, third = (switch.row for switch in rows.switches)
    assert lines[follows[first] - 4 : follows[first]] == [
        "  if not braking:",
        "    set_standard_digital_out(2, True)",
        "    ends_standard_digital_2 = True",
        "  end",
    ]
    assert lines[follows[second] - 3 : follows[second] - 1] == [
        "    set_standard_digital_out(2, False)",
        "    ends_standard_digital_2 = False",
    ]
    assert lines[follows[third] - 2] == "    set_standard_digital_out(3, True)"
    assert lines.count("  global ends_standard_digital_2 = False") == 1
    stop = lines.index("    if ends_standard_digital_2:")
    assert lines[stop + 1] == "      set_standard_digital_out(2, False)"
    assert sum(line == lines[stop] for line in lines) == 2  # where it gives up, and where it brakes
