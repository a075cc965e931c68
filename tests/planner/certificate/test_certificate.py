"""The certificate: spoilt trajectories, one a check; bounds between samples; agreement with dense sampling."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import profiles, ruckig_otg
from planner.cell import Box, Safety
from planner.certificate import Examination, certify, checks, landing_errors
from planner.certificate.bounds import joint_rates, point_bound
from planner.certificate.samples import ticks_around_release
from planner.errors import InvalidProblem
from planner.geometry import levers, tool_state
from planner.kinematics import forward, signed_singularity_distances
from planner.planning import plan
from planner.problem import JointRelease, PointRelease, TargetRelease, ThrowProblem
from planner.rotations import pose
from planner.seeds import Candidate, candidates
from planner.trajectory import Trajectory, integrate
from tests.planner.problems import cell, feasible_states, joint_problem, point_problem, pose_problem, random_state

EVERY_CHECK = {
    "start",
    "joint_position",
    "joint_velocity",
    "joint_acceleration",
    "joint_jerk",
    "tcp_speed",
    "floor",
    "keep_in",
    "keep_out",
    "self_collision",
    "singularity_distance",
    "joint_torque",
    "elbow_speed",
    "momentum",
    "power",
    "stopping_time",
    "stopping_distance",
    "release_position",
    "release_velocity",
    "end_at_rest",
    "continuity",
    "flight_clearance",
    "grip_acceleration",
    "opening_direction",
}


def boxed_problem():
    """A throw inside a keep-in box and beside a keep-out box, with a gripper; the unspoilt trajectory keeps all."""
    plain = joint_problem()
    around = replace(
        plain.cell.surroundings,
        keep_in=(
            Box(np.array([-1.0, -1.0, 0.05]), np.array([1.0, 1.0, 1.5])),
            Box(np.array([-0.55, -0.9, 0.02]), np.array([-0.2, 0.9, 1.5])),
        ),
        keep_out=(Box(np.array([-0.9, 0.25, 0.0]), np.array([0.9, 0.9, 1.2])),),
    )
    gripper = replace(
        plain.cell.gripper,
        opening_direction=np.array([0.0, 0.0, 1.0]),
        opening_cone_rad=1.5,
        hold_acceleration_m_s2=np.array([60.0]),
    )
    safety = Safety(4.0, 0.5, 10.0, 100.0, 0.15, 0.1)
    return joint_problem(cell=replace(plain.cell, surroundings=around, gripper=gripper, safety=safety))


@pytest.fixture(scope="module")
def good():
    problem = boxed_problem()
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    certificate = certify(problem, trajectory)
    assert certificate.valid, certificate.failures
    assert {check.name for check in certificate.checks} == EVERY_CHECK
    return problem, trajectory


def scaled(trajectory, joint, factor):
    """The same motion of one joint (or all), `factor` times as far."""
    rows = slice(None) if joint is None else joint
    arrays = [np.array(x) for x in (trajectory.q, trajectory.qd, trajectory.qdd)]
    arrays[0][:, rows] = arrays[0][0, rows] + factor * (arrays[0][:, rows] - arrays[0][0, rows])
    for array in arrays[1:]:
        array[:, rows] *= factor
    return Trajectory(trajectory.sample_rate_hz, *arrays, release_index=trajectory.release_index)


def shifted(trajectory, joint, offset):
    q = np.array(trajectory.q)
    q[:, joint] += offset
    return replace(trajectory, q=q)


def beyond(problem, trajectory, name, joint=None, share=1.001):
    """Scales the motion until the named check is just beyond its limit."""
    check = certify(problem, trajectory).check(name)
    return scaled(trajectory, joint, share * check.limit / abs(check.value))


def one_sample_off(trajectory, array, value):
    changed = np.array(getattr(trajectory, array))
    changed[40, 2] += value
    return replace(trajectory, **{array: changed})


def cut(trajectory, first, last):
    arrays = [x[first:last] for x in (trajectory.q, trajectory.qd, trajectory.qdd)]
    return Trajectory(trajectory.sample_rate_hz, *arrays, release_index=trajectory.release_index - first)


def worst_joint(problem, trajectory, name):
    return problem.cell.robot.joint_names.index(certify(problem, trajectory).check(name).detail)


SPOILT = {
    "start": lambda p, t: shifted(t, 0, 1e-4),
    "start (moving)": lambda p, t: cut(t, 20, None),
    "joint_position": lambda p, t: scaled(t, 2, 40.0),
    "joint_velocity": lambda p, t: beyond(p, t, "joint_velocity", worst_joint(p, t, "joint_velocity")),
    "joint_acceleration": lambda p, t: beyond(p, t, "joint_acceleration", worst_joint(p, t, "joint_acceleration")),
    "joint_jerk": lambda p, t: beyond(p, t, "joint_jerk", worst_joint(p, t, "joint_jerk")),
    "tcp_speed": lambda p, t: beyond(p, t, "tcp_speed", share=1.4),
    "floor": lambda p, t: shifted(t, 1, 1.3),
    "keep_in": lambda p, t: shifted(t, 0, 1.0),
    "keep_out": lambda p, t: shifted(t, 0, -1.57),
    "self_collision": lambda p, t: shifted(t, 2, 1.45),
    "singularity_distance": lambda p, t: shifted(t, 4, -t.q[t.release_index, 4]),
    "joint_torque": lambda p, t: beyond(p, t, "joint_torque", share=6.0),
    "elbow_speed": lambda p, t: beyond(p, t, "elbow_speed", share=1.2),
    "momentum": lambda p, t: beyond(p, t, "momentum", share=1.2),
    "power": lambda p, t: beyond(p, t, "power", share=1.2),
    "stopping_time": lambda p, t: beyond(p, t, "stopping_time", share=1.2),
    "stopping_distance": lambda p, t: beyond(p, t, "stopping_distance", share=1.2),
    "release_position": lambda p, t: shifted(t, 3, 2e-5),
    "release_velocity": lambda p, t: scaled(t, 1, 1.0005),
    "end_at_rest": lambda p, t: cut(t, 0, -15),
    "flight_clearance": lambda p, t: shifted(t, 0, -1.57),
    "grip_acceleration": lambda p, t: beyond(p, t, "grip_acceleration", share=6.0),
    "opening_direction": lambda p, t: shifted(t, 3, np.pi),
    "continuity": lambda p, t: one_sample_off(t, "qd", 1e-5),
    "continuity (position)": lambda p, t: one_sample_off(t, "q", 1e-5),
    "continuity (acceleration)": lambda p, t: one_sample_off(t, "qdd", 1e-2),
}


@pytest.mark.parametrize("name", SPOILT)
def test_each_spoilt_trajectory_is_caught(good, name):
    problem, trajectory = good
    certificate = certify(problem, SPOILT[name](problem, trajectory))
    check = certificate.check(name.split(" (")[0])
    assert not certificate.valid
    assert not check.ok
    assert check.margin < 0.0


@pytest.mark.parametrize(
    ("name", "attribute", "joint"),
    [("joint_position", "q_upper", 2), ("joint_velocity", "qd_max", 0), ("joint_torque", "tau_max", 1)],
)
def test_the_arms_own_limits_are_checked_whatever_the_problem_says(good, name, attribute, joint):
    problem, trajectory = good
    loose = replace(problem.limits, **{attribute: np.full(6, 1e3)})
    with pytest.raises(InvalidProblem, match=rf"limits\.{attribute}\[0\]: 1000 is beyond the arm's own limit"):
        replace(problem, limits=loose)
    unchecked = replace(problem)
    object.__setattr__(unchecked, "limits", loose)
    check = certify(unchecked, scaled(trajectory, None, 40.0)).check(name)
    assert not check.ok
    assert check.limit <= getattr(problem.cell.robot, attribute).max() * 1.001


def test_the_tool_speed_of_the_arm_is_checked_whatever_the_limits_say(good):
    problem, trajectory = good
    fastest = certify(problem, trajectory).check("tcp_speed").value
    safety = replace(problem.cell.safety, tool_speed_m_s=0.99 * fastest)
    here = replace(problem.cell, safety=safety, limits=replace(problem.limits, tcp_speed_max=20.0))
    check = certify(replace(problem, cell=here, limits=here.limits), trajectory).check("tcp_speed")
    assert (check.ok, check.limit) == (False, 0.99 * fastest)


@pytest.mark.parametrize("name", SPOILT)
def test_the_first_failure_of_a_spoilt_trajectory_is_one_of_its_certificate(good, name):
    problem, trajectory = good
    spoilt = SPOILT[name](problem, trajectory)
    examination = Examination(problem, spoilt)
    certificate = certify(problem, spoilt)
    assert examination.first_failure in certificate.failures
    assert repr(examination.certificate) == repr(certificate)  # some values are no numbers, which equal nothing


def test_a_valid_trajectory_has_no_first_failure_and_a_rejected_one_few_checks(good, monkeypatch):
    problem, trajectory = good
    assert Examination(problem, trajectory).first_failure is None
    made = []
    counted = {check: (lambda m, c=check: made.append(c) or c(m)) for check in checks.MOTION_CHECKS}
    for name in ("MOTION_CHECKS", "MOST_TELLING"):
        monkeypatch.setattr(checks, name, tuple(counted[check] for check in getattr(checks, name)))
    failure = Examination(problem, SPOILT["self_collision"](problem, trajectory)).first_failure
    assert failure is not None
    assert failure.name == "self_collision"
    assert len(made) == 1


def test_a_throw_that_lacks_its_window_alone_fails_that_last():
    aimed = joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])))
    windowed = replace(aimed, release_window_s=0.004, landing_tolerance_m=0.0001)
    trajectory = plan(aimed).trajectory
    failure = Examination(windowed, trajectory).first_failure
    assert [check.name for check in certify(windowed, trajectory).failures] == ["landing_window"]
    assert failure is not None
    assert failure.name == "landing_window"
    broken = Examination(windowed, shifted(trajectory, 0, 1e-4)).first_failure
    assert broken is not None
    assert broken.name != "landing_window"


def test_the_list_spoils_every_check():
    assert {name.split(" (")[0] for name in SPOILT} == EVERY_CHECK


def test_a_missed_target_and_a_scattering_window_are_caught():
    here = cell()
    problem = joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])))
    answer = plan(problem).trajectory
    assert certify(problem, answer).check("landing").ok
    assert not certify(problem, shifted(answer, 0, 0.001)).check("landing").ok
    strict = replace(problem, release_window_s=0.02, landing_tolerance_m=1e-4)
    window = certify(strict, answer).check("landing_window")
    assert not window.ok
    assert window.value > 1e-4
    delay_s = window.at_s - answer.release_time_s
    errors = landing_errors(problem, answer, np.array([delay_s, *np.linspace(-0.02, 0.02, 9)]))
    assert errors[0] == errors.max()
    assert window.detail == f"released {1e3 * abs(delay_s):.3g} ms {'early' if delay_s < 0.0 else 'late'}"
    generous = replace(problem, release_window_s=0.02, landing_tolerance_m=window.value * 1.01)
    assert certify(generous, answer).check("landing_window").ok
    assert here.limits.tcp_speed_max >= certify(problem, answer).check("tcp_speed").value


def test_free_velocity_bounds_of_a_target_are_checked():
    problem = joint_problem(release=TargetRelease(np.array([1.3, 0.2, 0.0])))
    answer = plan(problem).trajectory
    slow = replace(problem, release=replace(problem.release, max_speed_m_s=0.5))
    steep = replace(problem, release=replace(problem.release, min_elevation_rad=1.5))
    far = replace(problem, release=replace(problem.release, min_horizontal_distance_m=5.0))
    assert not certify(slow, answer).check("release_velocity").ok
    assert not certify(steep, answer).check("release_velocity").ok
    assert not certify(far, answer).check("release_position").ok


def test_not_a_number_is_no_motion(good):
    problem, trajectory = good
    for array in ("q", "qd", "qdd"):
        assert not certify(problem, one_sample_off(trajectory, array, np.nan)).valid


def test_another_sample_rate_is_no_motion_of_this_controller(good):
    problem, trajectory = good
    assert not certify(problem, replace(trajectory, sample_rate_hz=250.0)).valid


def test_bounds_hold_between_samples():
    """At 125 Hz a joint can pass its limits between two samples that keep them: the closed forms see it."""
    problem = joint_problem("ur5-sim")
    dt = problem.dt
    jerk = np.zeros((4, 6))
    jerk[:, 0] = np.array([-1.0, 1.0, 1.0, -1.0]) * 100.0
    peak = integrate(problem.start, np.full(6, 0.0), np.zeros(6), jerk, dt)
    top = Trajectory(125.0, peak[0], peak[1], peak[2], release_index=4)
    fine = top.at(np.linspace(0.0, top.duration_s, 4001))
    for name, index in (("joint_velocity", 1), ("joint_position", 0)):
        values = np.abs(fine[index][:, 0] - (fine[0][0, 0] if index == 0 else 0.0))
        samples = np.abs((top.q, top.qd)[index][:, 0] - (top.q[0, 0] if index == 0 else 0.0))
        between = (values.max() + samples.max()) / 2.0
        if values.max() > samples.max() + 1e-12:
            bound = np.full(6, between)
            limits = (
                replace(problem.limits, qd_max=bound)
                if index == 1
                else replace(problem.limits, q_lower=top.q[0] - between, q_upper=top.q[0] + between)
            )
            assert not certify(replace(problem, limits=limits), top).check(name).ok


def test_turning_points_between_samples_are_found():
    """One joint swings through a vertex half way between two ticks."""
    problem = joint_problem("ur5-sim")
    dt = 1.0 / 125.0
    qdd = np.zeros((2, 6))
    qdd[:, 0] = [4.0, -4.0]
    jerk = np.diff(qdd, axis=0) / dt
    q, qd, qdd = integrate(problem.start, np.full(6, 1.0), qdd[0], jerk, dt)
    swing = Trajectory(125.0, q, qd, qdd, release_index=1)
    vertex = swing.at(dt / 2.0)[1][0]
    assert vertex > swing.qd[:, 0].max()
    limits = replace(problem.limits, qd_max=np.full(6, (vertex + swing.qd[:, 0].max()) / 2.0))
    assert not certify(replace(problem, limits=limits), swing).check("joint_velocity").ok
    wider = replace(limits, qd_max=np.full(6, vertex * 1.0001))
    assert certify(replace(problem, limits=wider), swing).check("joint_velocity").ok


def random_trajectories(count=6, seed=11):
    """Launches to random states, whatever stands in the way."""
    rng = np.random.default_rng(seed)
    here = cell()
    found = []
    for _ in range(count):
        q, qd = random_state(here, rng)
        problem = joint_problem(release=JointRelease(q, qd))
        found.append((problem, ruckig_otg.solve(problem, Candidate(q, qd, 0.0, "random")).trajectory))
    return found


def test_rates_bound_the_tools_true_derivatives():
    for problem, trajectory in random_trajectories():
        robot = problem.cell.robot
        X_FT = problem.cell.tool.X_FT
        h = trajectory.dt / 40.0
        middles = (trajectory.t[:-1] + trajectory.dt / 2.0)[:, None] + h * np.arange(-2, 3)
        p = forward(robot, trajectory.at(middles)[0], X_FT)[..., :3, 3]
        lever = levers(robot, 6, float(np.linalg.norm(X_FT[:3, 3])))
        rates = joint_rates(trajectory)
        stencils = (
            (p[:, 3] - p[:, 1]) / (2 * h),
            (p[:, 3] - 2 * p[:, 2] + p[:, 1]) / h**2,
            (p[:, 4] - 2 * p[:, 3] + 2 * p[:, 1] - p[:, 0]) / (2 * h**3),
            (p[:, 4] - 4 * p[:, 3] + 6 * p[:, 2] - 4 * p[:, 1] + p[:, 0]) / h**4,
        )
        for order, (derivative, noise) in enumerate(zip(stencils, (1e-9, 1e-5, 0.5, 1e4), strict=True), start=1):
            assert np.all(np.linalg.norm(derivative, axis=1) <= point_bound(lever, rates, order) + noise), order


def test_a_certified_bound_holds_at_every_instant_of_a_dense_look():
    for problem, trajectory in random_trajectories(seed=12):
        certificate = certify(problem, trajectory)
        t = np.linspace(0.0, trajectory.duration_s, 20 * len(trajectory.q))
        q, qd, qdd = trajectory.at(t)
        _, V_WT = tool_state(problem.cell, q, qd)
        speed = np.linalg.norm(V_WT[:, :3], axis=1).max()
        check = certificate.check("tcp_speed")
        assert speed <= check.limit or not check.ok
        assert check.value == pytest.approx(speed, rel=0.05)
        for name, values, limit in (
            ("joint_velocity", qd, problem.limits.qd_max),
            ("joint_acceleration", qdd, problem.limits.qdd_max),
        ):
            share = (np.abs(values) / limit).max()
            check = certificate.check(name)
            assert check.value / check.limit == pytest.approx(share, rel=1e-4)
        lowest = (q - problem.limits.q_lower).min(), (problem.limits.q_upper - q).min()
        assert certificate.check("joint_position").margin == pytest.approx(min(lowest), abs=1e-5)


@pytest.mark.parametrize("arm", ["ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim"])
@pytest.mark.parametrize("draw", [pose_problem, point_problem])
def test_what_plan_returns_is_certified_and_releases_as_asked(arm, draw):
    here = cell(arm)
    known, _ = next(feasible_states(here, 1, seed=7))
    problem = draw(here, known.release.q, known.release.qd)
    answer = plan(problem)
    assert answer.certificate.valid
    k = answer.trajectory.release_index
    X_WT, V_WT = tool_state(problem.cell, answer.trajectory.q[k], answer.trajectory.qd[k])
    if isinstance(problem.release, PointRelease):
        np.testing.assert_allclose(X_WT[:3, 3], problem.release.p_WT, atol=1e-6)
        np.testing.assert_allclose(V_WT[:3], problem.release.v_WT, atol=1e-6)
    else:
        np.testing.assert_allclose(X_WT, problem.release.X_WT, atol=1e-6)
        np.testing.assert_allclose(V_WT, problem.release.V_WT, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5-sim", "ur5e-sim"])
def test_a_singularity_that_is_passed_between_two_samples_is_found(name: str):
    """The wrist goes through zero shortly before the release: the distance is large at samples on either side."""
    here = cell(name)
    qd = np.array([0.3, 0.2, 0.1, 0.2, 0.95 * here.limits.qd_max[4], 0.2])
    limits = replace(here.limits, singularity_distance_min=0.01)
    for beyond in np.linspace(0.02, 0.12, 40):
        q = np.append(here.home[:4] + np.array([0.3, 0.1, -0.1, 0.1]), [beyond, 0.1])
        problem = joint_problem(name, release=JointRelease(q, qd), limits=limits)
        motion = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
        before = motion.t >= motion.release_time_s - 0.05
        assert motion.q[before, 4].min() < 0.0 < motion.q[motion.release_index, 4]
        (check,) = (c for c in certify(problem, motion).checks if c.name == "singularity_distance")
        assert not check.ok, beyond
        assert check.value < 0.01


@pytest.mark.parametrize("name", ["ur5-sim", "ur5e-sim"])
def test_singularities_are_watched_over_50_ms_at_either_rate(name):
    """Near a wrist singularity on a controller of 125 Hz, where six ticks are 48 ms and seven 56 ms."""
    here = cell(name)
    q = [-0.24900803601, -1.84604307812, 1.36459656706, -1.91299740387, -0.16507304515, 0.28024206609]
    qd = [-0.64378045233, -0.71725373733, -0.16741849710, -0.11266246493, 2.46639037523, 0.66670377081]
    problem = ThrowProblem(here, here.home, JointRelease(np.array(q), np.array(qd)), here.limits)
    trajectory = profiles.solve(problem, candidates(problem)[0], "ramp").trajectory
    around = np.linspace(-0.05, 0.05, 2001)
    t = trajectory.release_time_s + around
    reached = np.abs(signed_singularity_distances(here.robot, trajectory.at(t)[0])).min()
    check = certify(problem, trajectory).check("singularity_distance")
    assert check.value <= reached + 1e-9
    assert check.ok == (check.value >= 0.05)
    assert reached == pytest.approx(0.0465, abs=2e-3)


@pytest.mark.parametrize(("rate_hz", "ticks"), [(125.0, 7), (500.0, 25), (1000.0, 50)])
def test_windows_are_rounded_outwards_to_whole_ticks(rate_hz, ticks):
    rest = np.zeros((200, 6))
    still = Trajectory(rate_hz, rest, rest, rest, release_index=100)
    assert ticks_around_release(still, 0.05) == (100 - ticks, 100 + ticks)
    assert ticks_around_release(still, 0.0) == (100, 100)
    assert ticks_around_release(still, 10.0) == (0, 199)


def test_a_certificate_makes_every_check_once(monkeypatch):
    """Each was made twice: to decide, and to tell a bound."""
    problem = joint_problem()
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    whole = certify(problem, trajectory)
    assert whole.valid
    made = []

    def counted(check):
        return lambda motion: [made.append(check), check(motion)][1]

    monkeypatch.setattr(checks, "MOTION_CHECKS", tuple(counted(check) for check in checks.MOTION_CHECKS))
    assert {check.name for check in certify(problem, trajectory).checks} == {check.name for check in whole.checks}
    assert len(made) == len(set(made)) == len(checks.MOTION_CHECKS)


def test_what_nobody_gave_or_asked_for_is_named():
    problem = joint_problem()
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    here = problem.cell
    assert certify(problem, trajectory).not_checked == ()
    bare = replace(here, tool=replace(here.tool, capsules=()))
    close = replace(here, surroundings=replace(here.surroundings, clearance_m=0.0))
    for other, name in ((bare, "tool_shape"), (close, "clearance")):
        assert certify(replace(problem, cell=other), trajectory).not_checked == (name,)


def test_the_assumed_shape_of_a_tool_keeps_out_of_boxes():
    """The axis of a tool of 0.4 m that nobody gave a shape went through this box."""
    problem = joint_problem()
    here = problem.cell
    tool = replace(here.tool, X_FT=pose([0.0, 0.0, 0.4], np.eye(3)), capsules=())
    half_way = tool_state(
        replace(here, tool=replace(tool, X_FT=pose([0.0, 0.0, 0.3], np.eye(3)))), here.home, np.zeros(6)
    )
    box = Box(half_way.p_WT - 0.01, half_way.p_WT + 0.01)
    around = replace(here.surroundings, keep_out=(box,))
    asked = replace(problem, cell=replace(here, tool=tool, surroundings=around))
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    check = certify(asked, trajectory).check("keep_out")
    assert (check.ok, check.detail) == (False, "tool_0, box 0")
