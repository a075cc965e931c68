"""The body model against the plain functions on one capsule, box and pair at a time."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box
from planner.geometry import (
    SELF_CLEARANCE_M,
    body_capsules,
    body_model,
    capsule_endpoints,
    segment_segment_distance,
    segment_shape_distance,
    tool_pose,
)
from planner.geometry.capsules import Capsule
from planner.kinematics import link_poses
from planner.problem import Opening, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell

BOXES = (
    Box(np.array([-0.9, 0.35, 0.0]), np.array([0.9, 0.9, 1.2])),
    Box(np.array([0.15, -0.6, 0.5]), np.array([0.5, 0.2, 0.9])),
)
ROOM = (Box(np.array([-0.8, -0.8, 0.1]), np.array([0.7, 0.9, 1.2])),)


def turned_cell():
    here = cell()
    around = replace(here.surroundings, keep_out=BOXES, keep_in=ROOM, clearance_m=0.02, floor_z_m=-0.1)
    X_WB = pose([0.1, -0.2, 0.3], rotation_vector_to_matrix([0.1, -0.2, 1.0]))
    return replace(here, surroundings=around, X_WB=X_WB)


def postures(here, count=50):
    return here.home + np.random.default_rng(21).uniform(-1.5, 1.5, (count, 6))


def capsules_of(here):
    p_FT = here.tool.X_FT[:3, 3]
    return (*body_capsules(here.robot, here.tool.capsules), Capsule(6, p_FT, p_FT, here.object.radius_m, "object"))


def test_ends_are_those_of_the_capsules():
    here = turned_cell()
    body = body_model(here)
    q = postures(here)
    X_WL = link_poses(here.robot, q, here.X_WB)
    expected = capsule_endpoints(here.robot, capsules_of(here), q, here.X_WB)
    np.testing.assert_allclose(np.moveaxis(body.end_points(X_WL), -1, 0), expected, atol=1e-12)
    item = np.arange(len(q)) % len(body.names)
    np.testing.assert_allclose(body.end_points_of(item, X_WL), expected[np.arange(len(q)), item], atol=1e-12)


def test_clearances_are_the_least_of_every_capsule_box_and_pair():
    here = turned_cell()
    body = body_model(here)
    q = postures(here)
    capsules = capsules_of(here)
    ends = capsule_endpoints(here.robot, capsules, q, here.X_WB)
    moving = [i for i, capsule in enumerate(capsules) if capsule.frame > 0]
    floor = np.min([ends[:, i, :, 2].min(axis=1) - capsules[i].radius_m for i in moving], axis=0)
    boxes = [
        segment_shape_distance(ends[:, i, 0], ends[:, i, 1], box) - capsules[i].radius_m
        for i in moving
        for box in BOXES
    ]
    pairs = [
        segment_segment_distance(ends[:, i, 0], ends[:, i, 1], ends[:, j, 0], ends[:, j, 1])
        - capsules[i].radius_m
        - capsules[j].radius_m
        for i, j in body.pairs
    ]
    p = tool_pose(here, q)[:, :3, 3]
    found = body.clearances(q)
    assert found.floor == pytest.approx(floor + 0.1 - 0.02, abs=1e-12)
    assert found.keep_out == pytest.approx(np.min(boxes, axis=0) - 0.02, abs=1e-12)
    assert found.self_collision == pytest.approx(np.min(pairs, axis=0) - SELF_CLEARANCE_M, abs=1e-12)
    assert found.keep_in == pytest.approx(np.minimum(p - ROOM[0].lower, ROOM[0].upper - p).min(axis=1), abs=1e-12)


def test_a_posture_s_violations_name_what_is_too_close():
    here = cell()
    here = replace(here, surroundings=replace(here.surroundings, keep_in=ROOM, keep_out=BOXES, floor_z_m=-0.1))
    body = body_model(here)
    names = set()
    for q in postures(here, 40):
        clear = body.clearances(q[None])
        found = {each.constraint: each for each in body.violations_at(q)}
        broken = {name for name in vars(clear) if getattr(clear, name)[0] < 0.0}
        assert set(found) == broken or not broken
        ends = body.end_points(body.link_poses(q[None]))[..., 0]
        for name, each in found.items():
            assert each.value - each.limit == pytest.approx(getattr(clear, name)[0], abs=1e-12)
            first, second = each.detail.split(", ")[:2]
            names.add(name)
            if name == "keep_out":
                k = body.names.index(first)
                box = BOXES[int(second.removeprefix("box "))]
                assert each.value == segment_shape_distance(*ends[k], box) - body.radii[k]
            elif name == "self_collision":
                i = body.names.index(first)
                j = body.names.index(second)
                gap = segment_segment_distance(*ends[i], *ends[j]) - body.radii[i] - body.radii[j]
                assert each.value == pytest.approx(float(gap), abs=1e-12)
            elif name == "floor":
                k = body.names.index(first)
                assert each.value == pytest.approx(ends[k, :, 2].min() - body.radii[k] + 0.1, abs=1e-12)
            else:
                assert first == "tool centre point"
    assert names == {"floor", "keep_in", "keep_out", "self_collision"}


def test_a_posture_that_only_rounding_refuses_still_has_a_violation():
    (found,) = body_model(cell()).violations_at(cell().home)
    assert found.value >= found.limit
    assert found.value - found.limit == pytest.approx(float(body_model(cell()).clearances(cell().home[None]).least[0]))


def test_a_bin_is_named_as_what_is_too_close():
    target = TargetRelease(np.array([0.6, 0.1, 0.0]), opening=Opening(0.2, 0.5))
    problem = ThrowProblem(cell(), cell().home, target, cell().limits)
    around = problem.cell_with_bin.surroundings
    body = body_model(problem.cell_with_bin)
    q = next(q for q in postures(cell(), 400) if (body.clearances(q[None]).keep_out < 0.0).all())
    (found,) = (each for each in body.violations_at(q) if each.constraint == "keep_out")
    assert found.detail.split(", ")[1] in around.keep_out_names


def test_without_boxes_the_clearance_to_them_is_infinite():
    here = cell()
    here = replace(here, surroundings=replace(here.surroundings, keep_in=(), keep_out=()))
    found = body_model(here).clearances(postures(here))
    assert np.isposinf(found.keep_in).all()
    assert np.isposinf(found.keep_out).all()


def test_levers_bound_the_distances_from_the_axes():
    here = cell()
    body = body_model(here)
    q = postures(here, 200)
    X_BL = link_poses(here.robot, q)
    ends = capsule_endpoints(here.robot, capsules_of(here), q)
    for joint in range(6):
        axis = X_BL[:, joint, :3, 2]
        origin = X_BL[:, joint, :3, 3]
        offset = ends - origin[:, None, None]
        distance = np.linalg.norm(np.cross(np.broadcast_to(axis[:, None, None], offset.shape), offset), axis=-1)
        moved = body.frames > joint
        assert (distance.max(axis=(0, 2))[moved] <= body.levers[moved, joint] + 1e-9).all()
        assert (body.levers[~moved, joint] == 0.0).all()


def test_a_cell_has_one_model():
    here = cell()
    assert body_model(here) is body_model(here)
