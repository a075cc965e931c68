"""Flights against boxes and bins, compared with dense samples of the arcs."""

from __future__ import annotations

import numpy as np
import pytest

from planner.geometry import Arcs

GRAVITY = 9.81
RADIUS = 0.03


def drawn(rng: np.random.Generator, count: int) -> Arcs:
    """Flights of all directions from around the origin onto the plane z = 0.1."""
    p = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.2], (count, 3))
    return Arcs.onto(p, rng.uniform(-4.0, 4.0, (count, 3)), 0.1, GRAVITY, RADIUS)


def sampled(arcs: Arcs, count: int = 2000) -> np.ndarray:
    t = np.linspace(0.0, 1.0, count)[:, None] * arcs.until_s
    fall = 0.5 * GRAVITY * t[..., None] ** 2 * np.array([0.0, 0.0, 1.0])
    return arcs.p + arcs.v * t[..., None] - fall


def test_flights_end_where_the_sphere_touches_the_plane() -> None:
    arcs = drawn(np.random.default_rng(0), 500)
    flies = arcs.until_s > 0.0
    lowest = arcs.at(arcs.until_s)[:, 2]
    assert np.all(np.isclose(lowest, 0.1 + RADIUS) | np.isclose(lowest, 0.1) | ~flies)
    assert flies.mean() > 0.7


def test_a_flight_meets_the_grown_box_where_its_samples_do() -> None:
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(20):
        arcs = drawn(rng, 100)
        lower = rng.uniform([-0.8, -0.8, 0.0], [0.4, 0.4, 0.8])
        upper = lower + rng.uniform(0.02, 0.8, 3)
        x = sampled(arcs)
        grown = RADIUS + 0.01
        depth = np.minimum(x - lower + grown, upper + grown - x).min(axis=-1).max(axis=0)
        met = arcs.room_beside_box(lower, upper, 0.01) < 0.0
        clear_cut = (np.abs(depth) > 0.01) & (arcs.until_s > 0.0)
        np.testing.assert_array_equal(met[clear_cut], depth[clear_cut] > 0.0)
        hits += int(met.sum())
    assert hits > 100


def test_a_vertical_flight_meets_what_is_above_it_alone() -> None:
    arcs = Arcs.onto(np.zeros((1, 3)), np.array([[0.0, 0.0, 4.0]]), -0.5, GRAVITY, RADIUS)
    above = np.array([-0.1, -0.1, 0.7]), np.array([0.1, 0.1, 0.75])
    beside = above[0] + [0.5, 0.0, 0.0], above[1] + [0.5, 0.0, 0.0]
    assert arcs.room_beside_box(*above)[0] < 0.0
    assert arcs.room_beside_box(*beside)[0] == np.inf


def test_a_box_lacks_the_height_by_which_a_flight_passes_too_low() -> None:
    arcs = Arcs.onto(np.array([[0.0, 0.0, 0.5]]), np.array([[2.0, 0.0, 1.0]]), 0.0, GRAVITY, RADIUS)
    top = 0.5
    high = 1.0
    lower = np.array([0.4, -1.0, -1.0])
    upper = np.array([0.4, 1.0, top])
    at_wall = arcs.height_at(np.array([[0.2 - RADIUS / 2.0], [0.2 + RADIUS / 2.0]])).min()
    assert arcs.room_beside_box(lower, upper)[0] == pytest.approx(at_wall - top - RADIUS)
    raised = arcs.room_beside_box(lower, upper + np.array([0.0, 0.0, high]))[0]
    assert raised == pytest.approx(at_wall - top - high - RADIUS)


