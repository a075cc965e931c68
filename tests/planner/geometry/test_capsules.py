"""The capsules contain the arm: against what was measured on its meshes, and coal in throws that once met the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.arm_capsules import measured, measured_arms
from benchmarks.arm_capsules.truth import flight_gaps, tool_gaps
from planner.cell import ToolCapsule
from planner.geometry import arm_capsules, barriers, body_model, point_segment_distance
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.robots import ROBOT_NAMES, ShapeSource, robot
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell as shipped

TOOL = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.05),)

# Postures of joint releases that were certified with 5.7 and 6.1 mm between capsules, the tool's capsule being 2.9 and
# 8.4 mm inside the upper arm's mesh.
TOOL_IN_UPPER_ARM = {
    "ur5e-sim": [-0.047, -1.553, 2.63, -0.583, -0.58, -1.651],
    "ur10e-sim": [-0.04, -0.689, -2.579, -2.393, 1.04, 1.45],
}
# Targets near the base to which certified throws met the mesh of a link by 0.3 to 3.4 mm; with a window or without.
MET_BY_FLIGHT = [
    ("ur10e-sim", [0.5310654984673331, 0.013881666364548177, 0.0], True),
    ("ur5e-sim", [0.12818115096382593, 0.015329199938246284, 0.0], False),
    ("ur5e-sim", [0.24012973186070521, -0.12268314997589616, 0.0], False),
    ("ur5e-sim", [0.16154793620538663, -0.19474360459132412, 0.0], True),
    ("ur5e-sim", [0.15811800038952245, 0.006100782998138742, 0.0], True),
    ("ur5e-sim", [0.13990643268413394, -0.01369752705659635, 0.0], False),
]


@pytest.mark.parametrize("name", measured_arms())
def test_the_capsules_contain_every_part_of_the_arm(name):
    capsules = arm_capsules(robot(name))
    assert len(measured(name)) >= len(capsules)
    for part in measured(name):
        outside = [
            float((point_segment_distance(part.corners(), c.p0, c.p1) - c.radius_m).max())
            for c in capsules
            if c.frame == part.frame
        ]
        assert min(outside) <= 0.0, part.name


def test_arms_without_measured_capsules_have_those_of_the_same_meshes_or_an_estimate():
    others = [name for name in ROBOT_NAMES if name not in measured_arms()]
    assert {name for name in others if robot(name).shape.is_estimate} == {"ur15", "ur18"}
    for name, other in (("ur7e", "ur5e"), ("ur12e", "ur10e")):
        for mine, its in zip(arm_capsules(robot(name)), arm_capsules(robot(other)), strict=True):
            assert (mine.name, mine.frame, mine.radius_m) == (its.name, its.frame, its.radius_m)
            np.testing.assert_array_equal([mine.p0, mine.p1], [its.p0, its.p1])


@pytest.mark.parametrize("name", ["ur15", "ur18"])
def test_estimated_capsules_are_as_thick_as_the_larger_arms_at_their_own_lengths(name):
    arm = robot(name)
    larger = {capsule.name: capsule for capsule in arm_capsules(robot("ur20"))}
    own = {capsule.name: capsule for capsule in arm_capsules(arm)}
    assert own.keys() == larger.keys()
    assert all(capsule.radius_m >= larger[key].radius_m for key, capsule in own.items() if key != "foot")
    assert own["foot"].radius_m == 0.106  # 204 mm across, and what the UR20's has around its 245
    upper_m, fore_m = -arm.a[1:3]
    assert own["upper_arm_start"].p1[0] == pytest.approx(upper_m - (0.862 - larger["upper_arm_start"].p1[0]))
    assert own["forearm_start"].p1[0] == pytest.approx(fore_m - (0.7287 - larger["forearm_start"].p1[0]))
    assert own["wrist_3"].p1[2] == pytest.approx(arm.d[5] - (0.1543 - larger["wrist_3"].p1[2]))
    for tube, z in zip(("upper_arm", "forearm"), arm.shape.tubes_m, strict=True):
        assert own[tube].p0[2] == own[tube].p1[2] == pytest.approx(z)
    for capsule in own.values():  # no gap along the tubes, and none is turned round
        assert (capsule.p1 - capsule.p0) @ (larger[capsule.name].p1 - larger[capsule.name].p0) >= 0.0


@pytest.mark.parametrize(("name", "relative"), [("ur30", "ur20"), ("ur16e", "ur10e")])
def test_the_estimate_of_a_measured_arm_by_its_relative_contains_it(name, relative):
    """As UR15 and UR18 are estimated; these pairs differ in length alone."""
    arm = robot(name)
    tubes_m = tuple(float(capsule.p0[2]) for capsule in arm_capsules(arm) if capsule.name in ("upper_arm", "forearm"))
    estimated = arm_capsules(replace(arm, shape=ShapeSource(relative, tubes_m)))
    for part in measured(name):
        capsule = next(capsule for capsule in estimated if capsule.name == part.name)
        outside_m = (point_segment_distance(part.corners(), capsule.p0, capsule.p1) - capsule.radius_m).max()
        assert outside_m <= 0.0005, part.name


@pytest.mark.parametrize("name", measured_arms())
def test_the_parts_reach_from_the_table_to_the_flange(name):
    """What is measured is the whole arm: its extent along the axes, by the published lengths."""
    arm = robot(name)
    parts = {part.name: part.corners() for part in measured(name)}
    assert abs(parts["foot"][:, 2].min()) < 0.001
    assert abs(parts["wrist_3"][:, 2].max() - arm.d[5]) < 0.002
    for tube, start in (("upper_arm", -arm.a[1]), ("forearm", -arm.a[2])):
        assert parts[f"{tube}_start"][:, 0].max() > start - 0.06
        assert parts[tube][:, 0].min() < 0.3 * start


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_capsules_are_no_wider_than_a_free_arm_allows(name):
    """Only what folds the arm or its tool onto itself is barred, and on short arms the elbow beside the foot."""
    barred = [barrier for barrier in barriers(robot(name), TOOL) if "elbow" not in barrier.names]
    assert {barrier.joint for barrier in barred} <= {2, 4}
    for barrier in barred:
        assert np.abs(barrier.q).min() > np.radians(140.0), barrier.names


def test_the_shoulder_of_an_upright_arm_is_near_the_floor_only_where_that_is_too_high():
    """That of a UR5 is 22 mm above its table, wherever the arm goes."""
    here = shipped("ur5-sim")
    raised = replace(here, surroundings=replace(here.surroundings, floor_z_m=0.005))
    leaning = replace(here, X_WB=pose(np.zeros(3), rotation_vector_to_matrix(np.array([0.01, 0.0, 0.0]))))
    floors = [float(body_model(each).clearances(here.home[None]).floor[0]) for each in (here, raised, leaning)]
    assert floors[0] > 0.05
    assert floors[1] == pytest.approx(-0.003, abs=1e-3)
    assert 0.0 < floors[2] < 0.005


@pytest.mark.parametrize("name", TOOL_IN_UPPER_ARM)
def test_a_posture_with_the_tool_in_the_upper_arm_collides(name):
    cell = shipped(name)
    q = np.array(TOOL_IN_UPPER_ARM[name])
    assert min(tool_gaps(cell, q).values()) < 0.0
    assert body_model(cell).clearances(q[None]).self_collision[0] < 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "place", "with_window"), MET_BY_FLIGHT)
def test_the_object_keeps_off_the_arm_itself(name, place, with_window):
    cell = shipped(name)
    window_s = 0.005 if with_window else 0.0
    problem = ThrowProblem(cell, cell.home, TargetRelease(np.array(place)), cell.limits, window_s, 0.02)
    found = plan(problem)
    delays = (-window_s, 0.0, window_s)
    least = min(min(flight_gaps(problem, found.trajectory, delay).values()) for delay in delays)
    assert least >= min(found.certificate.check("flight_clearance").value, cell.surroundings.flight_clearance_m) - 1e-4
