"""Rooms that are no boxes along the axes: checks against dense samples and coal, plans and approaches within them."""

from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pytest
from scipy.spatial import KDTree

from audit.judge.distances import coal_solid
from planner.approach import find_approach
from planner.cell import Box, shape_of
from planner.certificate import certify
from planner.errors import Infeasible
from planner.geometry import tool_pose
from planner.planning import plan
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import steady_cell

SIZES = {"box": [1.6, 1.5, 1.4], "cylinder": [0.8, 1.4], "sphere": [0.85, 0.0], "capsule": [0.75, 0.5]}
POINT_M = 1e-3  # [m] radius of the ball that stands for the tool centre point
COAL_M = 2e-6  # [m] to which coal tells how deep a ball is in a round shape


@cache
def known():
    """A throw in an empty cell, with its motion, and the tool centre point along it."""
    here = steady_cell()
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.0, 0.5, 0.0])), here.limits)
    motion = plan(problem).trajectory
    q, _, _ = motion.at(np.linspace(0.0, motion.duration_s, 6 * len(motion.q)))
    return problem, motion, tool_pose(here, q)[:, :3, 3]


def within(problem, *rooms):
    return replace(problem, cell=replace(problem.cell, surroundings=replace(problem.cell.surroundings, keep_in=rooms)))


def room(kind, rng, middle, size=1.0):
    turn = rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3))
    return shape_of(kind, pose(middle + rng.uniform(-0.3, 0.3, 3), turn), size * np.array(SIZES[kind]))


def coal_depth(shape, p):
    """Returns how deep coal finds a ball about each of some points (n, 3) in a shape, beyond its radius (n,)."""
    solid = coal_solid(shape)
    place = coal.Transform3s(shape.X_WC[:3, :3], shape.X_WC[:3, 3])
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    depths = []
    for at in p:
        ball = coal.Transform3s(np.eye(3), at)
        gap = coal.distance(solid, place, coal.Sphere(POINT_M), ball, request, coal.DistanceResult())
        depths.append(-gap - POINT_M)
    return np.array(depths)


@pytest.mark.parametrize("kind", ["box", "sphere", "capsule"])
def test_the_depth_is_that_of_coal(kind):
    """Not of cylinders: in these coal 3.0.3 finds depths that are too large by up to half a metre."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        shape = room(kind, rng, np.zeros(3))
        p = shape.X_WC[:3, 3] + rng.uniform(-0.6, 0.6, (40, 3))
        p = p[shape.depth(p) > POINT_M]
        np.testing.assert_allclose(shape.depth(p), coal_depth(shape, p), atol=COAL_M)


def test_the_depth_in_a_cylinder_is_the_distance_from_its_surface():
    rng = np.random.default_rng(5)
    shape = room("cylinder", rng, np.zeros(3))
    radius, length = SIZES["cylinder"]
    turn = rng.uniform(0.0, 2.0 * np.pi, 40_000)
    out = np.append(np.full(20_000, radius), radius * np.sqrt(rng.uniform(size=20_000)))
    along = np.append(rng.uniform(-0.5, 0.5, 20_000), rng.choice([-0.5, 0.5], 20_000)) * length
    surface = np.column_stack([out * np.cos(turn), out * np.sin(turn), along]) @ shape.X_WC[:3, :3].T
    p = shape.X_WC[:3, 3] + rng.uniform(-0.8, 0.8, (500, 3))
    p = p[shape.depth(p) > 0.0]
    away, _ = KDTree(surface + shape.X_WC[:3, 3]).query(p)
    assert len(p) > 100
    assert (shape.depth(p) <= away + 1e-12).all()
    assert (shape.depth(p) >= away - 0.03).all()  # the samples are so far apart


@pytest.mark.parametrize("kind", SIZES)
def test_the_check_is_that_of_dense_samples(kind):
    problem, motion, p = known()
    rng = np.random.default_rng(7)
    found = []
    for i in range(24):
        clearance_m = 0.03 * (i % 2)
        shape = replace(room(kind, rng, p.mean(axis=0), rng.uniform(0.7, 1.1)), clearance_m=clearance_m)
        least = float(shape.depth(p).min())
        check = certify(within(problem, shape), motion).check("keep_in")
        found.append(check.ok)
        assert check.limit == clearance_m
        assert check.detail == f"tool centre point, {kind} 0"
        assert check.ok == (least >= clearance_m) or abs(least - clearance_m) < 1e-4
        if check.ok:
            assert least - 0.011 < check.value < least + 1e-9
    assert any(found)
    assert not all(found)


def test_of_several_the_one_that_leaves_least_is_told():
    problem, motion, p = known()
    wide = Box(p.min(axis=0) - 0.5, p.max(axis=0) + 0.5)
    ball = shape_of("sphere", pose(p.mean(axis=0), np.eye(3)), np.array([2.0, 0.0]), "dome")
    told = certify(within(problem, wide, ball), motion).check("keep_in")
    assert told.detail in [f"{axis} {side}" for axis in "xyz" for side in ("lower", "upper")]
    assert told.value == pytest.approx(0.5, abs=0.011)
    least = float(ball.depth(p).min())
    told = certify(within(problem, wide, replace(ball, clearance_m=least - 0.1)), motion).check("keep_in")
    assert told.detail == "tool centre point, dome"
    assert told.margin == pytest.approx(0.1, abs=0.011)
    for name, clearance_m in (("", None), ("", 0.0)):  # such a box is one with the other
        plain = certify(within(problem, wide, Box(wide.lower, wide.upper, name, clearance_m)), motion).check("keep_in")
        assert plain == certify(within(problem, wide), motion).check("keep_in")
    named = certify(within(problem, Box(wide.lower, wide.upper, "cage")), motion).check("keep_in")
    assert named.detail == "tool centre point, cage"


@pytest.mark.parametrize("kind", SIZES)
def test_a_throw_is_planned_within_a_room_that_the_first_one_leaves(kind):
    """The tool's highest place of the motion in an empty cell is 4 cm beyond the wall."""
    problem, motion, p = known()
    tilt = rotation_vector_to_matrix(np.array([0.1, -0.1, 0.4]))
    home = tool_pose(problem.cell, problem.start[None])[0, :3, 3]
    wide = {"box": [3.0, 3.0, 3.0], "cylinder": [1.5, 3.0], "sphere": [1.5, 0.0], "capsule": [1.4, 0.3]}[kind]
    highest = p[p[:, 2].argmax()]
    places = (pose(home * [1.0, 1.0, 0.0] - down_m * tilt[:, 2], tilt) for down_m in np.arange(0.0, 2.0, 0.005))
    shapes = (shape_of(kind, place, np.array(wide)) for place in places)
    shape = next(shape for shape in shapes if shape.depth(highest) < -0.04)
    asked = within(problem, shape)
    assert not certify(asked, motion).check("keep_in").ok
    found = plan(asked)
    assert found.certificate.valid
    q, _, _ = found.trajectory.at(np.linspace(0.0, found.trajectory.duration_s, 5000))
    assert shape.depth(tool_pose(problem.cell, q)[:, :3, 3]).min() > -1e-9


