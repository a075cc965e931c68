"""The motions of scripts: their times, limits, blends and stops; the controller is driven cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from planner import kinematics
from planner.dynamics import Payload, joint_torques
from simulator.output_values import OutputValues
from simulator.program import ProgramError, messages
from simulator.program.progress import PathProgress
from simulator.program.runner import PAUSED, STOPPED
from tests.simulator.conftest import Driven, make_cell

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
START_S = 0.05  # from the upload until a program plays
DT = 0.002


class Recorded(Driven):
    """A controller that runs scripts; its commanded motion is recorded cycle by cycle."""

    def __init__(self, **sim: object) -> None:
        super().__init__(make_cell(**sim))
        self.said: list[messages.Message] = []
        self.controller.runner.board.listeners.append(self.said.append)

    def run(self, text: str, cycles: int = 6000) -> float:
        """Runs a script to its end, or for so many cycles; returns the time it played [s]."""
        runner = self.controller.runner
        runner.upload(text)
        while runner.due:
            self.cycle()
        begin = self.controller.timeline.t
        self.q: list[list[float]] = []
        self.qd: list[list[float]] = []
        self.qdd: list[list[float]] = []
        while cycles and runner.playing:
            self.cycle()
            self.q.append(self.arm.q)
            self.qd.append(self.arm.qd)
            self.qdd.append(self.arm.qdd)
            cycles -= 1
        return self.controller.timeline.t - begin

    @property
    def codes(self) -> list[int]:
        return [m.code for m in self.said if isinstance(m, messages.ErrorCode)]

    def slide(self, fraction: float) -> None:
        self.set(speed_slider_mask=1, speed_slider_fraction=fraction)
        self.cycle(200)

    def unlock(self) -> None:
        """Ends a protective stop, once the arm is at rest."""
        self.cycle(200)
        assert self.arm.qd == [0.0] * 6
        self.controller.stops.unlock(at_once=True)

    def tool(self, q: Sequence[float]) -> np.ndarray:
        cell = self.controller.cell
        return kinematics.forward(cell.robot, np.array(q), cell.tool.X_FT)


@pytest.fixture
def arm() -> Recorded:
    return Recorded()


# -- times
@pytest.mark.parametrize("t", [1.0, 4.0])
def test_a_straight_move_takes_the_time_asked_for(arm: Recorded, t: float):
    taken = arm.run(f"movel(pose_trans(get_target_tcp_pose(), p[0, 0, 0.1, 0, 0, 0]), t={t})\n")
    assert taken == pytest.approx(t, abs=0.01)


MOVES = [
    "movej([1, -1.57, 1.57, -1.57, -1.57, 0], t=0.05)",
    "movej([1, -1.57, 1.57, -1.57, -1.57, 0], a=1000, v=100)",
    "movel(pose_trans(get_target_tcp_pose(), p[0, 0, -0.2, 0, 0, 0]), t=0.05)",
    "movel(pose_trans(get_target_tcp_pose(), p[0, 0, -0.2, 0, 0, 0]), a=500, v=20)",
]


@pytest.mark.parametrize("move", MOVES)
def test_a_move_is_no_faster_than_the_joints_can(arm: Recorded, move: str):
    taken = arm.run(f"{move}\n")
    robot = arm.controller.cell.robot
    assert not arm.controller.safety.stopped
    assert arm.codes == []
    assert np.all(np.abs(arm.qd).max(axis=0) <= robot.qd_max + 1e-6)
    assert np.abs(arm.qdd).max() > 0.4 * robot.qdd_max.max()  # and not much slower either
    assert 0.1 < taken < 0.6


def test_speedl_asks_no_more_of_a_joint_than_it_can(arm: Recorded):
    arm.run("speedl([0, 0, -0.3, 0, 0, 0], 40, 0.3)\n")
    assert arm.codes == []
    assert np.abs(arm.qdd).max() <= arm.controller.cell.robot.qdd_max.max() + 1e-6


# -- limits
@pytest.mark.parametrize("joint", [0, 5])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_move_beyond_a_joints_limit_stops_at_it_and_there_is_a_way_back(arm: Recorded, joint: int, direction: float):
    near = list(HOME)
    near[joint] = direction * 6.0
    far = list(HOME)
    far[joint] = direction * 7.0
    arm.run(f"def go():\n  movej({near}, a=10, v=3)\n  movej({far}, a=10, v=3)\nend\n")
    assert arm.codes == [150]
    assert arm.controller.runner.runtime == STOPPED  # the program could only do the same again
    arm.unlock()
    assert abs(arm.arm.q[joint]) == pytest.approx(2.0 * math.pi, abs=0.01)
    assert abs(arm.arm.q[joint]) <= 2.0 * math.pi + 1e-4
    arm.run(f"movej({far}, a=10, v=3)\n")  # the same way again: it stops where it stands
    arm.unlock()
    assert abs(arm.arm.q[joint]) <= 2.0 * math.pi + 1e-3
    arm.run(f"movej({HOME}, a=10, v=3)\n")
    assert arm.codes == [150, 150]
    np.testing.assert_allclose(arm.arm.q, HOME, atol=1e-9)


def test_a_streamed_speed_into_a_limit_leaves_the_program_paused(arm: Recorded):
    arm.run("def go():\n  movej([0, -1.57, 1.57, -1.57, -1.57, 6])\n  speedj([0, 0, 0, 0, 0, 1], 10, 5)\nend\n")
    assert arm.codes == [150]
    assert arm.controller.runner.runtime == PAUSED


def test_a_goal_beyond_a_limit_is_forgotten_with_its_move(arm: Recorded):
    thread = "  thread far():\n    movej([0, -1.57, 1.57, -1.57, -1.57, 7])\n  end\n"
    begun = "  handle = run far()\n  sleep(0.2)\n  kill handle\n  stopj(10)\n"
    arm.run(f"def go():\n{thread}{begun}  speedj([0, 0, 0, 0, 0, 2], 10, 5)\nend\n")
    assert arm.codes == [150]
    assert arm.controller.runner.runtime == PAUSED


def test_a_stop_by_the_program_has_its_own_code(arm: Recorded):
    arm.run("protective_stop()\n", 10)
    assert arm.codes == [209]
    assert arm.controller.safety.stopped


# -- streaming
@pytest.mark.parametrize("fraction", [1.0, 0.5, 0.25])
@pytest.mark.parametrize("command", ["speedj([0.4, 0, 0, 0, 0, 0]", "speedl([0, 0, -0.1, 0, 0, 0]"])
def test_the_speed_slider_stretches_the_time_of_a_speed(arm: Recorded, fraction: float, command: str):
    """So the way of a call is the same at any speed; the acceleration is scaled by the square."""
    arm.run(f"{command}, 4, 0.3)\n")
    way = np.subtract(arm.q[-1], HOME)
    scaled = Recorded()
    scaled.slide(fraction)
    taken = scaled.run(f"{command}, 4, 0.3)\n")
    assert taken == pytest.approx(0.3 / fraction, abs=0.005)
    np.testing.assert_allclose(np.subtract(scaled.q[-1], HOME), way, atol=2e-3)
    np.testing.assert_allclose(scaled.qd[-2], np.multiply(arm.qd[-2], fraction), atol=1e-3)


def test_a_long_speed_follows_the_slider_at_once(arm: Recorded):
    arm.controller.runner.upload("speedj([0.4, 0, 0, 0, 0, 0], 0.5, 20)\n")
    arm.cycle(600)
    assert arm.arm.qd[0] == 0.4
    arm.slide(0.25)
    assert arm.arm.qd[0] == pytest.approx(0.1)


def test_a_stiff_servo_reaches_a_step_without_a_stop_or_overshoot(arm: Recorded):
    goal = [0.1, *HOME[1:]]
    arm.run(f"def go():\n  while True:\n    servoj({goal}, t=0.002, lookahead_time=0.03, gain=2000)\n  end\nend\n", 300)
    assert arm.codes == []
    assert max(q[0] for q in arm.q) <= 0.1 + 1e-6
    assert arm.q[-1][0] == pytest.approx(0.1, abs=1e-6)


def test_a_stiff_servo_follows_a_fast_stream_closely(arm: Recorded):
    step = "servoj([q, -1.57, 1.57, -1.57, -1.57, 0], t=0.002, lookahead_time=0.03, gain=2000)"
    loop = f"  while q < 0.2:\n    v = v + 0.02\n    q = q + 0.002 * v\n    {step}\n  end\n"
    arm.run(f"def go():\n  q = 0\n  v = 0\n{loop}end\n")
    goals = np.cumsum(0.002 * 0.02 * np.arange(1, 100))
    reached = np.array([q[0] for q in arm.q[:99]])
    assert arm.codes == []
    assert arm.qd[98][0] == pytest.approx(2.0, abs=0.2)
    assert np.abs(goals - reached).max() < 0.0045 * 2.0 + 0.004  # one time constant behind


def test_a_far_servo_target_still_stops(arm: Recorded):
    arm.run("servoj([1, -1.57, 1.57, -1.57, -1.57, 0], lookahead_time=0.03, gain=2000)\n", 10)
    assert arm.codes == [204]


STIFF = "t=0.2, lookahead_time=0.03, gain=2000"
BETWEEN = [
    "movej([1, -1.57, 1.57, -1.57, -1.57, 0], a=10, v=3)",
    "speedj([2, 0, 0, 0, 0, 0], 10, 0.5)\n  stopj(10)",
    "movej([1, -1.57, 1.57, -1.57, -1.57, 0], a=10, v=3, r=0.1)\n  sleep(1)",
]


@pytest.mark.parametrize("between", BETWEEN)
def test_a_servo_knows_no_goal_from_before_another_motion(arm: Recorded, between: str):
    first = f"servoj({HOME}, t=0.002)"
    last = f"q = get_target_joint_positions()\n  q[0] = q[0] + 0.2\n  servoj(q, {STIFF})"
    arm.run(f"def go():\n  {first}\n  {between}\n  {last}\nend\n")
    assert arm.codes == []
    arm.cycle()
    assert not arm.controller.context.motion.servo_goal


def test_a_servo_knows_no_goal_of_another_program(arm: Recorded):
    arm.run(f"servoj({HOME}, t=0.002)\n")
    arm.run("movej([1, -1.57, 1.57, -1.57, -1.57, 0], a=10, v=3)\n")
    arm.run(f"servoj([1.2, -1.57, 1.57, -1.57, -1.57, 0], {STIFF})\n")
    assert arm.codes == []


# -- blends
FIRST = [0.5, -1.57, 1.57, -1.57, -1.57, 0.0]
SECOND = [0.5, -1.2, 1.57, -1.57, -1.57, 0.0]


def moves(kind: str, blend_m: float) -> str:
    """Returns a script of two moves, the first with a blend radius."""
    if kind == "movej":
        return f"def go():\n  movej({FIRST}, a=3, v=1, r={blend_m})\n  movej({SECOND}, a=3, v=1)\nend\n"
    lines = [
        "start = get_target_tcp_pose()",
        "first = pose_add(start, p[0, 0.2, 0, 0, 0, 0])",
        f"{kind}(first, a=1, v=0.25, r={blend_m})",
        f"{kind}(pose_add(first, p[0, 0, 0.2, 0, 0, 0]), a=1, v=0.25)",
    ]
    return "def go():\n" + "".join(f"  {line}\n" for line in lines) + "end\n"


@pytest.mark.parametrize("kind", ["movej", "movel", "movep"])
def test_a_blend_passes_its_waypoint_at_speed_and_within_its_radius(kind: str):
    sharp = Recorded()
    whole_s = sharp.run(moves(kind, 0.0))
    rests = [i for i, qd in enumerate(sharp.qd[:-3]) if not any(qd)]
    corner = sharp.tool(sharp.q[rests[0]])[:3, 3]
    blended = Recorded()
    taken = blended.run(moves(kind, 0.05))
    assert blended.codes == []
    assert taken < whole_s - 0.1
    assert min(np.abs(qd).max() for qd in blended.qd[5:-5]) > 0.01  # it never stands in between
    np.testing.assert_allclose(blended.arm.q, sharp.arm.q, atol=1e-7)
    nearest = min(np.linalg.norm(blended.tool(q)[:3, 3] - corner) for q in blended.q)
    assert 0.001 < nearest < 0.05
    assert np.abs(blended.qdd).max() < 1.05 * 2.0 * np.abs(sharp.qdd).max()


def test_a_blend_without_a_next_move_ends_at_its_waypoint(arm: Recorded):
    arm.run(f"def go():\n  movej({FIRST}, a=3, v=1, r=0.1)\n  sleep(1)\nend\n")
    np.testing.assert_allclose(arm.arm.q, FIRST, atol=1e-9)
    assert np.abs(arm.qdd).max() == pytest.approx(3.0, rel=1e-3)  # with its own deceleration


class Unsolvable:
    """A path on which the arm cannot be anywhere."""

    length = 1.0
    goal = FIRST
    reaches_goal = True

    def __init__(self) -> None:
        self.rates: list[list[float]] = []

    def at(self, distance: float) -> tuple[list[float], list[float]]:
        raise ProgramError("unable to find an inverse kinematics solution")


def blending(arm: Recorded) -> PathProgress:
    """Runs until a move is to blend into the next; returns what is left of it."""
    arm.controller.runner.upload(f"def go():\n  movej({FIRST}, a=3, v=1, r=0.3)\n  sleep(2)\nend\n")
    motion = arm.controller.context.motion
    while motion.blended is None:
        arm.cycle()
    return motion.blended


def test_a_blend_that_cannot_go_on_is_an_error_of_the_program(arm: Recorded):
    blending(arm).path = Unsolvable()
    arm.cycle(200)
    assert arm.controller.runner.runtime == STOPPED
    assert [m.text for m in arm.said if isinstance(m, messages.RuntimeException)] == [
        "unable to find an inverse kinematics solution"
    ]
    assert arm.arm.qd == [0.0] * 6


def test_a_protective_stop_ends_a_blend_though_the_program_plays(arm: Recorded):
    assert not blending(arm).ended
    speed = arm.arm.qd[0]
    arm.controller.stops.protective("a test", "playing")
    arm.cycle(2)
    deceleration = arm.controller.settings.decelerations.protective_stop
    assert arm.arm.qd[0] == pytest.approx(speed - 2.0 * DT * deceleration)
    arm.unlock()
    arm.cycle(100)
    assert arm.arm.qd == [0.0] * 6
    assert arm.codes == [0]


def test_no_move_blends_that_cannot_reach_its_goal(arm: Recorded):
    """The tool goes straight to the other side of the first axis, next to which the wrist cannot be."""
    arm.run(
        """def go():
  a = get_target_tcp_pose()
  movej(get_inverse_kin(p[-0.5, -0.05, a[2], a[3], a[4], a[5]]))
  movel(p[0.2, -0.05, a[2], a[3], a[4], a[5]], a=0.05, v=1, r=0.1)
  write_output_integer_register(30, 1)
