from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from learning import calibration_moves
from planner.cell import Cell, DigitalOutput, load_cell
from planner.passages import output_edges
from planner.planning import plan
from planner.request import problem_from_request
from tests.api.conftest import ROOT


@pytest.fixture
def cell() -> Cell:
    return load_cell(ROOT / "cells" / "ur5e-sim.toml")


def test_motions_are_about_home_and_halved_until_no_lag_would_show(cell: Cell):
    moves = calibration_moves(cell, 2)
    assert len(moves["motions"]) == 4
    signs = []
    for requests in moves["motions"]:
        turns = [np.array(request["release"]["positions"]) - cell.home for request in requests]
        assert [np.abs(turn).max() for turn in turns] == pytest.approx([0.25, 0.125, 0.0625, 0.03125])
        assert all(np.ptp(np.abs(turn)) < 1e-12 for turn in turns)  # every joint moves
        assert all(request["release"]["velocities"] == [0.0] * 6 for request in requests)
        signs.append(np.sign(turns[0]))
    for first, second in itertools.combinations(range(6), 2):
        products = {float(sign[first] * sign[second]) for sign in signs}
        assert products == {-1.0, 1.0}, (first, second)  # not always alike, nor opposed


def test_throws_go_all_around_the_base_wherever_it_stands(cell: Cell):
    X_WB = cell.X_WB.copy()
    X_WB[:3, 3] = (0.4, -0.3, 0.7)
    moves = calibration_moves(replace(cell, X_WB=X_WB), 8)
    places = [request["release"]["position"] for request in moves["throws"]]
    assert len(places) == 40
    assert {place[2] for place in places} == {cell.surroundings.floor_z_m}
    distances = [math.hypot(x - 0.4, y + 0.3) for x, y, _ in places]
    near, far = moves["reach_m"]
    assert near <= min(distances) <= max(distances) <= far
    quadrants = {(x > 0.4, y > -0.3) for x, y, _ in places[:8]}
    assert len(quadrants) == 4
    assert all(request["release_window_s"] == 0.0 for request in moves["throws"])


def test_every_output_with_an_input_is_switched_about_a_passage_of_its_own(cell: Cell):
    assert calibration_moves(cell, 2)["outputs"] == []
    wired = {f"{i}": DigitalOutput("standard_digital", i, sense_input=i) for i in range(3)}
    there = replace(cell, outputs={**wired, "other": DigitalOutput("tool_digital", 1)})
    longest, *others = calibration_moves(there, 2)["outputs"]
    assert len(others) == 3
    assert [each["name"] for each in longest["passages"]] == ["0", "1", "2"]
    edges = [output for each in longest["passages"] for output in each["outputs"]]
    assert [(edge["index"], edge["level"]) for edge in edges] == [(i, k % 2 == 0) for i in range(3) for k in range(8)]
    found = plan(problem_from_request(longest, there))
    assert found.certificate.valid
    commands = [edge.command_time_s for edge in output_edges(there, found.problem.passages, found.trajectory)]
    assert min(np.diff(commands)) > 0.0  # a controller might take one package of a kind in a cycle
