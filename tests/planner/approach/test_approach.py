"""Approaches to a plan's start, and the obstacles that they avoid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.approach import APPROACH_SPEED, find_approach, jog_advice, obstacle_words
from planner.cell import Box, Cell, shape_of
from planner.certificate import certify
from planner.geometry import body_model
from planner.kinematics import inverse
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner import problems
from tests.planner.approach.conftest import BrakedThrow, near_a_box, tool_position

LOWER = np.full(6, -np.pi)


def with_box(cell: Cell, centre: np.ndarray, half: float) -> Cell:
    """Returns the cell with a forbidden cube."""
    return problems.with_boxes(cell, (centre - half, centre + half))


def test_an_arm_at_the_start_does_not_move(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, failures = find_approach(throw.cell, start, start)
    assert approach is not None
    assert approach.trajectory is None
    assert not failures


def test_a_clear_approach_is_a_straight_move(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, _ = find_approach(throw.cell, start + np.array([0.5, 0, 0, 0, 0, 0]), start)
    assert approach is not None
    assert approach.goal == pytest.approx(start)
    assert approach.is_straight


@pytest.mark.parametrize("spare_m", [1e-5, 1e-3])
def test_a_start_barely_clear_is_left(throw: BrakedThrow, spare_m: float) -> None:
    """What the certificate accepts is not refused for a coarser bound or a wider margin, by either kind of motion."""
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    cell = near_a_box(throw.cell, q, spare_m)
    assert body_model(cell).clearances(q[None]).least[0] == pytest.approx(spare_m, rel=1e-6)
    lifted, _ = find_approach(cell, q, q + np.array([0, -0.4, 0, 0, 0, 0]))
    assert lifted is not None and lifted.is_straight
    behind = q + np.array([0.5, 0.0, 0.0, 0, 0, 0])
    walled = replace(
        cell,
        surroundings=replace(
            cell.surroundings,
            keep_out=(
                *cell.surroundings.keep_out,
                Box(*around_point(tool_position(cell, q + 0.5 * (behind - q)), 0.05)),
            ),
        ),
    )
    around, failures = find_approach(walled, q, behind)
    assert around is not None and not around.is_straight
    assert "keep-out box" in obstacle_words(failures)


def around_point(p: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of a cube."""
    return p - half, p + half


