"""Motions from rest to rest: where they go, their limits, and that no textbook one is faster."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planner.approach.rest_to_rest import rest_to_rest_motion
from planner.cell import load_cell
from planner.trajectory import integrate

LIMITS = replace(
    load_cell(Path(__file__).parents[3] / "cells" / "ur5e-sim.toml").limits,
    qd_max=np.full(6, 1.0), qdd_max=np.full(6, 1.4), jerk_max=np.full(6, 14.0),
)  # fmt: skip
joints = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.lists(joints, min_size=2, max_size=4), st.sampled_from([0.002, 0.008]))
@example([np.zeros(6), 1e-308 * np.eye(6)[5]], 0.002)
def test_it_rests_in_every_point_and_keeps_the_limits(points, dt):
    points = np.array(points)
    motion = rest_to_rest_motion(points, LIMITS, dt)
    q, qd, qdd = integrate(motion.q[0], motion.qd[0], motion.qdd[0], motion.jerk, dt)
    assert motion.q[[0, -1]] == pytest.approx(points[[0, -1]], abs=1e-9)
    assert q == pytest.approx(motion.q, abs=1e-8)
    assert qd[-1] == pytest.approx(np.zeros(6), abs=1e-8)
    assert qdd[-1] == pytest.approx(np.zeros(6), abs=1e-8)
    assert np.abs(motion.qd).max() <= 1.0 + 1e-9
    assert np.abs(motion.qdd).max() <= 1.4 + 1e-9
    assert np.abs(motion.jerk).max() <= 14.0 + 1e-6
    for point in points:
        rests = np.abs(motion.qd).max(axis=1) < 1e-9
        assert np.abs(motion.q[rests] - point).max(axis=1).min() < 1e-8


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.lists(joints, min_size=3, max_size=5), st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5), st.booleans())
def test_cut_corners_keep_the_limits_and_save_time(points, shares, slow):
    points = np.array(points)
    dt = 0.008 if slow else 0.002
    motion = rest_to_rest_motion(points, LIMITS, dt, np.array(shares[: len(points)]))
    q, qd, qdd = integrate(motion.q[0], motion.qd[0], motion.qdd[0], motion.jerk, dt)
    assert motion.q[[0, -1]] == pytest.approx(points[[0, -1]], abs=1e-9)
    assert q[-1] == pytest.approx(points[-1], abs=1e-8)
    assert np.concatenate([qd[-1], qdd[-1]]) == pytest.approx(np.zeros(12), abs=1e-8)
    assert np.abs(motion.qd).max() <= 1.0 + 1e-9
    assert np.abs(motion.qdd).max() <= 1.4 + 1e-9
    assert np.abs(motion.jerk).max() <= 14.0 + 1e-6
    assert motion.duration_s <= rest_to_rest_motion(points, LIMITS, dt).duration_s + 20 * dt


def test_a_corner_is_passed_without_a_stop_inside_the_triangle_that_it_cuts():
    points = np.zeros((3, 6))
    points[1:, 0] = 2.0
    points[2, 1] = 2.0
    motion = rest_to_rest_motion(points, LIMITS, 0.002, np.array([0.0, 0.5, 0.0]))
    middle = slice(len(motion.q) // 4, -len(motion.q) // 4)
    assert np.abs(motion.qd[middle]).max(axis=1).min() >= 0.2
    assert motion.duration_s < rest_to_rest_motion(points, LIMITS, 0.002).duration_s - 0.3
    away = np.abs(motion.q - points[1]).sum(axis=1)
    speed = 0.5  # cut on either side: half the way in the time that both speeds take to change
    assert away.min() <= speed * (speed / 1.4 + 0.1)
    assert (motion.q[:, 0] - motion.q[:, 1]).max() <= 2.0
    assert motion.q[:, 0].max() <= 2.0 + 1e-9


@pytest.mark.parametrize(
    ("way", "expected_s"),
    [
        (2.0, 2.0 / 1.0 + 1.0 / 1.4 + 1.4 / 14.0),  # cruises: d/v + v/a + a/j
        (0.3, 0.1 + np.sqrt(0.1**2 + 4.0 * 0.3 / 1.4)),  # reaches a, not v: a/j + root of (a/j)^2 + 4 d/a
        (0.002, 4.0 * (0.002 / (2.0 * 14.0)) ** (1.0 / 3.0)),  # reaches neither
    ],
)
def test_it_takes_the_time_of_the_double_s(way, expected_s):
    points = np.zeros((2, 6))
    points[1, 2] = way
    assert rest_to_rest_motion(points, LIMITS, 0.002).duration_s == pytest.approx(expected_s, abs=7 * 0.002)


def test_no_way_is_one_tick_at_rest():
    assert len(rest_to_rest_motion(np.zeros((2, 6)), LIMITS, 0.002).q) == 2