end
"""
    )
    assert arm.out_int(30) == 0
    assert arm.tool(arm.arm.q)[0, 3] > -0.14  # it came as far as it can, not to the last place it had looked at


@pytest.mark.parametrize("next_line", ["speedj([0.2, 0, 0, 0, 0, 0], 2, 0.5)", "stopj(2)", "halt"])
def test_what_is_no_move_ends_a_blend(arm: Recorded, next_line: str):
    arm.run(f"def go():\n  movej({FIRST}, a=3, v=1, r=0.1)\n  {next_line}\nend\n")
    arm.cycle(300)
    assert arm.codes == []
    assert arm.controller.runner.runtime == STOPPED
    assert arm.arm.qd == [0.0] * 6


def test_a_blend_that_is_paused_goes_on_to_its_goals(arm: Recorded):
    arm.controller.runner.upload(moves("movej", 0.1))
    while not arm.arm.qd[1]:
        arm.cycle()
    assert arm.arm.qd[0] > 0.1  # both moves at once
    arm.controller.runner.pause()
    arm.cycle(200)
    assert arm.arm.qd == [0.0] * 6
    arm.controller.runner.resume()
    arm.cycle(2000)
    np.testing.assert_allclose(arm.arm.q, SECOND, atol=1e-9)


# -- arcs, and moves of later versions
@pytest.mark.parametrize("mode", [0, 1])
def test_an_arc_passes_through_its_point_on_a_circle(arm: Recorded, mode: int):
    arm.run(
        f"""def go():
  start = get_target_tcp_pose()
  via = pose_add(start, p[0, 0.1, 0.1, 0, 0, 0])
  movec(via, pose_add(start, p[0, 0.2, 0, 0, 0, 0]), a=1, v=0.2, mode={mode})
