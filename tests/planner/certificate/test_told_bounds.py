"""What a certificate tells is a bound: nothing at any instant is worse than `value`, and little is better."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import profiles
from planner.cell import Box, parse_cell
from planner.certificate import Examination, certify
from planner.certificate.clearance import moving_heights, pair_gaps, shape_gaps
from planner.certificate.exits import FREE_M
from planner.certificate.flight import flights_of
from planner.certificate.grip import felt_sizes
from planner.certificate.safety_limits import momentum_sizes, power_sizes
from planner.certificate.samples import MotionSamples, ticks_around_release
from planner.certificate.stopping import stopping_distances, stopping_times
from planner.certificate.tool import SINGULARITY_WINDOW_S
from planner.certificate.torque import torque_sizes
from planner.geometry import tool_pose
from planner.kinematics import signed_singularity_distances
from planner.planning import plan
from planner.problem import PointRelease, ThrowProblem
from planner.request import problem_from_request
from planner.seeds import candidates
from tests.planner.problems import cell, feasible_states

A_TICK = 40  # [-] instants that are looked at
PARTS = 400  # [-] of the way out of the grip

SIZES = {
    "joint_torque": lambda motion, arm: torque_sizes(motion, arm) / motion.limits.tau_max[:, None],
    "tcp_speed": lambda motion, arm: arm.tool_speed,
    "elbow_speed": lambda motion, arm: arm.elbow_speed,
    "momentum": momentum_sizes,
    "power": power_sizes,
    "stopping_time": stopping_times,
    "stopping_distance": stopping_distances,
}
GAPS = {"self_collision": pair_gaps, "floor": moving_heights, "keep_out": shape_gaps}


def boxed(name):
    here = cell(name)
    box = Box(np.array([-0.9, 0.5, 0.0]), np.array([0.9, 0.9, 1.2]))
    return replace(here, surroundings=replace(here.surroundings, keep_out=(box,)))


def motions(name):
    """Motions of two back ends in a cell: to joint states by Ruckig, and to the same by cubic profiles."""
    here = boxed(name)
    for known, trajectory in feasible_states(here, 3, 11, spread=1.0):
        yield known, trajectory
        yield known, profiles.solve(known, candidates(known)[0], "cubic").trajectory


@pytest.mark.parametrize("name", ["ur5e-sim", "ur5-sim", "ur10e-sim"])
def test_every_value_is_a_bound_and_a_close_one(name):
    for problem, trajectory in motions(name):
        motion = MotionSamples(problem, trajectory)
        certificate = certify(problem, trajectory)
        t = np.linspace(0.0, trajectory.duration_s, A_TICK * len(trajectory.q))
        arm = motion.at(t)
        for check in certificate.checks:
            if not check.ok:
                continue
            if check.name in SIZES:
                found = SIZES[check.name](motion, arm).max()
                found *= check.limit if check.name == "joint_torque" else 1.0
                room = max(0.005 * check.limit, 0.011 * found)
                assert found <= check.value <= found + room, check
            if check.name in GAPS:
                ends = motion.body.end_points(arm.X_WL)
                found = GAPS[check.name](motion, t, ends).min()
                assert found - 1e-3 <= check.value <= found, check
            if check.name == "grip_acceleration":
                found = felt_sizes(arm, False)[t <= trajectory.release_time_s].max()
                assert found <= check.value <= found + 0.005 * check.limit, check
            if check.name == "singularity_distance":
                first, last = trajectory.t[list(ticks_around_release(trajectory, SINGULARITY_WINDOW_S))]
                q = trajectory.at(np.linspace(first, last, 5000))[0]
                found = np.abs(signed_singularity_distances(problem.cell.robot, q)).min()
                assert found - 1e-3 <= check.value <= found, check


def test_the_way_out_of_the_grip_is_a_bound():
    """An angle of 1.533 rad was told as 1.367: the object is still in its place for a part of the first interval."""
    here = cell()
    thing = replace(here.object, mass_kg=0.01, radius_m=0.03)
    here = replace(here, object=thing)
    start = [-0.98378250842, -1.15008543454, 1.68580645551, -1.39162950210, -2.06500363711, 0.17959599871]
    release = PointRelease(
        np.array([-0.03378233, 0.15593561, 0.85276661]), np.array([0.08381447, 0.60153345, -0.12862865])
    )
    problem = ThrowProblem(here, np.array(start), release, here.limits)
    found = [each for each in map(certified_from(problem), candidates(problem)[:4]) if each is not None]
    assert found
    for trajectory in found:
        check = certify(problem, trajectory).check("opening_direction")
        assert widest_way(problem, trajectory) <= check.value <= check.limit


def certified_from(problem):
    def trajectory_of(candidate):
        trajectory = profiles.solve(problem, candidate, "trapezoid").trajectory
        return trajectory if not Examination(problem, trajectory).failures else None

    return trajectory_of


def widest_way(problem, trajectory):
    """The widest angle of the object's displacement in the tool, sampled densely from the nominal release."""
    here = problem.cell
    released = trajectory.release_time_s
    motion = MotionSamples(problem, trajectory)
    arm = motion.at(np.array([released]))
    s = np.linspace(0.0, 0.3, PARTS)[1:]
    fallen = arm.p_WT.T + s[:, None] * arm.v_WT.T + 0.5 * s[:, None] ** 2 * np.array([0.0, 0.0, -problem.gravity])
    X_WT = tool_pose(here, trajectory.at(released + s)[0])
    apart = np.einsum("kij,ki->kj", X_WT[:, :3, :3], fallen - X_WT[:, :3, 3])
    size = np.linalg.norm(apart, axis=1)
    until = int(np.argmax(size >= here.object.way_out_m))
    way = slice(int(np.argmax(size >= FREE_M)), until)
    cosines = apart[way] @ here.gripper.opening_direction / size[way]
    return float(np.arccos(np.clip(cosines, -1.0, 1.0)).max())