def test_flights_that_end_over_a_box_end_where_they_come_over_it() -> None:
    rng = np.random.default_rng(2)
    ended = 0
    for _ in range(20):
        arcs = drawn(rng, 100).until_landed(0.1, ())
        lower = rng.uniform([-1.5, -1.5, 0.0], [0.5, 0.5, 0.05])
        upper = lower + rng.uniform(0.3, 2.0, 3)
        x = sampled(arcs)
        over = arcs.until_over(lower, upper)
        within = np.all((x[..., :2] >= lower[:2]) & (x[..., :2] <= upper[:2]), axis=-1)
        first = within.argmax(axis=0) / (len(x) - 1)
        ends_over = within[-1] & (arcs.until_s > 0.0)
        np.testing.assert_allclose(over.until_s[ends_over], (first * arcs.until_s)[ends_over], atol=2e-3)
        np.testing.assert_array_equal(over.until_s[~within[-1]], arcs.until_s[~within[-1]])
        ended += int(ends_over.sum())
    assert ended > 100


def test_nothing_passes_below_what_stands_on_the_ground() -> None:
    arcs = Arcs.onto(np.array([[0.0, 0.0, 0.1]]), np.array([[2.0, 0.0, 2.0]]), 0.0, GRAVITY, RADIUS)
    for bottom, room in ((0.0, -1.3), (0.9, 0.5)):
        box = np.array([0.4, -1.0, bottom]), np.array([0.42, 1.0, 1.6])
        assert arcs.room_beside_box(*box, ground_z=0.0)[0] == pytest.approx(room, abs=0.2)
    standing = np.array([0.4, -1.0, 0.0]), np.array([0.42, 1.0, 1.6])
    assert arcs.room_beside_box(*standing)[0] > arcs.room_beside_box(*standing, ground_z=0.0)[0]


def test_what_a_flight_into_a_bin_lacks() -> None:
    """Straight down beside the axis: to the edge. Not as high as the rim: to its height, or to the mouth."""
    down = Arcs.onto(np.array([[0.06, 0.0, 1.0]]), np.zeros((1, 3)), 0.0, GRAVITY, RADIUS)
    assert down.room_in_mouth(np.zeros(3), 0.1, 0.3)[0] == pytest.approx(0.1 - 0.06 - RADIUS)
    apex_s = 1.0 / GRAVITY
    above = 0.1 + 0.5 * apex_s
    for x, rim, room in (
        (0.0, 0.3, above - 0.3 - RADIUS),
        (-0.5, above + 1e-6, 0.1 - 0.5 - RADIUS),
    ):  # where it is highest
        low = Arcs.onto(np.array([[x - apex_s, 0.0, 0.1]]), np.array([[1.0, 0.0, 1.0]]), 0.0, GRAVITY, RADIUS)
        assert low.room_in_mouth(np.zeros(3), 0.1, rim)[0] == pytest.approx(room)


def test_flights_that_enter_a_mouth_touch_neither_rim_nor_wall() -> None:
    rng = np.random.default_rng(2)
    entered = refused = 0
    for _ in range(40):
        radius = rng.uniform(0.06, 0.25)
        rim = rng.uniform(0.05, 0.4)
        centre = np.array([*rng.uniform(-1.5, 1.5, 2), 0.1])
        p = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.2], (200, 3))
        t = rng.uniform(0.4, 1.2, 200)
        v = (centre - p) / t[:, None] + 0.5 * GRAVITY * t[:, None] * np.array([0.0, 0.0, 1.0])
        arcs = Arcs.onto(p, v, 0.1, GRAVITY, RADIUS)
        x = sampled(arcs)
        out = np.hypot(*(x - centre)[..., :2].transpose(2, 0, 1)) - radius
        over = x[..., 2] - 0.1 - rim
        gap = np.hypot(out, np.maximum(over, 0.0)).min(axis=0)
        inside = arcs.room_in_mouth(centre, radius, rim) >= 0.0
        decided = (np.abs(gap - RADIUS) > 0.003) & (arcs.until_s > 0.0) & (out[0] > 0.0)
        np.testing.assert_array_equal(inside[decided], gap[decided] > RADIUS)
        entered = entered + int(inside.sum())
        refused = refused + int((~inside).sum())
    assert entered > 200
    assert refused > 200
