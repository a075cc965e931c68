"""Tables of throws against the integrated flight of the trajectory's own states."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.learning.plans import PlannedThrow
from learning.throws import Circumstances, Throws, table_times, throw_table
from planner.flight import drag_constant, landing_points
from planner.geometry import tool_state

SAME_M = 2e-3  # [m] drag to first order, for a speed 3 % off; without drag it is a tenth


def exact(planned: PlannedThrow, late_s: float, factor: float, drag: float, dqd: np.ndarray) -> np.ndarray:
    problem = planned.problem
    trajectory = planned.trajectory
    q, qd, _ = trajectory.at(trajectory.release_time_s + late_s)
    state = tool_state(problem.cell, q, qd + dqd)
    thing = problem.cell.object
    k = drag_constant(thing.mass_kg, thing.radius_m, drag)
    return landing_points(state.p_WT[None], factor * state.v_WT[None], problem.plane_z, problem.gravity, k)[0, :2]


def one(late_s: float, factor: float = 1.0, offset=(0.0, 0.0), drag: float = 0.0, turn: float = 0.0) -> Circumstances:
    return Circumstances(np.array([late_s]), np.array([factor]), np.array([offset]), np.array([drag]), np.array([turn]))


@pytest.mark.parametrize("late_s", [-0.06, -0.0105, 0.0, 0.0233, 0.06])
@pytest.mark.parametrize(("factor", "drag"), [(1.0, 0.0), (0.96, 0.0), (1.03, 0.4)])
def test_a_landing_is_the_integrated_flight(soonest: list[PlannedThrow], late_s: float, factor: float, drag: float):
    rng = np.random.default_rng(1)
    for planned in soonest[:4]:
        dqd = 0.05 * rng.standard_normal(6)
        table = throw_table(planned.problem, planned.trajectory).deviated(dqd)
        found = Throws([table]).landings(one(late_s, factor, drag=drag))[0]
        assert found == pytest.approx(exact(planned, late_s, factor, drag, dqd), abs=SAME_M)


def test_a_base_that_is_shifted_and_turned_moves_the_landing_with_it(soonest: list[PlannedThrow]):
    table = throw_table(soonest[0].problem, soonest[0].trajectory)
    straight = Throws([table]).landings(one(0.0))[0]
    moved = Throws([table]).landings(one(0.0, offset=(0.01, -0.02), turn=np.pi / 2))[0]
    assert moved == pytest.approx([-straight[1] + 0.01, straight[0] - 0.02])


def test_derivatives_by_joint_speed_are_the_differences(soonest: list[PlannedThrow]):
    step = 1e-5
    for planned in soonest[:4]:
        table = throw_table(planned.problem, planned.trajectory)
        slopes = Throws([table]).by_joint_speed(np.array([0.004]), np.array([1.02]))[0]
        for j in range(6):
            moved = Throws([table.deviated(step * np.eye(6)[j])]).landings(one(0.004, 1.02))
            difference = (moved - Throws([table]).landings(one(0.004, 1.02)))[0] / step
            assert slopes[:, j] == pytest.approx(difference, abs=2e-3)


def test_an_arm_that_is_off_by_a_position_throws_from_there(soonest: list[PlannedThrow]):
    """An arm that is 12 ms late: released 12 ms late, it throws as planned."""
    planned = soonest[0]
    late_s = 0.012
    trajectory = planned.trajectory
    t = table_times(trajectory.release_time_s)
    now = trajectory.at(t)
    then = trajectory.at(t - late_s)
    table = throw_table(planned.problem, trajectory, (then[0] - now[0], then[1] - now[1]))
    found = Throws([table]).landings(one(late_s))[0]
    assert found == pytest.approx(exact(planned, 0.0, 1.0, 0.0, np.zeros(6)), abs=SAME_M)