def test_a_release_outside_is_refused_as_proven_with_the_name():
    problem, _, _ = known()
    shape = shape_of("sphere", pose([0.0, 0.0, 0.0], np.eye(3)), np.array([0.4, 0.0]), "dome", 0.05)
    asked = replace(within(problem, shape), release=PointRelease(np.array([0.5, 0.0, 0.4]), np.array([0.3, 0.0, 0.3])))
    with pytest.raises(Infeasible) as refusal:
        plan(asked)
    (violation,) = (each for each in refusal.value.violations if "release" in each.detail)
    assert violation.proven
    assert violation.limit == 0.05
    assert violation.value == pytest.approx(0.4 - np.hypot(0.5, 0.4))
    assert "dome" in violation.detail


def test_an_approach_stays_within_a_room_that_the_straight_one_leaves():
    """A bowl that the tool swings out of on the straight way through joint space."""
    here = steady_cell()
    start = here.home
    goal = here.home + np.array([1.6, -0.5, 0.6, 0.3, 0.4, 0.0])
    p = tool_pose(here, np.linspace(start, goal, 200))[:, :3, 3]
    chord = p[0] + np.linspace(0.0, 1.0, 200)[:, None] * (p[-1] - p[0])
    away = np.linalg.norm(p - chord, axis=1).argmax()
    out = (p[away] - chord[away]) / np.linalg.norm(p[away] - chord[away])
    turn = np.column_stack([np.linalg.qr(np.column_stack([out, np.eye(3)]))[0][:, 1:], out])
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    face = chord[away] + 0.5 * (p[away] - chord[away])
    shape = shape_of("box", pose(face - 2.0 * out, turn), np.array([8.0, 8.0, 4.0]), "cage")
    around = replace(here.surroundings, keep_in=(shape,))
    caged = replace(here, surroundings=around)
    assert (shape.depth(p[[0, -1]]) > 0.02).all()
    assert shape.depth(p).min() < -0.02
    approach, failures = find_approach(caged, start, goal)
    assert [check.detail for check in failures] == ["tool centre point, cage"]
    assert approach is not None
    assert approach.trajectory is not None
    assert not approach.is_straight
    q, _, _ = approach.trajectory.at(np.linspace(0.0, approach.duration_s, 5000))
    assert shape.depth(tool_pose(here, q)[:, :3, 3]).min() > -1e-9
