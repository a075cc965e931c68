"""Plans that are wrong by a little: the foreign judge finds each, and nothing where the fault is taken back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

from audit.judge import coal_mesh, coal_solid, find_faults, worst_margins
from audit.judge.pinocchio_arm import dh_frames_in_urdf, poses_and_velocity
from audit.judge.published_arms import robot_model
from planner.cell import Box
from planner.planning import Plan, plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.robots import completed, robot
from tests.planner.problems import cell

TARGET = {"kind": "target", "position": [1.1, 0.4, 0.0]}
PEAK = 1e-4  # [-] of a limit about a peak: what the judge lets pass is a tenth of it
LEAST_M = 0.02  # [m] by which an obstacle is moved


@pytest.fixture(scope="module")
def thrown() -> Plan:
    return plan(problem_from_request({"release": TARGET, "release_window_s": 0.0}, cell()))


@pytest.fixture(scope="module")
def passing() -> Plan:
    places = ([0.5, 0.2, 0.5], [0.5, -0.2, 0.6])
    states = [{"kind": "point", "position": p, "velocity": [0.0, -0.3, 0.1]} for p in places]
    passages = [{"name": str(k), "state": state} for k, state in enumerate(states)]
    return plan(problem_from_request({"passages": passages}, cell()))


def rules(problem: ThrowProblem, found: Plan, **more: Any) -> set[str]:
    return {fault.rule for fault in find_faults(problem, found.trajectory, **more)}


def test_what_is_certified_is_right(thrown: Plan, passing: Plan) -> None:
    for found in (thrown, passing):
        assert rules(found.problem, found) == set()


@pytest.mark.parametrize(("raised", "is_found"), [(1.05, True), (1.0 - PEAK, False)])
def test_a_torque_limit_that_was_raised_by_5_percent(thrown: Plan, raised: float, is_found: bool) -> None:
    """The motion uses the raised limit up; the cell's own is less by so much."""
    with worst_margins() as worst:
        find_faults(thrown.problem, thrown.trajectory)
    peak, limit = worst["joint_torque"]
    limits = thrown.problem.limits
    lowered = replace(thrown.problem, limits=replace(limits, tau_max=limits.tau_max * peak / limit / raised))
    assert rules(lowered, thrown) == ({"joint_torque"} if is_found else set())


def test_an_obstacle_that_was_moved_by_2_cm_after_planning(thrown: Plan) -> None:
    """A cube that the arm passes as closely as it may, to a millimetre, and the same one nearer."""
    hand = thrown.problem.cell.home
    p = _hand(thrown.problem, hand)

    def with_cube(away_m: float) -> ThrowProblem:
        middle = p + np.array([0.0, 0.0, away_m])
        around = replace(thrown.problem.cell.surroundings, keep_out=(Box(middle - 0.1, middle + 0.1),))
        return replace(thrown.problem, cell=replace(thrown.problem.cell, surroundings=around))

    near, far = 0.0, 2.0
    while far - near > 1e-3:
        middle = 0.5 * (near + far)
        is_clear = rules(with_cube(middle), thrown).isdisjoint({"keep_out", "flight_clearance"})
        near, far = (near, middle) if is_clear else (middle, far)
    assert rules(with_cube(far), thrown) == set()
    assert rules(with_cube(far - LEAST_M), thrown) & {"keep_out", "flight_clearance"}


def _hand(problem: ThrowProblem, q: np.ndarray) -> np.ndarray:
    model = robot_model(problem.cell.robot)
    poses, _ = poses_and_velocity(problem.cell, model, model.createData(), q, np.zeros(6))
    return poses[6].act(problem.cell.tool.X_FT[:3, 3])


@pytest.mark.parametrize("ticks", [-1, 1])
def test_a_release_a_tick_early_or_late(thrown: Plan, ticks: int) -> None:
    late = replace(thrown.trajectory, release_index=thrown.trajectory.release_index + ticks)
    assert "landing" in {fault.rule for fault in find_faults(thrown.problem, late)}


@pytest.mark.parametrize("early_s", [0.004, -0.004])
def test_a_passage_before_its_time(passing: Plan, early_s: float) -> None:
    at_s = passing.trajectory.passed[1] * passing.trajectory.dt
    first, second = passing.problem.passages
    timed = replace(passing.problem, passages=(first, replace(second, not_before_s=at_s + early_s)))
    assert rules(timed, passing) == ({"passage_time"} if early_s > 0.0 else set())
    fixed = replace(passing.problem, passages=(first, replace(second, at_s=at_s + early_s)))
    assert rules(fixed, passing) == {"passage_time"}


def test_bounds_on_a_throw_that_are_exceeded(thrown: Plan) -> None:
    target = thrown.problem.release
    for bound, rule in (
        ({"max_speed_m_s": 0.5}, "release_velocity"),
        ({"max_elevation_rad": -1.5}, "release_velocity"),
        ({"min_elevation_rad": 1.5}, "release_velocity"),
        ({"min_horizontal_distance_m": 3.0}, "release_position"),
        ({"release_position": np.zeros(3)}, "release_position"),
    ):
        assert rules(replace(thrown.problem, release=replace(target, **bound)), thrown) == {rule}


def test_a_mesh_that_its_boxes_do_not_cover(thrown: Plan) -> None:
    import trimesh

    p = _hand(thrown.problem, thrown.trajectory.q[thrown.trajectory.release_index])
    mesh = coal_mesh(trimesh.creation.icosphere(1, 0.05))
    assert rules(thrown.problem, thrown, beyond=((mesh, coal.Transform3s(np.eye(3), p), 0.0, "mesh"),)) == {"keep_out"}
    away = coal.Transform3s(np.eye(3), p + 3.0 * np.eye(3)[2])
    assert rules(thrown.problem, thrown, beyond=((mesh, away, 0.0, "mesh"),)) == set()


@pytest.mark.parametrize("name", ["ur5e", "ur20", "ur3"])
def test_an_arm_of_the_tables_numbers_is_the_published_one(name: str) -> None:
    """Poses, velocities, torques and joints' places, which singularities are told by, for an arm that has both."""
    arm = robot(name)
    table = completed(name, {"link_mass_kg": [link.mass for link in arm.links]})
    models = [robot_model(each) for each in (arm, table)]
    assert models[0] is not models[1]
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 6))
    seen = []
    for each, model in zip((arm, table), models, strict=True):
        data = model.createData()
        tau = pin.rnea(model, data, q, qd, qdd)
        pin.forwardKinematics(model, data, q, qd)
        poses = [(data.oMi[i] * dh_frames_in_urdf(each)[i - 1]).homogeneous for i in range(1, 7)]
        twist = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED).vector
        joints = [data.oMi[i].homogeneous for i in range(1, 7)]
        seen.append(np.concatenate([tau, twist, np.ravel(poses), np.ravel(joints)]))
    np.testing.assert_allclose(*seen, rtol=0.0, atol=1e-8)


def test_shapes_of_a_cell_are_coals() -> None:
    """The size of a solid as coal has it: of a box its sides."""
    box = coal_solid(Box(np.zeros(3), np.array([0.1, 0.2, 0.3])))
    np.testing.assert_allclose(2.0 * box.halfSide, [0.1, 0.2, 0.3])
