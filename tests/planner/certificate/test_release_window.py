"""The release window: its curvature bound with and without drag, and the object's weight while it may be held."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.certificate import certify
from planner.certificate.release import _landing_curvature
from planner.certificate.samples import MotionSamples
from planner.dynamics import gravity_in_base, joint_torques, payload_of
from planner.flight import fly, landing_states
from planner.problem import JointRelease, TargetRelease
from planner.seeds import Candidate
from planner.trajectory import Trajectory
from tests.planner.problems import cell, joint_problem, random_state

WINDOW_S = 0.02


def thrown(drag_coefficient: float, count: int, seed: int = 3):
    """Random throws up and away, with a window; the object weighs 2 g, so that drag is heavy."""
    rng = np.random.default_rng(seed)
    here = cell()
    found = []
    light = replace(here, object=replace(here.object, mass_kg=0.002, drag_coefficient=drag_coefficient))
    while len(found) < count:
        q, qd = random_state(light, rng)
        known = joint_problem(cell=light, release=JointRelease(q, qd))
        motion = ruckig_otg.solve(known, Candidate(q, qd, 0.0, "random")).trajectory
        arm = MotionSamples(known, motion).at(np.array([motion.release_time_s]))
        flight = fly(arm.p_WT[:, 0], arm.v_WT[:, 0], 0.0, 9.81, known.drag)
        if flight is not None and arm.v_WT[2, 0] > 0.3:
            target = TargetRelease(flight.landing_point)
            found.append((replace(known, release=target, release_window_s=WINDOW_S, landing_tolerance_m=0.5), motion))
    return found


def window_of(problem, motion, count):
    delays = np.linspace(-WINDOW_S, WINDOW_S, count)
    return MotionSamples(problem, motion).at(motion.release_time_s + delays)


@pytest.mark.parametrize(("drag_coefficient", "factor"), [(0.0, 1.0), (0.5, 1.0), (4.0, 1.0), (0.0, 1.3), (4.0, 0.8)])
def test_the_landing_points_curvature_is_never_above_its_bound(drag_coefficient, factor):
    """At a drag coefficient of 4 the constant is 1.5 /m: the object falls at 2.6 m/s at most."""
    heaviest = {0.0: 0.0, 0.5: 0.19, 4.0: 1.51}
    for known, motion in thrown(drag_coefficient, 3):
        gripper = replace(known.cell.gripper, release_speed_factor=factor)
        problem = replace(known, cell=replace(known.cell, gripper=gripper))
        assert problem.drag == pytest.approx(heaviest[drag_coefficient], abs=0.005)
        fine = window_of(problem, motion, 401)
        p = fine.p_WT.T
        v = factor * fine.v_WT.T
        points = landing_states(p, v, 0.0, problem.gravity, problem.drag).p
        h = 2.0 * WINDOW_S / 400
        # the jerk is constant in a tick of 2 ms = 20 steps: differences across its ends mix two curvatures
        true = np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() / h**2
        bound = _landing_curvature(MotionSamples(problem, motion), window_of(problem, motion, 41))
        assert true <= bound
        assert bound < 1e3 * true


@pytest.mark.parametrize("drag", [0.0, 0.7])
def test_landing_states_are_those_of_single_flights(drag):
    rng = np.random.default_rng(0)
    p = rng.uniform([-1, -1, 0.2], [1, 1, 1.5], (20, 3))
    v = rng.uniform(-3, 3, (20, 3))
    together = landing_states(p, v, 0.5, 9.81, drag)
    for i in range(20):
        flight = fly(p[i], v[i], 0.5, 9.81, drag)
        if flight is None:
            assert np.isnan(together.time_s[i])
            assert np.isnan(together.p[i]).all()
            continue
        np.testing.assert_allclose(together.p[i], flight.landing_point, atol=1e-12)
        np.testing.assert_allclose(together.v[i], flight.landing_velocity, atol=1e-12)
        assert together.time_s[i] == pytest.approx(flight.time_of_flight_s, abs=1e-12)


def test_a_window_under_heavy_drag_is_judged_as_a_dense_look_judges_it():
    for problem, motion in thrown(4.0, 3):
        fine = window_of(problem, motion, 801)
        landed = landing_states(fine.p_WT.T, fine.v_WT.T, 0.0, problem.gravity, problem.drag)
        worst = np.linalg.norm(landed.p - problem.release.p_W, axis=1).max()
        for share, ok in ((1.02, True), (0.98, False)):
            check = certify(replace(problem, landing_tolerance_m=share * worst), motion).check("landing_window")
            assert check.ok == ok


def _worst_share(problem, motion, rows, with_object):
    here = problem.cell
    tau = joint_torques(
        here.robot,
        *(x[rows] for x in (motion.q, motion.qd, motion.qdd)),
        gravity_in_base(here),
        payload_of(here, with_object),
    )
    return float((np.abs(tau) / problem.limits.tau_max).max())


def test_the_object_weighs_until_the_window_ends_and_may_be_gone_from_its_beginning():
    """A heavy object; the torque is largest after the nominal release, in the window, where it may still be held."""
    here = cell()
    heavy = replace(here, object=replace(here.object, mass_kg=3.0))
    rng = np.random.default_rng(5)
    for _ in range(40):
        q, qd = random_state(heavy, rng)
        nominal = joint_problem(cell=heavy, release=JointRelease(q, qd))
        motion = ruckig_otg.solve(nominal, Candidate(q, qd, 0.0, "random")).trajectory
        k = motion.release_index
        reach = 10
        until = slice(0, k + 1)
        late = slice(0, min(len(motion.q), k + reach + 1))
        early = slice(max(0, k - reach), None)
        after = slice(k, None)
        held, longer = (_worst_share(nominal, motion, rows, True) for rows in (until, late))
        empty, sooner = (_worst_share(nominal, motion, rows, False) for rows in (after, early))
        robust = replace(nominal, release_window_s=WINDOW_S, landing_tolerance_m=10.0)
        for problem, share in ((nominal, max(held, empty)), (robust, max(longer, sooner))):
            for factor, ok in ((1.01, True), (0.995, False)):
                limits = replace(problem.limits, tau_max=factor * share * problem.limits.tau_max)
                check = certify(replace(problem, limits=limits), motion).check("joint_torque")
                assert check.ok == ok
        if longer > 1.05 * max(held, empty):
            return
    raise AssertionError("no motion whose torque is largest late in the window")


def test_a_window_beyond_the_motions_end_is_cut_there():
    problem, motion = thrown(0.0, 1)[0]
    samples = MotionSamples(replace(problem, release_window_s=0.2), motion)
    assert samples.held_until_s <= motion.duration_s
    assert samples.gone_from_s >= 0.0
    assert {samples.gone_from_s, samples.held_until_s} <= set(motion.t[samples.knots])
    short = Trajectory(500.0, motion.q, motion.qd, motion.qdd, release_index=len(motion.q) - 1)
    assert MotionSamples(problem, short).held_until_s == short.duration_s
