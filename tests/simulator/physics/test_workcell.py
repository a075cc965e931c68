"""Gripper, release, flight and landing, against closed forms and the planner's ballistics."""

import math

import numpy as np
import pytest

from planner import kinematics
from planner.flight import drag_constant, fly
from simulator.physics.gripper import SimulatedGripper
from simulator.physics.world import step
from simulator.truth import truth_of
from tests.simulator.conftest import Driven, make_cell, world_of

SPEEDJ = 9
SPEED_STOP = 15
LANDING_TOLERANCE_M = 1e-6  # the drag-free flight is exact, that with drag integrated every 2 ms against every 4 ms
DRAG = "object = { mass_kg = 0.05, radius_m = 0.05, drag_coefficient = 0.47 }\n"
TABLE = "surroundings = { keep_out = [{ lower_m = [0.5, -1.0, -0.1], upper_m = [2.0, 1.0, 0.3] }] }\n"


def flown(world, state, dt=0.002):
    world.release(1, 0.0, state, 0.0)
    k = 0
    while world.flights:
        k += 1
        world.cycle(k * dt, dt)
    return world.landings


@pytest.mark.parametrize("tables", ["", DRAG])
@pytest.mark.parametrize("velocity", [(2.0, 1.0, 3.0), (1.0, 0.0, -2.0), (0.0, 0.0, 0.0)])
def test_a_landing_is_where_the_planners_ballistics_has_it(tables, velocity):
    cell = make_cell(tables=tables, landing_height_m=0.1)
    drag = drag_constant(cell.object.mass_kg, cell.object.radius_m, cell.object.drag_coefficient)
    (landing,) = flown(world_of(cell), (0.5, 0.2, 0.9, *velocity))
    flight = fly([0.5, 0.2, 0.9], velocity, 0.1, 9.81, drag)
    np.testing.assert_allclose(landing["position_m"], flight.landing_point, atol=LANDING_TOLERANCE_M)
    assert landing["t"] == pytest.approx(flight.time_of_flight_s, abs=1e-6)
    assert landing["surface"] == "landing plane"


def test_one_step_without_drag_is_the_parabola():
    np.testing.assert_allclose(step((0, 0, 1, 1, 2, 3), 0.5, 10.0, 0.0), (0.5, 1.0, 1 + 1.5 - 1.25, 1, 2, -2))


def test_an_object_lands_on_a_table_that_is_in_its_way():
    (landing,) = flown(world_of(make_cell(tables=TABLE)), (0.0, 0.0, 1.0, 2.0, 0.0, 0.0))
    assert landing["surface"] == "keep_out[0]"
    assert landing["position_m"][2] == pytest.approx(0.3)
    assert landing["position_m"][0] == pytest.approx(2.0 * math.sqrt(2 * 0.7 / 9.81))


def test_a_bouncing_object_comes_down_again_each_time_lower():
    landings = flown(world_of(make_cell(), 0.5), (0.0, 0.0, 1.0, 1.0, 0.0, 0.0))
    assert [entry["bounce"] for entry in landings] == list(range(len(landings)))
    first = landings[0]
    second = landings[1]
    speed = -first["velocity_m_s"][2]
    assert second["t"] - first["t"] == pytest.approx(2 * 0.5 * speed / 9.81, rel=1e-4)


def test_an_object_below_every_surface_is_forgotten():
    world = world_of(make_cell(landing_height_m=1.0))
    assert flown(world, (0.0, 0.0, -0.5, 0.0, 0.0, 0.0)) == []


def test_the_object_leaves_with_the_true_velocity_of_the_tool_at_the_exact_time():
    cell = make_cell(
        lag_s=0.020,
        gripper_delay_s=0.0413,
        tables=("base_in_world = { position_m = [0.3, 0.2, 0.1], rotation_vector_rad = [0.0, 0.0, 0.7] }\n"),
    )
    driven = Driven(cell)
    driven.write(SPEEDJ, [0.6, -0.4, 0.3, 0.2, 0.1, 0.5, 20.0, 0.002])
    driven.cycle(60)
    sent_at = driven.controller.timeline.t
    driven.set(tool_digital_output_mask=1, tool_digital_output=1)
    states = {}
    for _ in range(60):
        driven.cycle()
        states[driven.controller.timeline.t] = (list(driven.arm.true_q), list(driven.arm.true_qd))
    (release,) = driven.controller.workcell.world.releases
    assert release["t"] == pytest.approx(sent_at + 0.020 + 0.0413, abs=1e-9)
    q, qd = states[min(states, key=lambda t: abs(t - release["t"]))]
    q = np.array(q) + np.array(qd) * (release["t"] - min(states, key=lambda t: abs(t - release["t"])))
    expected_p = cell.X_WB @ kinematics.forward(cell.robot, q, cell.tool.X_FT)
    expected_v = cell.X_WB[:3, :3] @ (kinematics.jacobian(cell.robot, q, cell.tool.X_FT) @ qd)[:3]
    np.testing.assert_allclose(release["position_m"], expected_p[:3, 3], atol=1e-6)
    np.testing.assert_allclose(release["velocity_m_s"], expected_v, atol=1e-6)