LARGE_OBJECT = """
robot = "ur30"
[tool]
tcp_position_m = [0, 0, 0.38]
mass_kg = 8.0
capsules = [{ from_m = [0, 0, 0], to_m = [0, 0, 0.2], radius_m = 0.09 }]
[limits]
joint_acceleration_rad_s2 = 8
[surroundings]
flight_clearance_m = 0.001
keep_out = [{ lower_m = [0.9, -0.6, 0], upper_m = [1.5, 0.6, 0.5] }]
[object]
mass_kg = 10.0
radius_m = 0.15
[gripper]
jitter_s = 0.0015
hold_acceleration_m_s2 = [30, 30, 40]
[link]
kind = "sim"
"""


@pytest.mark.parametrize(
    ("place", "acceleration", "jerk"), [([1.38, 0.03, 0.5], 3.25, 98.0), ([1.36, 0.33, 0.5], 4.02, 126.0)]
)
def test_the_distance_of_a_flight_from_what_it_was_gripped_beside_is_a_bound(place, acceleration, jerk):
    here = parse_cell(LARGE_OBJECT, "c")
    limits = {"acceleration": acceleration, "jerk": jerk}
    problem = problem_from_request({"release": {"kind": "target", "position": place}, "limits": limits}, here)
    found = plan(problem)
    flights = flights_of(MotionSamples(problem, found.trajectory))
    check = found.certificate.check("flight_clearance")
    item = flights.names.index(check.detail)
    assert item in flights.gripped
    assert check.limit == flights.required[item]
    least = np.inf
    for released_s in flights.released_s + np.linspace(-0.005, 0.005, 21):
        t = np.linspace(released_s, flights.end[1], 2000)
        gaps = flights.gaps_along(flights.positions(np.full(len(t), released_s), t), t)
        least = min(least, gaps[item].min() + flights.required[item])
    assert least - 0.01 <= check.value <= least
