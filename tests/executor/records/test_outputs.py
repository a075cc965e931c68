"""What is recorded of the outputs of passages: each edge by its own change, and what a stop switched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.records.outputs import output_warnings, switched_outputs
from executor.records.telemetry import RunResult
from executor.shared_memory import ROW, SCALARS
from planner.cell import DigitalOutput
from planner.controller_program import SwitchRow
from planner.passages import OutputSwitch, Passage, output_edges
from planner.problem import ThrowProblem
from tests.executor.conftest import Prepared

LINE = ("standard_digital", 3)
PULSE_S = 0.1
SENSE = 9  # input


def pulsed(prepared: Prepared, pulses: int) -> ThrowProblem:
    """Returns a problem with pulses of an output after its passage."""
    edges = [(number % 2 == 0, number * PULSE_S) for number in range(2 * pulses)]
    switches = tuple(OutputSwitch(*LINE, level, offset_s) for level, offset_s in edges)
    return replace(prepared.problem, passages=(Passage("a", prepared.problem.release, switches, True),))


def result(clock: np.ndarray, on: np.ndarray, switched_s: list[float], sensed: np.ndarray | None = None) -> RunResult:
    """Returns the end of a run in which the output, and the input that senses it, were on at some of the times [s]."""
    rows = np.zeros((len(clock), ROW.size // 8))
    rows[:, SCALARS.index("clock_s")] = clock
    rows[:, SCALARS.index("digital_outputs")] = on * (1 << LINE[1])
    if sensed is not None:
        rows[:, SCALARS.index("digital_inputs")] = sensed * (1 << SENSE)
    return RunResult("aborted", "", rows, 0, True, None, 0.0, 0.0, True, switched_s=tuple(switched_s))


def test_a_later_pulse_is_not_taken_for_one_that_was_missed(prepared: Prepared) -> None:
    problem = pulsed(prepared, 2)
    edges = output_edges(problem.cell, problem.passages, prepared.trajectory)
    clock = np.arange(0.0, edges[-1].edge_time_s + 0.1, prepared.trajectory.dt)
    second = (clock >= edges[2].edge_time_s) & (clock < edges[3].edge_time_s)
    ended = result(clock, second, [edge.command_time_s for edge in edges])
    found = [each["edge_time_s"] for each in switched_outputs(problem, prepared.trajectory, ended)]
    assert found[:2] == [None, None]
    assert found[2:] == pytest.approx([edge.edge_time_s for edge in edges[2:]], abs=prepared.trajectory.dt)


def test_what_a_stop_switched_is_recorded(prepared: Prepared) -> None:
    problem = pulsed(prepared, 1)
    edges = output_edges(problem.cell, problem.passages, prepared.trajectory)
    clock = np.arange(0.0, edges[-1].edge_time_s, prepared.trajectory.dt)
    stopped_s = edges[0].edge_time_s + 0.5 * PULSE_S
    on = (clock >= edges[0].edge_time_s) & (clock < stopped_s + 0.01)
    ended = result(clock, on, [edges[0].command_time_s, float("nan")])
    ended = replace(ended, stop_levels=[SwitchRow(0, *LINE, False)], stopped_s=stopped_s)
    planned, unsent, stop = switched_outputs(problem, prepared.trajectory, ended)
    assert planned["passage"] == "a" and planned["edge_time_s"] is not None
    assert unsent["command_time_s"] is None
    assert (stop["passage"], stop["index"], stop["level"], stop["command_time_s"]) == (None, 3, False, stopped_s)
    assert stop["edge_time_s"] == pytest.approx(stopped_s + 0.01, abs=prepared.trajectory.dt)


@pytest.mark.parametrize("sense_input", [None, SENSE])
def test_what_happens_after_the_output_is_seen_by_its_input_alone(prepared: Prepared, sense_input: int | None) -> None:
    dt = prepared.trajectory.dt
    delay_s = 4.0 * dt
    late = DigitalOutput(*LINE, delay_s, sense_input=sense_input)
    problem = pulsed(prepared, 1)
    problem = replace(problem, cell=replace(problem.cell, outputs={"valve": late}))
    edges = output_edges(problem.cell, problem.passages, prepared.trajectory)
    clock = np.arange(0.0, edges[-1].edge_time_s + 0.1, dt)
    on = (clock >= edges[0].edge_time_s - delay_s) & (clock < edges[1].edge_time_s - delay_s)
    sensed = (clock >= edges[0].edge_time_s) & (clock < edges[1].edge_time_s)
    sent = [edge.command_time_s for edge in edges]
    found = switched_outputs(problem, prepared.trajectory, result(clock, on, sent, sensed))
    early_s = delay_s if sense_input is None else 0.0
    for each, edge in zip(found, edges, strict=True):
        assert each["sense_input"] == sense_input
        assert each["edge_after_s"] == pytest.approx(each["edge_time_s"] - dt)
        assert each["edge_after_s"] < edge.edge_time_s - early_s <= each["edge_time_s"] + 1e-9
        assert each["edge_late_s"] == pytest.approx(each["edge_time_s"] - edge.edge_time_s)
    assert output_warnings(found, problem) == []
    much_later = [each | {"edge_late_s": each["edge_late_s"] + 3.0 * dt} for each in found]
    assert len(output_warnings(much_later, problem)) == (0 if sense_input is None else 2)
    much_sooner = [each | {"edge_late_s": each["edge_late_s"] - 3.0 * dt} for each in found]
    assert len(output_warnings(much_sooner, problem)) == 2