def test_output_bits_change_one_lag_after_they_were_sent():
    driven = Driven(make_cell(lag_s=0.013))
    sent_at = driven.controller.timeline.t
    driven.set(standard_digital_output_mask=5, standard_digital_output=4)
    driven.cycle(5)
    assert driven.controller.workcell.outputs.bits == 0
    driven.cycle(5)
    assert driven.controller.workcell.outputs.bits == 4
    assert driven.controller.workcell.outputs.changes[0] == (pytest.approx(sent_at + 0.013), 4)


WIRED = """
[outputs.valve]
output = "standard_digital"
index = 2
delay_s = 0.0113
jitter_s = 0.002
sense_input = 9
"""


def test_an_input_shows_what_an_output_switches_its_delay_later():
    driven = Driven(make_cell(lag_s=0.013, tables=WIRED.replace("jitter_s = 0.002", "")))
    sent_at = driven.controller.timeline.t
    for level in (4, 0):
        driven.set(standard_digital_output_mask=5, standard_digital_output=level)
        driven.cycle(12)
        assert driven.controller.workcell.input_bits == (0 if level else 1 << 9)
        driven.cycle(1)
        assert driven.controller.workcell.input_bits == (1 << 9 if level else 0)
    happened = driven.controller.workcell.devices["valve"].changes
    first_s = pytest.approx(sent_at + 0.013 + 0.0113)
    assert list(happened) == [(first_s, True), (pytest.approx(sent_at + 13 * 0.002 + 0.013 + 0.0113), False)]


def test_what_an_output_switches_scatters_and_keeps_its_order():
    driven = Driven(make_cell(lag_s=0.013, tables=WIRED))
    commanded = []
    for i in range(400):
        commanded.append(driven.controller.timeline.t)
        driven.set(standard_digital_output_mask=4, standard_digital_output=4 * (i % 2 == 0))
        driven.cycle(1 if i % 4 < 2 else 10)
    driven.cycle(20)
    happened = driven.controller.workcell.devices["valve"].changes
    times = np.array([at for at, _ in happened])
    assert [on for _, on in happened] == [i % 2 == 0 for i in range(400)]
    assert (np.diff(times) >= 0.0).all()
    late = times - np.array(commanded) - 0.013
    assert late.mean() == pytest.approx(0.0113, abs=0.0006)  # what waits for the edge before it comes later
    assert late.std() == pytest.approx(0.002, rel=0.15)


def test_a_gripper_that_opens_on_low_starts_closed_on_high():
    cell = make_cell(tables='gripper = { output = "configurable_digital", index = 3, open_level = false }\n')
    driven = Driven(cell)
    assert driven.controller.workcell.outputs.bits == 1 << 11
    driven.set(configurable_digital_output_mask=8, configurable_digital_output=0)
    driven.cycle(60)
    assert len(driven.controller.workcell.world.releases) == 1


def test_a_new_object_is_there_once_the_gripper_is_closed_and_the_arm_stands():
    driven = Driven(make_cell())
    tool = {"tool_digital_output_mask": 1}
    for number in (1, 2):
        assert driven.controller.workcell.gripper.holds == number
        driven.set(**tool, tool_digital_output=1)
        driven.cycle(50)
        assert driven.controller.workcell.gripper.holds is None
        driven.write(SPEEDJ, [0.1] * 6 + [1.0, 0.002])
        driven.set(**tool, tool_digital_output=0)
        driven.cycle(50)
        assert driven.controller.workcell.gripper.holds is None
        driven.call(SPEED_STOP, [1.0])
        driven.cycle(50)
    assert [release["object"] for release in driven.controller.workcell.world.releases] == [1, 2]


def test_jitter_scatters_the_delay_and_the_seed_repeats_it():
    cell = make_cell(gripper_delay_s=0.04, gripper_jitter_s=0.003, seed=7)

    def delays():
        truth = truth_of(cell)
        gripper = SimulatedGripper(cell.gripper, 0.04, truth.gripper, truth.seed)
        found = []
        for _ in range(400):
            gripper.output_changed(0.0, gripper.open_bits)
            found.append(gripper.take_release(math.inf))
            gripper.let_go()
            gripper.output_changed(0.0, gripper.closed_bits)
            gripper.rearm(True)
        return found

    first = delays()
    assert first == delays()
    assert np.mean(first) == pytest.approx(0.04, abs=5e-4)
    assert np.std(first) == pytest.approx(0.003, rel=0.15)


def test_a_stuck_gripper_keeps_the_object():
    driven = Driven(make_cell())
    driven.controller.workcell.gripper.stuck = True
    driven.set(tool_digital_output_mask=1, tool_digital_output=1)
    driven.cycle(100)
    assert driven.controller.workcell.world.releases == []
    assert driven.controller.workcell.gripper.holds == 1
