"""Targets behind a wall and in a bin, planned whole; their flights are sampled here, apart from filter and rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box
from planner.flight import path
from planner.geometry import tool_state
from planner.planning import Plan, plan
from planner.problem import Opening, TargetRelease, ThrowProblem
from tests.planner.problems import cell

WALL = Box(np.array([0.8, -0.6, 0.0]), np.array([0.85, 0.6, 0.7]))
BIN = Opening(0.1, 0.2)


def problem(*boxes: Box, opening: Opening | None = None, **changes) -> ThrowProblem:
    here = cell()
    here = replace(here, surroundings=replace(here.surroundings, keep_out=boxes))
    release = TargetRelease(np.array([1.15, 0.1, 0.1]), opening=opening)
    return ThrowProblem(here, here.home, release, here.limits, time_limit_s=60.0, **changes)


def flights(made: Plan) -> list[np.ndarray]:
    """The object's centres every millisecond, released as planned and at both ends of the window."""
    asked = made.problem
    motion = made.trajectory
    arcs = []
    for delay in {-asked.release_window_s, 0.0, asked.release_window_s}:
        q, qd, _ = motion.at(np.array([motion.release_time_s + delay]))
        tool = tool_state(asked.cell, q[0], qd[0])
        x = path(tool.p_WT, tool.v_WT, np.arange(0.0, 2.0, 0.001), asked.gravity)
        arcs.append(x[: int(np.argmax((x[:, 2] < asked.plane_z) & (np.gradient(x[:, 2]) < 0.0)))])
    return arcs


@pytest.mark.parametrize("window", [{}, {"release_window_s": 0.005, "landing_tolerance_m": 0.02}])
def test_a_throw_over_a_wall(window: dict[str, float]) -> None:
    made = plan(problem(WALL, **window))
    for x in flights(made):
        assert np.linalg.norm(x - np.clip(x, WALL.lower, WALL.upper), axis=1).min() >= 0.02
    assert made.backend == "casadi"


def test_a_throw_over_a_high_wall_beside_the_arm_that_few_postures_allow() -> None:
    """It was refused: of the postures in between from which it can be thrown, two of five lead to it."""
    wall = Box(np.array([0.75, -1.5, 0.0]), np.array([0.8, 1.5, 0.9]))
    release = TargetRelease(np.array([0.9589108997592303, -0.05489270218509734, 0.0]))
    asked = replace(problem(wall), release=release, release_window_s=0.005, landing_tolerance_m=0.02)
    for x in flights(plan(asked)):
        assert np.linalg.norm(x - np.clip(x, wall.lower, wall.upper), axis=1).min() >= 0.02 - 1e-9


def test_a_throw_into_a_bin_behind_a_wall() -> None:
    made = plan(problem(WALL, opening=BIN))
    (x,) = flights(made)
    assert np.linalg.norm(x - np.clip(x, WALL.lower, WALL.upper), axis=1).min() >= 0.02
    out = np.hypot(x[:, 0] - 1.15, x[:, 1] - 0.1) - BIN.radius_m
    wall_gap = np.hypot(out, np.maximum(x[:, 2] - 0.1 - BIN.rim_height_m, 0.0))
    assert wall_gap[out > -BIN.radius_m].min() >= 0.02


@pytest.mark.parametrize("window", [{}, {"release_window_s": 0.005, "landing_tolerance_m": 0.02}])
def test_a_throw_below_a_ceiling(window: dict[str, float]) -> None:
    window = {"backend": "casadi", **window}
    free = plan(problem(**window))
    apex = max(float(x[:, 2].max()) for x in flights(free))
    ceiling = Box(np.array([-3.0, -3.0, apex]), np.array([3.0, 3.0, apex + 0.1]))
    made = plan(problem(ceiling, **window))
    assert max(float(x[:, 2].max()) for x in flights(made)) <= apex - 0.02
    assert made.backend == "casadi" and made.trajectory.release_time_s < 1.2 * free.trajectory.release_time_s


def test_a_throw_below_a_beam_that_only_part_of_the_flight_passes() -> None:
    (free,) = flights(plan(problem(backend="casadi")))
    rises = free[: int(free[:, 2].argmax())]
    over = rises[int(0.7 * len(rises))]  # where the free flight still rises
    x = float(over[0])
    top = float(over[2])
    beam = Box(np.array([x, -3.0, top]), np.array([x + 0.05, 3.0, top + 0.3]))
    made = plan(problem(beam, backend="casadi"))
    (arc,) = flights(made)
    assert np.linalg.norm(arc - np.clip(arc, beam.lower, beam.upper), axis=1).min() >= 0.02
    assert made.backend == "casadi"


def test_a_throw_over_a_high_wall_that_few_postures_allow() -> None:
    """It was refused for its window of 5 ms, which two of five postures in between allow."""
    high = Box(np.array([0.77, -1.5, 0.0]), np.array([0.78, 1.5, 0.88]))
    asked = problem(high, release_window_s=0.005, landing_tolerance_m=0.02)
    behind = TargetRelease(np.array([0.9589108997592303, -0.05489270218509734, 0.0]))
    made = plan(replace(asked, release=behind))
    for x in flights(made):
        assert np.linalg.norm(x - np.clip(x, high.lower, high.upper), axis=1).min() >= 0.04
