"""The arm's own safety limits: Pinocchio's momentum, power and braking torques, and stops that UR has published."""

from dataclasses import fields, replace

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.published_arms import pinocchio_arm
from planner.backends import ruckig_otg
from planner.cell import SAFETY_LIMITS, Safety
from planner.certificate import certify
from planner.certificate.bounds import joint_rates, point_bound
from planner.certificate.loads import load_bounds, loads_of
from planner.certificate.safety_limits import WATCHED
from planner.certificate.samples import MotionSamples
from planner.certificate.stopping import MEASURED_DISTANCE, MEASURED_TIME, _least_time
from planner.dynamics import Payload, joint_torques
from planner.errors import Infeasible
from planner.geometry import arm_capsules, capsule_endpoints
from planner.problem import JointRelease
from planner.robots import robot
from planner.seeds import Candidate, candidates
from tests.planner.problems import cell, joint_problem, random_state

NAMES = ("elbow_speed", "momentum", "power", "stopping_time", "stopping_distance")
FIELDS = ("elbow_speed_m_s", "momentum_kg_m_s", "power_w", "stopping_time_s", "stopping_distance_m")


def test_every_safety_limit_has_a_check():
    assert [each.name for each in fields(Safety)] == list(SAFETY_LIMITS)
    watched = {quantity.key: quantity.name for quantity in WATCHED}
    assert watched | {"tool_speed_m_s": "tcp_speed"} == {key: limit.check for key, limit in SAFETY_LIMITS.items()}


def model_of(here, with_object):
    """Pinocchio's arm with tool and object as point masses."""
    model = pinocchio_arm(here.robot.name, exact=True).copy()
    p_FT = here.tool.X_FT[:3, 3]
    for mass, place in ((here.tool.mass_kg, p_FT / 2.0), (here.object.mass_kg if with_object else 0.0, p_FT)):
        model.appendBodyToJoint(6, pin.Inertia(mass, place, np.zeros((3, 3))), pin.SE3.Identity())
    return model


def throws(name, count, seed):
    """Launches to random states with a heavy object, whatever stands in the way."""
    rng = np.random.default_rng(seed)
    found = []
    here = cell(name)
    here = replace(here, object=replace(here.object, mass_kg=1.5))
    for _ in range(count):
        q, qd = random_state(here, rng)
        problem = joint_problem(name, cell=here, release=JointRelease(q, qd))
        found.append((problem, ruckig_otg.solve(problem, Candidate(q, qd, 0.0, "random")).trajectory))
    return found


def dense_truth(problem, motion, per_tick=2):
    """The worst of each quantity by Pinocchio at every half tick; the object counts up to the release."""
    here = problem.cell
    worst = dict.fromkeys(NAMES, 0.0)
    elbow = [c for c in arm_capsules(here.robot) if c.name == "elbow"]
    tau = here.robot.tau_max
    p_FT = here.tool.X_FT[:3, 3]
    for with_object in (True, False):
        model = model_of(here, with_object)
        data = model.createData()
        times = np.linspace(0.0, motion.duration_s, per_tick * (len(motion.q) - 1) + 1)
        rows = times <= motion.release_time_s if with_object else times >= motion.release_time_s
        for q, qd, qdd in zip(*(x[rows] for x in motion.at(times)), strict=True):
            effort = pin.rnea(model, data, q, qd, qdd)
            h = pin.nonLinearEffects(model, data, q, qd).copy()
            b = np.array(pin.crba(model, data, q) @ qd)
            assert (np.abs(h) < tau).all()
            stop = max(0.0, *(np.abs(b) / np.where(b > 0.0, tau + h, tau - h)))
            ends = [capsule_endpoints(here.robot, elbow, q + s * 1e-6 * qd)[0] for s in (1, -1)]
            v_elbow = np.linalg.norm(ends[0] - ends[1], axis=1).max() / 2e-6
            pin.forwardKinematics(model, data, q, qd)
            flange = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
            v_tool = np.linalg.norm(flange.linear + np.cross(flange.angular, data.oMi[6].rotation @ p_FT))
            speed = max(v_elbow, v_tool, np.linalg.norm(flange.linear))
            pin.computeCentroidalMomentum(model, data, q, qd)
            now = (
                v_elbow,
                np.linalg.norm(data.hg.linear),
                abs(effort @ qd),
                MEASURED_TIME * stop,
                MEASURED_DISTANCE * 0.5 * speed * stop,
            )
            worst = {name: max(worst[name], float(value)) for name, value in zip(NAMES, now, strict=True)}
    return worst


@pytest.mark.parametrize("name", ["ur5-sim", "ur10e-sim"])
def test_each_limit_is_judged_as_pinocchio_judges_it(name):
    for problem, motion in throws(name, 1, 21):
        truth = dense_truth(problem, motion)
        for share, ok in ((1.004, True), (0.997, False)):
            safety = Safety(**{field: share * truth[name] for field, name in zip(FIELDS, NAMES, strict=True)})
            judged = replace(problem, cell=replace(problem.cell, safety=safety))
            certificate = certify(judged, motion)
            for quantity in NAMES:
                check = certificate.check(quantity)
                assert check.ok == ok, quantity
                assert check.value == pytest.approx(truth[quantity], rel=3e-3), quantity


