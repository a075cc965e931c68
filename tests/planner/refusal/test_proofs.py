"""What refusals call proven: the bounds hold for random motions, and both refusals say what was proven and tried."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.certificate import certify
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed
from planner.geometry import body_model, tool_pose, tool_state
from planner.planning import plan
from planner.problem import (
    JointRelease,
    Opening,
    PointRelease,
    PoseRelease,
    TargetRelease,
    ThrowProblem,
)
from planner.refusal.blocked_postures import blocked_postures
from planner.refusal.proofs import (
    farthest_from_shoulder,
    fastest_tool,
    least_speed_within_reach,
    proven_violations,
)
from planner.request import problem_from_request
from planner.seeds import candidates
from tests.planner.problems import contact_cell as cell
from tests.planner.problems import feasible_states, ideal_cell, joint_problem, with_boxes

ARMS = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim", "sdu-table")
RANDOM_STATES = 4000


@pytest.mark.parametrize("name", ARMS)
def test_no_random_state_is_beyond_the_bounds_on_reach_and_speed(name):
    problem = joint_problem(name)
    rng = np.random.default_rng(4)
    q = rng.uniform(-np.pi, np.pi, (RANDOM_STATES, 6))
    qd = rng.choice([-1.0, 1.0], (RANDOM_STATES, 6)) * problem.limits.qd_max
    tool = tool_state(problem.cell, q, qd)
    shoulder, reach = farthest_from_shoulder(problem)
    distance = np.linalg.norm(tool.p_WT - shoulder, axis=1)
    speed = np.linalg.norm(tool.v_WT, axis=1)
    assert 0.75 * reach < distance.max() <= reach
    assert speed.max() <= fastest_tool(problem)
    assert all(s <= fastest_tool(problem, p) for s, p in zip(speed[:200], tool.p_WT[:200], strict=True))


def test_no_random_throw_within_reach_is_slower_than_the_bound():
    problem = joint_problem()
    rng = np.random.default_rng(5)
    shoulder, reach = farthest_from_shoulder(problem)
    for target in rng.uniform(-4.0, 4.0, (20, 3)):
        away = rng.normal(size=(20_000, 3))
        p = shoulder + reach * rng.uniform(size=(20_000, 1)) ** 0.2 * away / np.linalg.norm(away, axis=1)[:, None]
        d = target - p  # closed form of the least speed: v^2 = g (|d| + d_z)
        least = np.sqrt(problem.gravity * np.maximum(np.linalg.norm(d, axis=1) + d[:, 2], 0.0)).min()
        bound = least_speed_within_reach(problem, target)
        assert bound <= least
        assert least - bound < 0.25


def test_nothing_that_was_certified_is_called_impossible():
    for known, motion in feasible_states(cell(), 30, seed=8):
        assert isinstance(known.release, JointRelease)
        X_WT, V_WT = tool_state(cell(), known.release.q, known.release.qd)
        for release in (known.release, PoseRelease(X_WT, V_WT), PointRelease(X_WT[:3, 3], V_WT[:3])):
            assert proven_violations(replace(known, release=release)) == []
        assert motion.release_time_s > 0.0


TURNED = np.diag([1.0, -1.0, -1.0, 1.0])
IMPOSSIBLE = {
    "reach, point": ("reach", PointRelease(np.array([1.6, 0.2, 0.4]), np.array([0.5, 0.0, 0.5]))),
    "reach, pose": ("reach", PoseRelease(np.eye(4) + 2.0 * np.eye(4, k=3), np.zeros(6))),
    "tool speed": ("tcp_speed", PointRelease(np.array([0.5, 0.2, 0.5]), np.array([4.0, 0.0, 2.0]))),
    "turning": ("joint_velocity", PoseRelease(TURNED + 0.4 * np.eye(4, k=3), np.array([0, 0, 0, 0, 0, 25.0]))),
    "floor": ("floor", PointRelease(np.array([0.5, 0.2, -0.1]), np.array([0.5, 0.0, 0.5]))),
    "target below the floor": ("flight_clearance", TargetRelease(np.array([1.2, 0.3, -0.5]))),
    "range": ("tcp_speed", TargetRelease(np.array([5.0, 0.0, 0.0]))),
    "requested speed": ("release_velocity", TargetRelease(np.array([2.4, 0.0, 0.0]), max_speed_m_s=1.0)),
    "joint position": ("joint_position", JointRelease(cell().home + 5.0 * np.eye(6)[2], np.ones(6))),
    "joint velocity": ("joint_velocity", JointRelease(cell().home + 0.3, 3.5 * np.eye(6)[0])),
    "singularity": ("singularity_distance", JointRelease(cell().home * [1, 1, 1, 1, 0, 1], 0.1 * np.ones(6))),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_an_impossible_release_is_refused_with_proof_and_something_nearest(case):
    name, release = IMPOSSIBLE[case]
    problem = joint_problem(release=release)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert name in [violation.constraint for violation in refusal.value.violations]
    assert all(violation.proven for violation in refusal.value.violations)
    assert refusal.value.nearest is not None
    assert plan(problem_from_request(refusal.value.nearest, problem.cell)).certificate.valid


TURNED_AWAY = cell().home + 1.2 * np.eye(6)[0]  # [rad] from what is below the home


def with_box(lower, upper):
    """The shipped cell with one keep-out box."""
    return with_boxes(cell(), (lower, upper))


def test_a_start_that_is_blocked_is_refused_with_proof_and_without_a_search():
    start = TURNED_AWAY
    tool = tool_pose(cell(), start)[:3, 3]
    here = with_box(tool - [0.1, 0.1, 0.3], tool - [0.0, 0.0, -0.01])
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(cell=here, start=start, release=TargetRelease(np.array([1.3, 0.2, 0.0]))))
    (violation,) = refusal.value.violations
    assert (violation.constraint, violation.limit, violation.proven) == ("keep_out", 0.02, True)
    assert violation.value < 0.0
    assert violation.detail.endswith("at the start")
    assert not refusal.value.attempts


@pytest.mark.parametrize("release", [lambda place: PointRelease(place, np.array([1.0, 0.0, 0.0])), TargetRelease])
def test_a_place_in_millimetres_is_refused_as_such(release):
    here = cell()
    for place, far in (([1200.0, 300.0, 0.0], True), ([5.0, 0.0, 0.3], False)):
        asked = release(np.array(place))
        with pytest.raises(Infeasible) as refusal:
            plan(ThrowProblem(here, here.home, asked, here.limits))
        assert any("positions are in metres" in v.detail for v in refusal.value.violations) == far
        assert all(v.proven for v in refusal.value.violations)


def test_a_place_in_a_keep_out_box_is_refused_with_the_box_s_name():
    place = np.array([0.6, 0.2, 0.5])
    here = with_box(place - 0.1, place + 0.1)
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(cell=here, release=PointRelease(place, np.array([1.0, 0.0, 0.5]))))
    (violation,) = (each for each in refusal.value.violations if each.constraint == "keep_out")
    assert violation.detail == "object, box 0, at the release"
    assert violation.value == pytest.approx(-here.object.radius_m)
    assert violation.proven


@pytest.mark.parametrize("z", [-2e-6, -5e-4])
def test_a_target_just_below_the_floor_is_refused_with_proof(z):
    (violation,) = proven_violations(joint_problem(release=TargetRelease(np.array([1.2, 0.3, z]))))
    assert (violation.constraint, violation.value) == ("flight_clearance", pytest.approx(z))


@pytest.mark.slow
def test_an_object_is_dropped_close_behind_a_wall():
    """Flights keep off a wall by 5 mm, but not where the target is nearer to it, as here by 1 mm."""
    here = with_box([0.75, -1.0, 0.0], [0.8, 1.0, 0.5])
    release = TargetRelease(np.array([0.821, 0.0, 0.0]))
    found = plan(joint_problem(cell=here, release=release, release_window_s=0.005, landing_tolerance_m=0.02))
    assert 0.0 <= found.certificate.check("flight_clearance").value <= 0.001


def test_a_target_within_a_keep_out_box_is_refused_and_offered_on_its_nearer_side():
    here = with_boxes(ideal_cell(), ([1.0, -0.5, 0.0], [1.3, 0.8, 0.4]))
    problem = joint_problem(cell=here, release=TargetRelease(np.array([1.2, 0.2, 0.0])))
    on_top = replace(problem, release=TargetRelease(np.array([1.2, 0.2, 0.4])))
    assert proven_violations(on_top) == []
    with pytest.raises(Infeasible) as refusal:
        plan(replace(problem, release=TargetRelease(np.array([1.2, 0.2, 0.1]))))
    (violation,) = refusal.value.violations
    assert (violation.constraint, violation.proven) == ("flight_clearance", True)
    assert violation.value == pytest.approx(-0.1 - here.object.radius_m)
    assert violation.detail == "box 0: the target is within it"
    nearest = problem_from_request(refusal.value.nearest, here)
    assert plan(nearest).certificate.valid
    assert nearest.release.p_W[0] > 1.3
    assert np.linalg.norm(nearest.release.p_W - [1.2, 0.2, 0.1]) < 0.201


@pytest.mark.parametrize(("x", "depth"), [(1.0008, 0.0008), (1.02, 0.02), (1.28, 0.02)])
def test_a_target_in_the_footprint_of_a_wall_is_refused_with_proof(x, depth):
    """From a millimetre within, the object could touch the floor before it touches the wall."""
    here = with_box([1.0, -0.5, 0.0], [1.3, 0.8, 1.6])
    problem = joint_problem(cell=here, release=TargetRelease(np.array([x, 0.2, 0.0])))
    (violation,) = proven_violations(problem)
    assert (violation.constraint, violation.value) == ("flight_clearance", pytest.approx(-depth - 0.02))
    fits = replace(problem, release=TargetRelease(np.array([1.0 - here.object.radius_m, 0.2, 0.0])))
    below = with_box([1.0, -0.5, 2.0 * here.object.radius_m], [1.3, 0.8, 1.6])  # there is just room under it
    narrow = with_box([1.0, -0.5, 0.005], [1.3, 0.8, 1.6])
    (lacks,) = proven_violations(replace(problem, release=TargetRelease(np.array([0.999, 0.2, 0.0]))))
    assert (lacks.value, lacks.detail) == (pytest.approx(0.001 - 0.02), "box 0: the object does not fit beside it")
    (gap,) = proven_violations(replace(problem, cell=narrow, release=TargetRelease(np.array([1.1, 0.2, 0.0]))))
    assert gap.value == pytest.approx(0.005 - 2.0 * here.object.radius_m)
    assert gap.detail == "box 0: the object does not fit under it"
    assert proven_violations(fits) == proven_violations(replace(problem, cell=below)) == []


def test_a_bin_around_the_home_is_refused_with_proof_and_offered_farther_away():
    below = tool_pose(cell(), cell().home)[:3, 3] * [1.0, 1.0, 0.0]
    problem = joint_problem(start=TURNED_AWAY, release=TargetRelease(below, opening=Opening(0.1, 0.6)))
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    (violation,) = refusal.value.violations
    assert (violation.constraint, violation.proven) == ("way_home", True)
    assert "cell's home" in violation.detail
    assert "bin" in violation.detail
    assert plan(problem_from_request(refusal.value.nearest, problem.cell)).certificate.valid


def test_a_start_as_close_as_the_rule_allows_is_no_proof():
    low = cell().home + np.array([0.0, 0.5, 0.0, -0.5, 0.0, 0.0])  # the tool is lower than the shoulder
    turned_away = low + 1.2 * np.eye(6)[0]
    room = float(body_model(cell()).clearances(low[None]).floor[0])
    for start, raised, names in (
        (low, room - 1e-4, []),
        (low, room + 1e-4, ["floor"]),
        (low, room + 1e-2, ["floor"]),
        (turned_away, room + 1e-4, ["floor"]),
        (turned_away, room + 1e-2, ["floor", "way_home"]),
    ):
        floor = replace(cell().surroundings, floor_z_m=cell().surroundings.floor_z_m + raised)
        problem = joint_problem(cell=replace(cell(), surroundings=floor, home=low), start=start)
        assert [violation.constraint for violation in blocked_postures(problem)] == names


def test_a_search_in_vain_proves_nothing_and_says_what_it_tried():
    # The joints are too slow in the best of thousands of postures, but a cleverer one is not ruled out.
    problem = joint_problem(release=TargetRelease(np.array([2.6, 0.0, 0.0])))
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    assert not any(violation.proven for violation in refusal.value.violations)
    assert refusal.value.nearest is not None


def test_a_back_end_that_makes_no_motion_is_a_search_in_vain():
    # A ramp needs a run-up, which would begin beyond the first joint's limit, and more of it than the velocity takes.
    near_limit = np.array([cell().limits.q_lower[0] + 0.29, *cell().home[1:]])
    release = JointRelease(near_limit, 2.9 * np.eye(6)[0])
    with pytest.raises(Infeasible) as refusal:
        plan(joint_problem(backend="ramp", start=near_limit, release=release))
    (violation,) = refusal.value.violations
    assert violation.constraint == "motion"
    assert "ramp: no motion from" in violation.detail
    assert not violation.proven


def test_a_search_that_the_time_limit_ends_says_so_and_carries_what_it_has():
    problem = joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])), time_limit_s=1e-9)
    with pytest.raises(SolverFailed) as failure:
        plan(problem)
    assert failure.value.status == TIME_LIMIT
    assert failure.value.violations
    assert not any(violation.proven for violation in failure.value.violations)
    assert failure.value.nearest is not None


@pytest.mark.parametrize(("q5", "speed", "least"), [(0.08, 2.9, 0.0), (0.08, 1.0, 0.049), (-0.08, 2.9, 0.0)])
def test_a_wrist_that_must_come_too_near_its_singularity_is_refused_with_proof(q5, speed, least):
    """However it brakes: at 2.9 rad/s and 15 rad/s^2 a joint turns 0.126 rad within 50 ms, before and after."""
    here = cell()
    q = here.home.copy()
    q[4] = q5
    qd = np.zeros(6)
    qd[4] = speed
    limits = replace(here.limits, singularity_distance_min=0.06)
    problem = ThrowProblem(here, here.home, JointRelease(q, qd), limits)
    (violation,) = proven_violations(problem)
    assert (violation.constraint, violation.proven) == ("singularity_distance", True)
    assert violation.value == pytest.approx(least, abs=2e-3)
    slow = replace(problem, release=JointRelease(q, 0.2 * qd))
    assert proven_violations(slow) == []
    for each in candidates(problem):
        made = ruckig_otg.solve(problem, each).trajectory
        check = certify(problem, made).check("singularity_distance")
        assert not check.ok
        assert check.value <= violation.value + 1e-3
