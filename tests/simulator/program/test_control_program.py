"""The control program: handshake, streaming, moves, stops, watchdog; driven through registers like ur_rtde."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import kinematics
from simulator.physics.kinematics import from_matrix, pose_of
from simulator.program.control_program import offset_in, path_in
from simulator.program.runner import PAUSED, PLAYING, STOPPED
from tests.simulator.conftest import SCRIPT, Driven, make_cell

MOVEJ = 1
MOVEJ_IK = 2
MOVEL = 3
MOVEL_FK = 4
SPEEDJ = 9
SPEEDL = 10
SERVOJ = 11
SERVOC = 12
SPEED_STOP = 15
SERVO_STOP = 16
STOPL = 33
STOPJ = 34
WATCHDOG = 35
STOP_SCRIPT = 255
READY = 1
DONE = 2
HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
NEAR = [0.3, -1.4, 1.4, -1.5, -1.4, 0.2]
POSITION_TOLERANCE = 1e-9  # [rad] of the end of a move


@pytest.fixture
def driven():
    return Driven(make_cell())


def pose_at(driven, q):
    cell = driven.controller.cell
    X = kinematics.forward(cell.robot, q, cell.tool.X_FT)
    return X


def test_a_program_that_has_started_is_ready(driven):
    driven.cycle()
    assert driven.controller.runner.runtime == PLAYING
    assert driven.out_int(0) == READY


def test_a_move_takes_the_time_of_its_trapezoid_and_ends_exactly(driven):
    taken = driven.call(MOVEJ, [*NEAR, 0.5, 2.0], [0])
    length = max(abs(a - b) for a, b in zip(NEAR, HOME, strict=True))
    assert taken * 0.002 == pytest.approx(length / 0.5 + 0.5 / 2.0, abs=0.006)
    np.testing.assert_allclose(driven.arm.q, NEAR, atol=POSITION_TOLERANCE)
    assert driven.arm.qd == [0.0] * 6


def test_during_a_move_the_handshake_says_ready_and_a_second_command_is_lost(driven):
    driven.write(MOVEJ, [*NEAR, 0.5, 2.0], [0])
    driven.cycle(20)
    assert driven.out_int(0) == READY
    driven.write(STOPJ, [10.0], [0])
    driven.cycle(1000)
    np.testing.assert_allclose(driven.arm.q, NEAR, atol=POSITION_TOLERANCE)


def test_an_asynchronous_move_answers_at_once_and_can_be_stopped(driven):
    assert driven.call(MOVEJ, [*NEAR, 0.5, 2.0], [1]) == 1
    assert driven.out_int(2) & 1 << 15
    driven.cycle(50)
    driven.call(STOPJ, [5.0], [0])
    assert driven.arm.qd == [0.0] * 6
    assert not driven.out_int(2) & 1 << 15
    assert driven.arm.q != NEAR


@pytest.mark.parametrize("command", [MOVEL, MOVEL_FK, MOVEJ_IK])
def test_moves_to_a_pose_reach_it(driven, command):
    goal = pose_at(driven, NEAR)
    argument = NEAR if command == MOVEL_FK else pose_of(from_matrix(goal))
    driven.call(command, [*argument, 0.5, 2.0], [0])
    np.testing.assert_allclose(pose_at(driven, driven.arm.q), goal, atol=1e-8)


def test_movel_runs_along_the_straight_line(driven):
    start = pose_at(driven, HOME)[:3, 3]
    goal = pose_at(driven, NEAR)
    driven.write(MOVEL, [*pose_of(from_matrix(goal)), 0.5, 2.0], [0])
    along = (goal[:3, 3] - start) / np.linalg.norm(goal[:3, 3] - start)
    for _ in range(200):
        driven.cycle()
        off = pose_at(driven, driven.arm.q)[:3, 3] - start
        assert np.linalg.norm(off - along * (off @ along)) < 1e-8


def test_the_last_speed_is_repeated_until_something_stops_it(driven):
    driven.write(SPEEDJ, [0.2] * 6 + [10.0, 0.002])
    driven.cycle()
    driven.cycle(1000)  # the client is gone
    assert driven.arm.qd == [0.2] * 6
    driven.call(SPEED_STOP, [10.0])
    driven.cycle(10)
    assert driven.arm.qd == [0.0] * 6


def test_time_of_speedj_is_the_hold_off_of_the_next_command(driven):
    driven.write(SPEEDJ, [0.1] * 6 + [40.0, 0.5])
    driven.cycle(100)
    driven.write(SPEEDJ, [0.3] * 6 + [40.0, 0.002])
    driven.cycle(100)
    assert driven.arm.qd[0] == 0.1
    driven.cycle(60)
    assert driven.arm.qd[0] == 0.3


def test_speedl_moves_the_tool_at_its_twist(driven):
    twist = [0.05, -0.1, 0.02, 0.0, 0.1, 0.0]
    driven.write(SPEEDL, [*twist, 1.0, 0.002])
    driven.cycle(200)
    cell = driven.controller.cell
    found = kinematics.jacobian(cell.robot, driven.arm.q, cell.tool.X_FT) @ driven.arm.qd
    np.testing.assert_allclose(found, twist, atol=1e-4)


def test_servoj_follows_with_its_lookahead(driven):
    for k in range(1000):
        goal = [HOME[0] + 0.2 * k * 0.002, *HOME[1:]]
        driven.write(SERVOJ, [*goal, 0.0, 0.0, 0.002, 0.1, 300.0])
        driven.cycle()
    assert (goal[0] - driven.arm.q[0]) / 0.2 == pytest.approx(0.1, abs=0.005)  # a ramp is followed one lookahead late
    driven.call(SERVO_STOP, [10.0])
    assert driven.arm.qd == [0.0] * 6


def test_a_sudden_servo_target_is_a_protective_stop(driven):
    driven.write(SERVOJ, [HOME[0] + 1.5, *HOME[1:], 0.0, 0.0, 0.002, 0.1, 300.0])
    driven.cycle(2)
    assert driven.controller.safety.stopped
    assert "sudden change" in driven.controller.safety.reason


def test_servoc_signals_done_until_it_is_cleared(driven):
    driven.write(SERVOC, [*pose_of(from_matrix(pose_at(driven, NEAR))), 0.25, 1.2, 0.0])
    driven.cycle(10)
    assert driven.out_int(0) == DONE
    driven.write(0)
    driven.cycle()
    assert driven.out_int(0) == READY


def test_two_threads_that_move_the_arm_stop_the_program(driven):
    driven.write(SPEEDJ, [0.2] * 6 + [10.0, 0.002])
    driven.cycle(10)
    driven.write(MOVEJ, [*NEAR, 0.5, 2.0], [0])
    driven.cycle(3)
    assert driven.controller.runner.runtime == STOPPED
    assert "another thread" in driven.controller.timeline.events[-1][1]


def test_the_watchdog_stops_a_silent_client_and_kicks_keep_it_alive(driven):
    driven.call(WATCHDOG, [20.0])
    driven.write(SPEEDJ, [0.2] * 6 + [10.0, 0.002])
    for _ in range(10):
        driven.cycle(20)
        driven.write(SPEEDJ, [0.2] * 6 + [10.0, 0.002])
    assert driven.controller.runner.playing
    driven.cycle(25)
    assert driven.controller.runner.playing
    driven.cycle(1)
    assert driven.controller.runner.runtime == STOPPED
    driven.cycle(100)
    assert driven.arm.qd == [0.0] * 6


def test_stop_script_ends_the_program(driven):
    driven.write(STOP_SCRIPT)
    driven.cycle()
    assert driven.controller.runner.runtime == STOPPED


def test_stop_type_of_the_script_is_stopj_until_the_first_asynchronous_stop(driven):
    program = driven.controller.runner.program
    driven.call(STOPL, [5.0], [0])
    assert not program.stops_with_tool
    driven.call(STOPJ, [5.0], [1])
    assert program.stops_with_tool


def test_a_paused_move_goes_on_from_where_the_arm_stands(driven):
    driven.write(MOVEJ, [*NEAR, 0.5, 2.0], [0])
    driven.cycle(100)
    driven.controller.runner.pause()
    driven.cycle(100)
    assert driven.controller.runner.runtime == PAUSED
    assert driven.arm.qd == [0.0] * 6
    assert driven.controller.runner.resume()
    driven.cycle(1000)
    np.testing.assert_allclose(driven.arm.q, NEAR, atol=POSITION_TOLERANCE)


def test_the_speed_slider_scales_speed_smoothly(driven):
    driven.write(SPEEDJ, [0.4] * 6 + [10.0, 0.002])
    driven.cycle(100)
    driven.set(speed_slider_mask=1, speed_slider_fraction=0.5)
    before = driven.arm.qd[0]
    for _ in range(200):
        driven.cycle()
        assert abs(driven.arm.qd[0] - before) < 0.4 * 5.0 * 0.002 + 1e-9
        before = driven.arm.qd[0]
    assert driven.arm.qd[0] == pytest.approx(0.2)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("command", [MOVEJ, MOVEL, SPEEDJ, SPEEDL, SERVOJ, SERVOC, SPEED_STOP, 30, 39, 44, 41, 51])
def test_an_argument_that_is_not_finite_stops_the_program(command, bad):
    driven = Driven(make_cell())
    driven.write(command, [bad] * 14)
    driven.cycle(2)
    assert driven.controller.runner.runtime == STOPPED
    assert all(map(math.isfinite, driven.arm.q))


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(
    st.integers(-5, 300),
    st.lists(st.floats(-1e6, 1e6) | st.floats(-3, 3), min_size=18, max_size=18),
    st.lists(st.integers(-3, 3), min_size=7, max_size=7),
)
def test_no_command_breaks_the_controller(command, doubles, ints):
    driven = Driven(make_cell())
    driven.write(command, doubles, ints)
    driven.cycle(30)
    driven.controller.runner.upload(SCRIPT)
    driven.cycle(30)
    assert all(map(math.isfinite, driven.arm.q))


def test_offsets_are_read_from_the_line_after_their_marker():
    text = "global reg_offset_float = # float register offset\n24\nglobal x = # int register offset\n0\n"
    assert offset_in(text, "float") == 24
    assert offset_in(text, "int") == 0
    assert offset_in("nothing", "int") == 0


def test_a_path_is_read_from_the_text():
    text = (
        "# inject move path\n\tsignal_async_progress(0)\n\tmovej([0.1,0,0,0,0,1e-05],a=1.4,v=1.05,r=0)\n"
        "\tmovel(p[0.1,0,0,0,0,0],a=1,v=0.5,r=0.01)\n    end\n movej([9,9,9,9,9,9],a=1,v=1,r=0)"
    )
    first, second = path_in(text)
    assert (first.joints_move, first.is_pose, first.target, first.speed) == (True, False, (0.1, 0, 0, 0, 0, 1e-5), 1.05)
    assert (second.joints_move, second.is_pose, second.acceleration) == (False, True, 1.0)


def test_any_other_script_is_run_as_a_script():
    driven = Driven(make_cell())
    driven.controller.runner.stop("test")
    driven.controller.runner.upload("def mine():\n  write_output_integer_register(20, 5)\nend\n")
    driven.cycle(100)
    assert driven.out_int(20) == 5
    assert driven.controller.runner.runtime == STOPPED
    assert driven.controller.timeline.events[-1][1] == "program stopped: it has come to its end"