def test_limits_that_the_cell_leaves_out_are_named():
    problem, motion = throws("ur5e-sim", 1, 3)[0]
    bare = replace(problem, cell=replace(problem.cell, safety=Safety()))
    assert {*NAMES, "tool_speed"} <= set(certify(bare, motion).not_checked)
    assert not set(NAMES) & {check.name for check in certify(bare, motion).checks}
    full = replace(problem, cell=replace(problem.cell, safety=Safety(*[1e3] * 6)))
    assert not {*NAMES, "tool_speed"} & set(certify(full, motion).not_checked)


def test_the_flange_counts_for_the_arms_own_tool_speed():
    """A tool centre point that lies inwards is slower than the flange."""
    here = cell()
    X_FT = np.array(here.tool.X_FT)
    X_FT[:3, 3] = [0.0, 0.0, -0.15]
    short = replace(here, tool=replace(here.tool, X_FT=X_FT))
    problem = joint_problem(cell=short)
    motion = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    free = certify(problem, motion).check("tcp_speed").value
    watched = replace(problem, cell=replace(short, safety=Safety(tool_speed_m_s=1.01 * free)))
    check = certify(watched, motion).check("tcp_speed")
    assert (check.ok, check.detail) == (False, "flange")


# Source: user manuals of UR5 (CB3, version 3.4.5) and UR3 (CB3, version 3.10), appendix A.1: stops of category 0 from
# 183 deg/s, the arm stretched out horizontally, shoulder and elbow on their way down: payload [kg], and for base,
# shoulder and elbow the distance [rad] and time [s].
PUBLISHED_STOPS = {
    "ur5": (5.0, ((0.31, 0.244), (0.70, 0.530), (0.22, 0.164))),
    "ur3": (3.0, ((0.18, 0.159), (0.20, 0.154), (0.15, 0.092))),
}


def test_no_published_stop_is_longer_than_the_models():
    gravity = np.array([0.0, 0.0, -9.81])
    speed = np.radians(183.0)
    ratios = []
    for name, (payload_kg, stops) in PUBLISHED_STOPS.items():
        arm = robot(name)
        payload = Payload(payload_kg, np.zeros(3), np.zeros((3, 3)))
        for joint, (distance_rad, time_s) in enumerate(stops):
            qd = speed * np.eye(6)[joint]  # stretched towards -x: a positive shoulder moves it down
            h = joint_torques(arm, np.zeros(6), qd, np.zeros(6), gravity, payload)
            b = joint_torques(arm, np.zeros(6), np.zeros(6), qd, np.zeros(3), payload)
            model = float(_least_time(h[:, None], b[:, None], arm.tau_max[:, None])[0])
            ratios.append((time_s / model, distance_rad / (speed * model / 2.0)))
    longest = np.max(ratios, axis=0)
    assert np.all(longest <= [MEASURED_TIME, MEASURED_DISTANCE])
    assert np.all(longest >= np.array([MEASURED_TIME, MEASURED_DISTANCE]) - 0.015)
    assert np.all(np.min(ratios, axis=0) > 0.6)  # the model is of the right size


def test_a_release_beyond_a_limit_has_no_candidate():
    problem = joint_problem()
    for changes, name in (
        ({"elbow_speed_m_s": 0.05}, "elbow_speed"),
        ({"momentum_kg_m_s": 0.5}, "momentum"),
        ({"tool_speed_m_s": 0.1}, "tcp_speed"),
    ):
        tight = replace(problem, cell=replace(problem.cell, safety=Safety(**changes)))
        with pytest.raises(Infeasible) as refused:
            candidates(tight)
        (row,) = refused.value.violations
        assert (row.constraint, row.limit) == (name, next(iter(changes.values())))
        assert row.value > row.limit


def curvatures(problem, motion, with_object):
    """Second differences of h, of M qd and of the power inside each tick, by Pinocchio."""
    model = model_of(problem.cell, with_object)
    data = model.createData()
    dt = motion.dt
    t = (motion.t[:-1] + dt / 2.0)[:, None] + 0.2 * dt * np.arange(-1, 2)
    states = [x.reshape(-1, 6) for x in motion.at(t)]
    h = np.array([pin.nonLinearEffects(model, data, q, qd).copy() for q, qd in zip(*states[:2], strict=True)])
    b = np.array([pin.crba(model, data, q) @ qd for q, qd in zip(*states[:2], strict=True)])
    power = np.array([pin.rnea(model, data, *state) @ state[1] for state in zip(*states, strict=True)])
    second = [np.diff(x.reshape(len(t), 3, -1), 2, axis=1)[:, 0].T / (0.2 * dt) ** 2 for x in (h, b, power)]
    return [np.abs(x) for x in second]


def test_the_bounds_between_samples_are_never_below_the_truth():
    for problem, motion in throws("ur5e-sim", 3, 8):
        rates = joint_rates(motion)
        loads = loads_of(problem.cell)
        h, b, power = curvatures(problem, motion, True)
        noise = 1e-3
        bounds = load_bounds(loads, rates, 9.81)
        assert np.all(h <= bounds.torque + noise)
        assert np.all(b <= bounds.joint_momentum[2] + noise)
        assert np.all(power <= bounds.power[0] + noise)
        samples = MotionSamples(problem, motion)
        assert np.all(point_bound(loads.lever, rates, 1) >= 0.0)
        _, (h, _), (b, _) = samples.at_knots.torques
        assert h.shape == b.shape == (6, len(samples.knots))