end
"""
    )
    start, *frames = [arm.tool(q) for q in [HOME, *arm.q]]
    points = np.array([X[:3, 3] for X in frames])
    center = start[:3, 3] + [0.0, 0.1, 0.0]
    np.testing.assert_allclose(np.linalg.norm(points - center, axis=1), 0.1, atol=1e-6)
    np.testing.assert_allclose(points[-1], start[:3, 3] + [0.0, 0.2, 0.0], atol=1e-6)
    assert np.linalg.norm(points - np.add(center, [0.0, 0.0, 0.1]), axis=1).min() < 1e-3
    turn = start[:3, :3].T @ frames[-1][:3, :3]
    angle = math.acos(min(1.0, (np.trace(turn) - 1.0) / 2.0))
    assert angle == pytest.approx(math.pi if mode == 1 else 0.0, abs=1e-3)


def test_an_arc_through_a_line_is_an_error(arm: Recorded):
    via, to = (f"pose_add(get_target_tcp_pose(), p[0, {y}, 0, 0, 0, 0])" for y in (0.1, 0.2))
    arm.run(f"movec({via}, {to})\n")
    assert any(isinstance(m, messages.RuntimeException) and "one line" in m.text for m in arm.said)


@pytest.mark.parametrize("share", [0.25, 1.0])
@pytest.mark.parametrize("move", ["optimovej", "optimovel"])
def test_an_optimal_move_takes_a_share_of_what_the_joints_can(move: str, share: float):
    arm = Recorded(polyscope="5.23.0")
    arm.run(f"{move}(pose_add(get_target_tcp_pose(), p[0, 0.3, 0, 0, 0, 0]), a={share}, v={share})\n")
    robot = arm.controller.cell.robot
    assert arm.codes == []
    most = np.abs(arm.qdd).max()
    assert 0.4 * share * robot.qdd_max.max() < most < 1.3 * share * robot.qdd_max.max()


# -- outputs
def test_analog_outputs_and_tool_voltage_are_told(arm: Recorded):
    arm.run("def go():\n  set_analog_out(1, 0.25)\n  set_standard_analog_out(0, 1.0)\n  set_tool_voltage(12)\nend\n")
    values = OutputValues(arm.controller).values
    assert (values["standard_analog_output0"], values["standard_analog_output1"]) == ([1.0], [0.25])
    assert values["tool_output_voltage"] == [12]


def test_a_torque_accelerates_the_arm_as_its_dynamics_say():
    torque = [5.0, 8.0, 4.0, 0.05, 0.01, 0.0]
    arm = Recorded(polyscope="5.23.0")
    loop = f"  while i < 20:\n    direct_torque({torque}, friction_comp=False)\n    i = i + 1\n  end\n"
    arm.run(f"def go():\n  i = 0\n{loop}end\n")
    cell = arm.controller.cell
    load = Payload(1.0, np.array([0.0, 0.0, 0.085]), np.zeros((3, 3)))
    k = 10
    at = [HOME, *arm.q]
    rate = [[0.0] * 6, *arm.qd]
    found = joint_torques(cell.robot, np.array(at[k]), np.array(rate[k]), np.array(arm.qdd[k]), [0.0] * 3, load)
    np.testing.assert_allclose(found, torque, atol=1e-6)
    assert arm.codes == []


def test_torques_are_of_later_versions(arm: Recorded):
    arm.run("direct_torque([0, 0, 0, 0, 0, 0])\n")
    assert any(isinstance(m, messages.RuntimeException) and "name_not_found" in m.text for m in arm.said)