def test_a_start_measured_a_little_too_close_is_left(throw: BrakedThrow) -> None:
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    cell = near_a_box(throw.cell, q, -1e-3)
    lifted, failures = find_approach(cell, q, q + np.array([0.3, -0.4, 0, 0, 0, 0]))
    assert lifted is not None and lifted.trajectory is not None
    assert "at least" in obstacle_words(failures)
    t = np.linspace(0.0, lifted.trajectory.duration_s, 3000)
    least = body_model(cell).clearances(lifted.trajectory.at(t)[0]).least
    assert least.min() >= -1e-3 - 1e-9
    assert (least[len(least) // 2 :] > 0.0).all()


def test_a_start_much_too_close_is_refused_with_the_way_to_jog(throw: BrakedThrow) -> None:
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    cell = near_a_box(throw.cell, q, -5e-3)
    assert find_approach(cell, q, cell.home)[0] is None
    advice = jog_advice(cell, q)
    name, _, direction = advice.partition("by hand; ")[2].partition(" in the ")
    assert "keep-out box 0" in advice
    turn = np.zeros(6)
    turn[cell.robot.joint_names.index(name)] = 0.01 if direction.startswith("positive") else -0.01
    least = body_model(cell).clearances(np.array([q, q + turn])).least
    assert least[1] > least[0] + 1e-3
    assert not jog_advice(throw.cell, q)


def test_without_the_object_its_clearance_is_not_asked_for(throw: BrakedThrow) -> None:
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    big = replace(throw.cell, object=replace(throw.cell.object, radius_m=0.25))
    start = q + np.array([0.3, 0, 0, 0, 0, 0])
    high = body_model(throw.cell).clearances(np.array([q, start])).least.min()
    low = body_model(big).clearances(np.array([q, start])).least.max()
    assert low < 0.0 < high
    assert find_approach(big, q, start)[0] is None
    empty, failures = find_approach(big, q, start, with_object=False)
    assert empty is not None and empty.is_straight and not failures


def test_an_obstacle_in_the_straight_move_is_avoided(throw: BrakedThrow) -> None:
    cell = throw.cell
    start = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    now = start + np.array([1.6, 0, 0, 0, 0, 0])
    blocked = with_box(cell, tool_position(cell, (now + start) / 2.0), 0.12)
    approach, failures = find_approach(blocked, now, start)
    assert approach is not None and approach.trajectory is not None and approach.problem is not None
    assert not approach.is_straight
    assert "keep-out box" in obstacle_words(failures)  # in the straight move
    motion = approach.trajectory
    assert motion.q[0] == pytest.approx(now, abs=1e-9)
    assert motion.q[-1] == pytest.approx(start, abs=1e-9)
    assert body_model(blocked).clearances(motion.at(np.linspace(0.0, motion.duration_s, 5000))[0]).least.min() > 0.0
    assert np.abs(motion.qd).max() <= APPROACH_SPEED
    assert certify(approach.problem, motion).valid


def test_a_corner_is_passed_without_a_stop(throw: BrakedThrow) -> None:
    """Between its ends the arm stopped at every corner: four pieces of seven seconds for one of four."""
    cell = throw.cell
    start = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    now = start + np.array([1.6, 0, 0, 0, 0, 0])
    blocked = with_box(cell, tool_position(cell, (now + start) / 2.0), 0.12)
    approach, _ = find_approach(blocked, now, start)
    assert approach is not None and approach.trajectory is not None
    speed = np.abs(approach.trajectory.qd).max(axis=1)
    moving = np.flatnonzero(speed > 0.05)
    assert (speed[moving[0] : moving[-1]] > 0.05).all()


def test_a_goal_a_little_too_close_is_reached_as_a_start_is_left(throw: BrakedThrow) -> None:
    q = np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0])
    cell = near_a_box(throw.cell, q, -1e-3)
    away = q + np.array([0.3, -0.4, 0, 0, 0, 0])
    lowered, failures = find_approach(cell, away, q)
    assert lowered is not None and lowered.trajectory is not None
    assert failures
    assert lowered.trajectory.q[-1] == pytest.approx(q)
    least = body_model(cell).clearances(lowered.trajectory.q).least
    assert least.min() >= -1e-3 - 1e-9
    assert (least[: len(least) // 2] > 0.0).all()
    assert find_approach(near_a_box(throw.cell, q, -5e-3), away, q)[0] is None


def shelf(cell: Cell) -> Cell:
    """The cell with a turned shelf of two boards in front of the arm, a post beside it and a can on its lower board."""
    middle = np.array([0.65, 0.3, 0.45])
    turn = rotation_vector_to_matrix(np.array([0.0, 0.0, np.arctan2(middle[1], middle[0])]))
    boards = [
        ("box", [0.0, 0.0, -0.2], [0.4, 0.6, 0.03]),
        ("box", [0.0, 0.0, 0.2], [0.4, 0.6, 0.03]),
        ("box", [0.0, 0.3, 0.0], [0.4, 0.03, 0.4]),
        ("box", [0.0, -0.3, 0.0], [0.4, 0.03, 0.4]),
        ("box", [0.2, 0.0, 0.0], [0.03, 0.6, 0.4]),
        ("cylinder", [-0.1, 0.18, -0.1], [0.04, 0.15]),
        ("cylinder", [-0.3, -0.6, 0.0], [0.05, 0.9]),
    ]
    shapes = [shape_of(kind, pose(middle + turn @ np.array(at), turn), np.array(size)) for kind, at, size in boards]
    return problems.with_shapes(cell, *shapes)


@pytest.mark.parametrize("name", ["ur5e-sim", "ur5-sim"])
def test_a_shelf_is_left_to_the_other_side(name: str) -> None:
    """From within a shelf to behind the arm, the wrist turned the other way: of twenty such problems seven were solved,
    after seconds.
    """
    cell = problems.cell(name)
    cell = shelf(replace(cell, surroundings=replace(cell.surroundings, clearance_m=0.01)))
    inside = posture_in(cell, np.array([0.55, 0.25, 0.4]))
    behind = np.array([-2.4, -1.2, -1.6, -0.3, -np.sign(inside[4]) * 1.57, 0.0])
    way, failures = find_approach(cell, inside, behind, with_object=False)
    assert failures
    assert way is not None and way.problem is not None and way.trajectory is not None
    assert certify(way.problem, way.trajectory).valid
    again, _ = find_approach(cell, inside, behind, with_object=False)
    assert again is not None and again.trajectory is not None
    assert np.array_equal(again.trajectory.q, way.trajectory.q)


def posture_in(cell: Cell, p: np.ndarray) -> np.ndarray:
    """Returns a clear posture (6,) with the tool level and outwards at a point (3,)."""
    yaw = np.arctan2(p[1], p[0])
    R = np.array([[0.0, np.sin(yaw), np.cos(yaw)], [0.0, -np.cos(yaw), np.sin(yaw)], [1.0, 0.0, 0.0]])
    found = inverse(cell.robot, np.linalg.inv(cell.X_WB) @ pose(p, R), cell.tool.X_FT, q_lower=LOWER, q_upper=-LOWER).q
    spare = body_model(cell).clearances(found, with_object=False).least
    assert spare.max() > 0.0
    return found[int(spare.argmax())]


def test_a_wrist_bent_as_far_as_it_may_be_has_a_way_home() -> None:
    """The end of a throw: 1e-6 m to spare between wrist and forearm, 0.5 mm within 0.05 rad, a box in the way."""
    box = [-0.4013286, -0.21140771, 0.8391231], [-0.197399, -0.107188, 1.223765]
    ur5e = problems.with_boxes(problems.cell("ur5e-sim"), box)
    end = np.array([1.53738961, -2.43792612, 0.860857, -2.67291442, -2.9989, -0.10969109])
    assert 0.0 <= body_model(ur5e).clearances(end[None], with_object=False).least[0] < 1e-5
    home, failures = find_approach(ur5e, end, ur5e.home, with_object=False)
    assert "keep-out box" in obstacle_words(failures)  # in the straight move
    assert home is not None and home.problem is not None and home.trajectory is not None
    assert certify(home.problem, home.trajectory).valid


def test_where_no_approach_is_found_the_obstacle_is_named(throw: BrakedThrow) -> None:
    cell = throw.cell
    start = throw.trajectory.q[0]
    blocked = with_box(cell, tool_position(cell, start), 0.1)
    approach, failures = find_approach(blocked, start + np.array([1.0, 0, 0, 0, 0, 0]), start)
    assert approach is None
    assert "keep-out box" in obstacle_words(failures)


def test_an_approach_beyond_a_joints_range_is_refused(throw: BrakedThrow) -> None:
    start = throw.trajectory.q[0]
    approach, failures = find_approach(throw.cell, start, start + np.array([0, 0, 7.0, 0, 0, 0]))
    assert approach is None
    assert [check.name for check in failures] == ["joint_position"]
