"""Clearance from turned and round shapes: checks against dense samples, and a clearance of their own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planner.cell import shape_of
from planner.certificate import certify
from planner.flight import path
from planner.geometry import body_capsules, capsule_endpoints, segment_shape_distance, tool_state
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import steady_cell, with_shapes

UP = np.array([0.0, 0.0, 1.0])
KINDS = ("box", "cylinder", "sphere", "capsule")


@cache
def known():
    """A throw in an empty cell, with its motion."""
    here = steady_cell()
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.0, 0.5, 0.0])), here.limits)
    return problem, plan(problem).trajectory


def among(shape, problem):
    return replace(problem, cell=with_shapes(problem.cell, shape))


def nearby(kind, seed, places):
    """Shapes about some places."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    for _ in range(25):
        centre = places[rng.integers(len(places))] + rng.uniform(-0.4, 0.4, 3)
        sizes = rng.uniform(0.03, 0.4, 3 if kind == "box" else 2)
        sizes = np.array([sizes[0], 0.0]) if kind == "sphere" else sizes
        yield shape_of(kind, pose(centre, rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3))), sizes)


@pytest.mark.parametrize("kind", KINDS)
def test_the_distance_from_a_shape_is_that_of_dense_samples(kind):
    problem, motion = known()
    here = problem.cell
    capsules = [c for c in body_capsules(here.robot, here.tool.capsules) if c.frame > 0]
    t = np.linspace(0.0, motion.duration_s, 6 * len(motion.q))
    q, qd, _ = motion.at(t)
    ends = capsule_endpoints(here.robot, capsules, q, here.X_WB)
    p_WT = tool_state(here, q, qd).p_WT
    found = []
    for shape in nearby(kind, 1, p_WT):
        of_arm = segment_shape_distance(ends[..., 0, :], ends[..., 1, :], shape) - [c.radius_m for c in capsules]
        held = t <= motion.release_time_s
        of_object = segment_shape_distance(p_WT[held], p_WT[held], shape) - here.object.radius_m
        least = min(float(of_arm.min()), float(of_object.min()))
        check = certify(among(shape, problem), motion).check("keep_out")
        found.append(check.ok)
        assert check.ok == (least >= here.surroundings.clearance_m) or abs(least - here.surroundings.clearance_m) < 1e-4
        if check.ok:
            assert least - 0.011 < check.value < least + 1e-9
    assert any(found)
    assert not all(found)


@pytest.mark.parametrize("kind", KINDS)
def test_the_distance_of_a_flight_from_a_shape_is_that_of_dense_samples(kind):
    problem, motion = known()
    here = problem.cell
    k = motion.release_index
    tool = tool_state(here, motion.q[k], motion.qd[k])
    x = path(tool.p_WT, tool.v_WT, np.arange(0.0, 1.5, 5e-4), problem.gravity, problem.drag)
    x = x[x[:, 2] > here.object.radius_m]
    required = here.surroundings.flight_clearance_m
    found = []
    for shape in nearby(kind, 2, x):
        asked = among(shape, problem)
        if asked.misfit is not None or asked.flight_clearances[0][0] < required:
            continue
        least = float(segment_shape_distance(x, x, shape).min()) - here.object.radius_m
        check = certify(asked, motion).check("flight_clearance")
        found.append(check.ok)
        assert check.ok == (least >= required) or abs(least - required) < 1e-4
        if check.ok:
            assert check.value < least + 1e-9
    assert any(found)
    assert not all(found)


def ball(p, name, clearance_m=None):
    return shape_of("sphere", pose(np.asarray(p), np.eye(3)), np.array([0.05, 0.0]), name, clearance_m)


@pytest.mark.parametrize(("name", "up_m"), [("keep_out", 0.6), ("flight_clearance", 0.15)])
def test_a_shape_may_have_a_clearance_of_its_own(name, up_m):
    """Arm and flight keep it, and the check tells it as the limit."""
    problem, motion = known()
    k = motion.release_index
    tool = tool_state(problem.cell, motion.q[k], motion.qd[k])
    p = path(tool.p_WT, tool.v_WT, np.array([0.0 if name == "keep_out" else 0.25]), problem.gravity, problem.drag)[0]
    lamp = ball(p + up_m * UP, "lamp")
    usual = certify(among(lamp, problem), motion).check(name)
    assert usual.detail.endswith("lamp")
    for own, ok in ((usual.value - 0.012, True), (usual.value + 0.012, False)):
        check = certify(among(replace(lamp, clearance_m=own), problem), motion).check(name)
        assert (check.ok, check.limit) == (ok, pytest.approx(own))
        assert check.detail.endswith("lamp")


def test_the_nearest_shape_is_the_one_that_leaves_least_beyond_its_clearance():
    problem, motion = known()
    place = tool_state(problem.cell, motion.q[0], motion.qd[0]).p_WT
    near = ball(place + 0.6 * UP, "near", 0.001)
    far = ball(place + 0.8 * UP, "far")
    gaps = [certify(among(shape, problem), motion).check("keep_out").value for shape in (near, far)]
    far = replace(far, clearance_m=gaps[1] - 0.02)
    check = certify(replace(problem, cell=with_shapes(problem.cell, near, far)), motion).check("keep_out")
    assert gaps[0] < gaps[1]
    assert check.detail.endswith(", far")
    assert (check.value, check.limit) == (pytest.approx(gaps[1], abs=0.01), pytest.approx(gaps[1] - 0.02))


@pytest.mark.slow
@pytest.mark.parametrize("target", [[1.0, 0.5, 0.0], [0.9, 0.2, 0.3]])
@pytest.mark.parametrize("opening_s", [0.0, 0.02])
def test_of_many_shapes_the_one_that_is_worst_alone_decides(target, opening_s):
    """However far the others are: those that bounding boxes tell to be far change nothing."""
    here = steady_cell()
    table = shape_of("box", pose(np.array([0.9, 0.2, 0.15]), np.eye(3)), np.array([0.2, 0.2, 0.3]), "table")
    here = with_shapes(here, *([table] if target[2] > 0.0 else []))
    problem = ThrowProblem(here, here.home, TargetRelease(np.array(target)), here.limits, release_window_s=opening_s)
    motion = plan(replace(problem, landing_tolerance_m=0.05)).trajectory
    rng = np.random.default_rng(8)
    many = []
    for kind in KINDS * 9:
        sizes = rng.uniform(0.03, 0.3, 3 if kind == "box" else 2) * ([1.0, 0.0] if kind == "sphere" else 1.0)
        X = pose(rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 1.5]), rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3)))
        many.append(shape_of(kind, X, sizes, f"{kind} no. {len(many)}", rng.choice([None, 0.0, 0.1])))
    for chosen in (many, [shape for shape in many if certify(_more(problem, shape), motion).valid]):
        together = certify(_more(problem, *chosen), motion)
        alone = [certify(_more(problem, shape), motion) for shape in chosen]
        for name, off_m in (("keep_out", 1e-3), ("flight_clearance", 0.011)):
            check = together.check(name)
            worst = min((each.check(name) for each in alone), key=lambda c: c.value - c.limit)
            assert check.ok == worst.ok
            assert check.value - check.limit == pytest.approx(worst.value - worst.limit, abs=off_m)


def _more(problem, *shapes):
    there = problem.cell.surroundings.keep_out
    return replace(problem, cell=with_shapes(problem.cell, *there, *shapes))
