"""The independent audit of the benchmark accepts a certified plan and names every planted fault."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from audit.judge import find_faults, flight_faults
from audit.judge.flights import drag_constant, integrate, obstacles_of_path
from audit.judge.safety import grip_faults, object_times, safety_faults
from benchmarks.problem_sets import (
    build,
    obstructed_tasks,
    random_cell_tasks,
    shaped_cell_tasks,
    shaped_tasks,
    varied_tasks,
)
from planner.cell import Box, Safety, shape_of
from planner.flight import fly, path
from planner.geometry import tool_pose, tool_state
from planner.planning import plan
from planner.problem import JointRelease, Opening
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell


@pytest.fixture(scope="module")
def good():
    task = build("target", 4, 0)[0]
    problem = replace(task.problem, backend="ruckig")
    return problem, plan(problem).trajectory


def shifted(motion, joint, offset):
    q = np.array(motion.q)
    q[:, joint] += offset
    return replace(motion, q=q)


def limited(problem, **changes):
    return replace(problem, limits=replace(problem.limits, **changes))


def around(problem, **changes):
    return replace(problem, cell=replace(problem.cell, surroundings=replace(problem.cell.surroundings, **changes)))


def watched(problem, **limits):
    return replace(problem, cell=replace(problem.cell, safety=Safety(**limits)))


def held(problem, **changes):
    return replace(problem, cell=replace(problem.cell, gripper=replace(problem.cell.gripper, **changes)))


def middle(problem, motion, share=0.5):
    """Point of the flight half way in time, or at another share of it."""
    state = tool_state(problem.cell, *(x[motion.release_index] for x in (motion.q, motion.qd)))
    flight = fly(state.p_WT, state.v_WT, problem.plane_z, problem.gravity)
    return path(state.p_WT, state.v_WT, [share * flight.time_of_flight_s], problem.gravity)[0]


def screen(problem, motion):
    """A small box in the way of the flight."""
    x = middle(problem, motion)
    return Box(x - 0.01, x + 0.01)


def with_bin(problem, motion):
    """A bin around the target whose wall stands where the flight is half way."""
    x = middle(problem, motion)
    off = problem.release.p_W - x
    opening = Opening(float(np.linalg.norm(off[:2])), float(-off[2] + 0.05))
    return replace(problem, release=replace(problem.release, opening=opening))


def bin_under_the_arm(problem, motion):
    """A bin so high that the arm is in it when it releases."""
    p = tool_state(problem.cell, *(x[motion.release_index] for x in (motion.q, motion.qd))).p_WT
    opening = Opening(0.1, float(p[2]) + 0.1)
    return replace(problem, release=replace(problem.release, p_W=p * [1.0, 1.0, 0.0], opening=opening))


def all_space(half):
    return (Box(np.full(3, -half), np.full(3, half)),)


SPOILT = {
    "lands at": lambda p, t: (p, shifted(t, 0, 0.01)),
    "velocity": lambda p, t: (limited(p, qd_max=0.9 * np.abs(t.qd).max(axis=0)), t),
    "acceleration": lambda p, t: (limited(p, qdd_max=0.9 * np.abs(t.qdd).max(axis=0)), t),
    "jerk": lambda p, t: (limited(p, jerk_max=0.9 * np.abs(t.jerk).max(axis=0)), t),
    "upper position": lambda p, t: (p, shifted(t, 5, 7.0)),
    "torque": lambda p, t: (limited(p, tau_max=0.1 * p.limits.tau_max), t),
    "tool speed": lambda p, t: (limited(p, tcp_speed_max=0.5), t),
    "floor": lambda p, t: (around(p, floor_z_m=0.6), t),
    "forbidden shape": lambda p, t: (around(p, keep_out=all_space(5.0)), t),
    "shape or bin": lambda p, t: (bin_under_the_arm(p, t), t),
    "outside a keep-in shape": lambda p, t: (around(p, keep_in=all_space(0.1)), t),
    "self-collision": lambda p, t: (p, shifted(t, 2, 1.3)),
    "singularity": lambda p, t: (p, shifted(t, 4, -t.q[t.release_index, 4])),
    "does not start": lambda p, t: (p, shifted(t, 5, 1e-3)),
}


def in_jumps(motion):
    """The same places, the accelerations jumping between ticks: no jerk inside a tick shows it."""
    qdd = np.repeat(np.diff(motion.qd, axis=0)[::4], 4, axis=0)[: len(motion.q) - 1] / motion.dt
    qd = np.concatenate([motion.qd[:1], motion.qd[:1] + np.cumsum(qdd, axis=0) * motion.dt])
    steps = 0.5 * (qd[1:] + qd[:-1]) * motion.dt
    return replace(motion, q=np.concatenate([motion.q[:1], motion.q[0] + np.cumsum(steps, axis=0)]), qd=qd)


def test_accelerations_that_jump_between_ticks_are_named(good):
    problem, motion = good
    assert any(fault.rule == "joint_jerk" for fault in find_faults(problem, in_jumps(motion)))


SAFETY_SPOILT = {
    "flange speed": lambda p, t: (watched(p, tool_speed_m_s=0.3), t),
    "elbow speed": lambda p, t: (watched(p, elbow_speed_m_s=0.1), t),
    "momentum": lambda p, t: (watched(p, momentum_kg_m_s=1.0), t),
    "power": lambda p, t: (watched(p, power_w=10.0), t),
    "stopping time": lambda p, t: (watched(p, stopping_time_s=0.01), t),
    "stopping distance": lambda p, t: (watched(p, stopping_distance_m=0.005), t),
    "grip acceleration": lambda p, t: (held(p, hold_acceleration_m_s2=np.full(3, 5.0)), t),
}
FLIGHT_SPOILT = {
    "flight through box": lambda p, t: (around(p, keep_out=(screen(p, t),)), t),
    "flight through the bin's wall": lambda p, t: (with_bin(p, t), t),
}


@pytest.mark.parametrize("fault", SPOILT)
def test_what_is_spoilt_is_named(good, fault):
    problem, motion = SPOILT[fault](*good)
    assert any(fault in str(found) for found in find_faults(problem, motion))


@pytest.mark.parametrize("fault", SAFETY_SPOILT)
def test_a_safety_limit_or_grip_that_is_broken_is_named(good, fault):
    problem, motion = SAFETY_SPOILT[fault](*good)
    assert any(fault in str(found) for found in [*safety_faults(problem, motion), *grip_faults(problem, motion)])


@pytest.mark.parametrize("fault", FLIGHT_SPOILT)
def test_what_is_in_the_way_of_the_flight_is_named(good, fault):
    problem, motion = FLIGHT_SPOILT[fault](*good)
    # A flight that meets the wall from outside has passed the mouth's plane beside the bin before.
    named = (fault, "enters the bin") if "bin" in fault else (fault,)
    assert any(name in str(found) for found in flight_faults(problem, motion) for name in named)


@pytest.mark.parametrize("fault", FLIGHT_SPOILT)
def test_what_is_in_the_way_of_a_point_is_named(good, fault):
    """Its distance from a box is 0 within it, and from a wall never below 0."""
    problem, motion = good
    point = replace(problem, cell=replace(problem.cell, object=replace(problem.cell.object, radius_m=0.0)))
    assert flight_faults(point, motion) == []
    spoilt, motion = FLIGHT_SPOILT[fault](point, motion)
    assert any(fault in str(found) or "enters the bin" in str(found) for found in flight_faults(spoilt, motion))


def test_a_box_that_carries_the_target_is_met_at_its_edge_alone(good):
    problem, motion = good
    place = middle(problem, motion, 0.9)
    in_air = replace(problem, release=replace(problem.release, p_W=place))
    state = tool_state(problem.cell, *(x[motion.release_index] for x in (motion.q, motion.qd)))
    ahead = np.sign(state.v_WT[0])
    radius = problem.cell.object.radius_m
    assert abs(state.v_WT[0]) > 0.5
    for before_m, named in ((1.0, False), (0.1 * radius, True)):
        edges = sorted((place[0] - ahead * before_m, place[0] + ahead * 1.0))
        table = Box(np.array([edges[0], place[1] - 1.0, -0.5]), np.array([edges[1], place[1] + 1.0, place[2]]))
        found = [fault.text for fault in flight_faults(around(in_air, keep_out=(table,)), motion)]
        assert any("box 0" in text for text in found) == named, found


@pytest.mark.parametrize(("top_m", "named"), [(0.2, True), (0.01, True), (0.0009, False)])
def test_a_wall_that_the_object_would_meet_once_it_lies_on_the_floor_is_named(good, top_m, named):
    problem, motion = good
    thick = replace(problem, cell=replace(problem.cell, object=replace(problem.cell.object, radius_m=0.05)))
    state = tool_state(problem.cell, *(x[motion.release_index] for x in (motion.q, motion.qd)))
    touch = fly(state.p_WT, state.v_WT, problem.plane_z + 0.05, problem.gravity).landing_point
    along = (problem.release.p_W - touch)[:2]
    reach = np.sqrt(0.05**2 - max(0.05 - top_m, 0.0) ** 2)
    ahead = problem.release.p_W[:2] + (reach / np.hypot(*along) - 0.5) * along  # touched half way
    post = Box(np.array([*ahead - 1e-6, problem.plane_z]), np.array([*ahead, problem.plane_z + top_m]))
    found = [fault.text for fault in flight_faults(around(thick, keep_out=(post,)), motion)]
    assert any("box 0" in text for text in found) == named, found


@pytest.mark.parametrize(("beside_m", "named"), [(0.0, False), (0.3, True)])
def test_an_object_thicker_than_its_bin_is_deep_comes_to_lie_in_it(good, beside_m, named):
    """Its centre never passes the mouth: that alone is no fault."""
    problem, motion = good
    release = replace(problem.release, p_W=np.add(problem.release.p_W, [beside_m, 0, 0]), opening=Opening(0.2, 0.03))
    thick = replace(problem, cell=replace(problem.cell, object=replace(problem.cell.object, radius_m=0.05)))
    found = [str(fault) for fault in flight_faults(replace(thick, release=release), motion)]
    assert any("the bin beside its axis" in fault for fault in found) == named
    assert not any("never passes" in fault for fault in found)


def test_certified_plans_are_right(good):
    assert find_faults(*good) == []


def test_varied_problems_are_of_every_kind_and_their_plans_right():
    tasks = varied_tasks(cell(), 0, 18, 5)
    assert {type(task.problem.release).__name__ for task in tasks} == {
        "JointRelease",
        "PoseRelease",
        "PointRelease",
        "TargetRelease",
    }
    assert any(task.problem.is_robust for task in tasks)
    assert any(task.problem.ends_at_rest for task in tasks)
    rest = next(task.problem for task in tasks if task.problem.ends_at_rest)
    assert find_faults(rest, plan(rest).trajectory) == []


@pytest.mark.parametrize("drag", [0.0, 0.5])
def test_the_audits_flight_agrees_with_an_integrator(drag):
    p = np.array([0.1, -0.2, 0.9])
    v = np.array([2.5, -1.0, 2.0])

    def rate(_, s):
        return np.concatenate([s[3:], -drag * np.linalg.norm(s[3:]) * s[3:] - [0.0, 0.0, 9.81]])

    def falls(_, s):
        return s[2] - 0.2 if s[5] < 0.0 else 1.0

    falls.terminal = True
    exact = solve_ivp(rate, (0.0, 3.0), np.concatenate([p, v]), events=falls, rtol=1e-10, atol=1e-12)
    paths = integrate(p[None], v[None], 0.2, 0.03, 9.81, drag)
    np.testing.assert_allclose(paths.landed[0], exact.y_events[0][0][:3], atol=5e-6)
    assert paths.steps[0] < 1000.0 * exact.t_events[0][0]
    assert paths.x[paths.steps[0] - 1, 0, 2] >= 0.23


def test_a_flight_through_the_arm_is_named(good):
    """Thrown straight up and back, the object comes down on the arm, which rests by then."""
    problem, motion = good
    k = motion.release_index
    q = np.array(motion.q)
    here = problem.cell
    q[:] = here.home + np.array([0.0, 0.2, -0.4, 0.2, 0.0, 0.0])
    still = replace(motion, q=q, qd=np.zeros_like(q), qdd=np.zeros_like(q))
    p = tool_state(here, q[k], np.zeros(6)).p_WT
    shoulder = here.X_WB[:3, 3] + [0.0, 0.0, 0.16]
    time = 0.6
    v = (shoulder - p) / time + np.array([0.0, 0.0, 0.5 * problem.gravity * time])
    paths = integrate(p[None], v[None], problem.plane_z, here.object.radius_m, problem.gravity, drag_constant(problem))
    found = obstacles_of_path(replace(problem, release=JointRelease(q[k], np.ones(6))), still, paths)
    assert any("flight through" in str(fault) for fault in found)


def test_the_object_counts_for_the_whole_window(good):
    problem, motion = good
    robust = replace(problem, release_window_s=0.02, landing_tolerance_m=1.0)
    assert object_times(robust, motion) == (motion.release_time_s - 0.02, motion.release_time_s + 0.02)
    assert object_times(problem, motion) == (motion.release_time_s, motion.release_time_s)
    strict = replace(robust, landing_tolerance_m=1e-5)
    assert any("lands at" in str(fault) for fault in flight_faults(strict, motion))


def test_random_cells_are_repeatable_and_of_every_mounting():
    tasks = random_cell_tasks(4, 4, 3)
    assert [task.name for task in tasks] == [task.name for task in random_cell_tasks(4, 4, 3)]
    assert len(tasks) == 4
    assert all(task.problem.cell.safety.power_w for task in tasks)


@pytest.mark.slow
def test_throws_among_shapes_are_faultless():
    """Onto the floor, a turned table and a round one, past shapes of every kind, over walls, and in a random cell."""
    walls = obstructed_tasks(cell(), 2, seed=1, shaped=True)
    for task in [*shaped_tasks(cell(), 4, seed=1), *walls, *shaped_cell_tasks(1, seed=1)]:
        found = plan(task.problem)
        assert find_faults(task.problem, found.trajectory) == []


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere", "capsule"])
def test_a_shape_in_the_way_of_arm_or_flight_is_named(good, kind):
    problem, motion = good
    release = tool_state(problem.cell, motion.q[motion.release_index], motion.qd[motion.release_index]).p_WT
    turn = rotation_vector_to_matrix([0.3, 0.5, 0.0])
    for place, rule in ((release, "keep_out"), (middle(problem, motion, 0.5), "flight_clearance")):
        sizes = {"box": [0.05, 0.05, 0.05], "sphere": [0.05, 0.0]}.get(kind, [0.05, 0.05])
        shape = shape_of(kind, pose(place, turn), np.array(sizes), "lamp")
        found = find_faults(around(problem, keep_out=(shape,)), motion)
        assert any(fault.rule == rule for fault in found), found


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere", "capsule"])
def test_a_tool_outside_a_turned_or_round_room_is_named(good, kind):
    """The depth of the audit is that of the certificate, here at its limit, to a tenth of a millimetre."""
    problem, motion = good
    size = {"box": [3.0, 3.0, 3.0], "cylinder": [1.5, 3.0], "sphere": [1.5, 0.0], "capsule": [1.2, 0.8]}[kind]
    room = shape_of(kind, pose([0.1, 0.0, 0.3], rotation_vector_to_matrix([0.3, 0.2, 0.5])), np.array(size))
    least = float(room.depth(tool_pose(problem.cell, motion.q)[:, :3, 3]).min())
    for clearance_m, is_kept in ((least - 1e-4, True), (least + 1e-4, False)):
        found = find_faults(around(problem, keep_in=(replace(room, clearance_m=clearance_m),)), motion)
        assert any(fault.rule == "keep_in" for fault in found) != is_kept
