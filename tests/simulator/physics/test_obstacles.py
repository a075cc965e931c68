"""Objects that meet boxes and bins in flight, against the parabola and against densely sampled flights."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from planner.flight import drag_constant, path
from simulator.physics.obstacles import RoundBin
from tests.simulator.conftest import make_cell, world_of

G = 9.81
RADIUS = 0.02
NEAR_M = 3e-4  # the simulator stops an object up to 0.1 mm before it touches
BOX_LOWER = np.array([0.9, -0.6, 0.0])
BOX_UPPER = np.array([1.1, 0.6, 0.5])
WALL = "surroundings = { keep_out = [{ lower_m = [0.9, -0.6, 0.0], upper_m = [1.1, 0.6, 0.5] }] }\n"
DRAG = "object = { mass_kg = 0.05, radius_m = 0.02, drag_coefficient = 0.47 }\n"
BIN = RoundBin((1.0, 0.0, 0.1), 0.15, 0.2)
AT_THE_RIM_M = 0.3  # height of the mouth


def landed(state: tuple[float, ...], tables: str = "", bin: RoundBin | None = None, dt: float = 0.002) -> Any:
    """Returns the only landing of an object released with `state` at time 0."""
    world = world_of(make_cell(tables=tables))
    world.place_bin(bin)
    world.release(1, 0.0, state, 0.0)
    for k in range(1, 20000):
        world.cycle(k * dt, dt)
        if not world.flights:
            break
    (landing,) = world.landings
    return landing


def at(state: tuple[float, ...], t: float) -> np.ndarray:
    """Returns the parabola's position at `t`."""
    p = np.array(state[:3])
    v = np.array(state[3:])
    return p + v * t - 0.5 * np.array([0.0, 0.0, G]) * t**2


@pytest.mark.parametrize("dt", [0.002, 0.008])
def test_a_wall_stops_the_object_where_its_parabola_meets_the_face(dt: float):
    state = (0.0, 0.1, 0.3, 3.0, 0.2, 1.0)
    landing = landed(state, WALL, dt=dt)
    t = (0.9 - RADIUS) / 3.0
    assert 0.0 < at(state, t)[2] < 0.5
    assert landing["surface"] == "keep_out[0]"
    assert landing["t"] == pytest.approx(t, abs=1e-4)
    np.testing.assert_allclose(landing["position_m"], at(state, t), atol=NEAR_M)


def test_the_underside_of_a_box_stops_an_object_that_rises():
    tables = "surroundings = { keep_out = [{ lower_m = [-1.0, -1.0, 1.0], upper_m = [1.0, 1.0, 1.2] }] }\n"
    landing = landed((0.0, 0.0, 0.5, 0.2, 0.0, 4.0), tables)
    rise = 1.0 - RADIUS - 0.5
    assert landing["t"] == pytest.approx((4.0 - math.sqrt(16.0 - 2.0 * G * rise)) / G, abs=1e-4)
    assert landing["position_m"][2] == pytest.approx(1.0 - RADIUS, abs=NEAR_M)


@pytest.mark.parametrize(("tables", "arcs"), [(WALL, 40), (WALL + DRAG, 12)])
def test_boxes_are_met_where_densely_sampled_flights_meet_them(tables: str, arcs: int):
    """Also where only an edge is touched; arcs that pass within a millimetre of touching are left out."""
    random = np.random.default_rng(5)
    met = 0
    thrown = make_cell(tables=tables).object
    drag = drag_constant(thrown.mass_kg, thrown.radius_m, thrown.drag_coefficient)
    for _ in range(arcs):
        state = (0.2, 0.0, 0.4, random.uniform(1.5, 2.5), random.uniform(-0.6, 0.6), random.uniform(0.0, 2.5))
        times = np.arange(0.0, 1.0, 1e-3)
        points = path(state[:3], state[3:], times, G, drag)
        gaps = np.linalg.norm(points - np.clip(points, BOX_LOWER, BOX_UPPER), axis=1) - RADIUS
        gaps = gaps[points[:, 2] > 0.0]
        landing = landed(state, tables)
        if abs(gaps.min()) < 1e-3:
            continue
        assert (landing["surface"] == "keep_out[0]") == (gaps.min() < 0.0)
        if gaps.min() < 0.0:
            met += 1
            first = points[np.argmax(gaps < 0.0)]
            if first[2] < 0.5:  # on the top it lies down instead, below
                np.testing.assert_allclose(landing["position_m"], first, atol=4e-3)
    assert 0 < met < arcs


def test_an_object_that_touches_the_top_of_a_box_lies_down_on_it():
    """Its centre comes down through the plane of the top, as on the plane of a target."""
    state = (0.6, 0.0, 0.8, 1.0, 0.0, 1.0)
    landing = landed(state, WALL)
    t = (1.0 + math.sqrt(1.0 + 2.0 * G * 0.3)) / G
    assert (landing["surface"], landing["position_m"][2]) == ("keep_out[0]", 0.5)
    np.testing.assert_allclose(landing["position_m"], at(state, t), atol=1e-6)


@pytest.mark.parametrize(("top_m", "x_m", "stops"), [
    (0.6, 1.03, True), (0.51, 1.03, True), (0.5009, 1.03, False), (0.6, 1.071, False),
])  # fmt: skip
def test_an_object_on_a_box_goes_on_until_it_meets_what_is_higher(top_m: float, x_m: float, stops: bool):
    """It touches the top at x = 0.99 m, where its centre is to come down at 1.05 m."""
    state = (0.6, 0.0, 0.55, 3.0, 0.0, 0.5 * G * 0.15 - 0.05 / 0.15)
    post = f"{{ lower_m = [{x_m}, -0.1, 0.5], upper_m = [{x_m + 0.001}, 0.1, {top_m}] }}"
    landing = landed(state, WALL.replace("}] }", f"}}, {post}] }}"))
    before_m = math.sqrt(RADIUS**2 - max(0.0, 0.5 + RADIUS - top_m) ** 2)
    assert landing["surface"] == ("keep_out[1]" if stops else "keep_out[0]")
    assert landing["position_m"][0] == pytest.approx(x_m - before_m if stops else 1.05, abs=NEAR_M)


@pytest.mark.parametrize("dt", [0.002, 0.008])
@pytest.mark.parametrize("rim_height_m", [0.0, 0.01, 0.2])
def test_an_object_that_enters_the_mouth_lands_on_the_bottom(dt: float, rim_height_m: float):
    state = (0.8, 0.0, 0.9, 0.4, 0.0, 1.0)
    bin = RoundBin(BIN.bottom, BIN.radius_m, rim_height_m)
    landing = landed(state, bin=bin, dt=dt)
    t = (1.0 + math.sqrt(1.0 + 2.0 * G * 0.8)) / G
    assert landing["surface"] == "bin"
    np.testing.assert_allclose(landing["position_m"], at(state, t), atol=1e-6)


@pytest.mark.parametrize("dt", [0.002, 0.008])
def test_the_bottom_of_a_bin_stops_an_object_from_below(dt: float):
    raised = RoundBin((1.0, 0.0, 0.5), 0.15, 0.05)
    state = (0.9, 0.0, 0.2, 0.1, 0.0, 3.5)  # without the bottom it would rise out of the mouth and fall into it
    landing = landed(state, bin=raised, dt=dt)
    assert landing["surface"] == "bin wall"
    assert landing["position_m"][2] == pytest.approx(0.5 - RADIUS, abs=1e-3)


def test_the_inside_of_a_bin_lets_an_object_fall_to_the_bottom():
    state = (0.6, 0.0, 0.6, 1.3, 0.0, 1.0)  # in at the near side, against the far side
    wall = BIN.bottom[0] + BIN.radius_m - RADIUS
    touches = (wall - 0.6) / 1.3
    assert 0.1 < at(state, touches)[2] < AT_THE_RIM_M
    landing = landed(state, bin=BIN)
    assert landing["surface"] == "bin"
    np.testing.assert_allclose(landing["position_m"], [wall, 0.0, 0.1], atol=NEAR_M)
    speed = G * touches - 1.0
    drop = at(state, touches)[2] - 0.1
    falls = (math.sqrt(speed**2 + 2.0 * G * drop) - speed) / G
    assert landing["t"] == pytest.approx(touches + falls, abs=1e-3)


@pytest.mark.parametrize(("height", "surface"), [(0.25, "bin wall"), (0.62, "floor")])
def test_the_outside_of_a_bin_stops_an_object(height: float, surface: str):
    state = (0.5, 0.0, height, 3.0, 0.0, 0.0)
    landing = landed(state, bin=BIN)
    assert landing["surface"] == surface
    if surface == "bin wall":
        t = (1.0 - BIN.radius_m - RADIUS - 0.5) / 3.0
        np.testing.assert_allclose(landing["position_m"], at(state, t), atol=NEAR_M)


def test_the_rim_stops_an_object_that_comes_down_on_it():
    landing = landed((1.0 + BIN.radius_m, 0.0, 0.8, 0.0, 0.0, 0.0), bin=BIN)
    assert landing["surface"] == "bin wall"
    assert landing["position_m"][2] == pytest.approx(AT_THE_RIM_M + RADIUS, abs=NEAR_M)


POST = 'shape = "cylinder", pose = { position_m = [1.0, 0.0, 0.25] }, radius_m = 0.1, length_m = 0.5'


def among(entry: str) -> str:
    return f"surroundings = {{ keep_out = [{{ {entry} }}] }}\n"


def test_a_post_stops_the_object_where_its_parabola_meets_the_wall():
    state = (0.0, 0.05, 0.3, 3.0, 0.0, 1.0)
    landing = landed(state, among(POST))
    t = (1.0 - math.sqrt((0.1 + RADIUS) ** 2 - 0.05**2)) / 3.0
    assert landing["surface"] == "keep_out[0]"
    assert landing["t"] == pytest.approx(t, abs=2e-4)
    np.testing.assert_allclose(landing["position_m"], at(state, t), atol=5e-4)


@pytest.mark.parametrize(
    ("entry", "place", "lands"),
    [
        (POST, (1.06, 0.06), True),
        (POST, (1.09, 0.09), False),  # over the square about it alone
        ('shape = "box", pose = { position_m = [1.0, 0.0, 0.25], rotation_vector_rad = [0, 0, 0.785398] }, '
         'size_m = [0.2, 0.2, 0.5]', (1.12, 0.0), True),
        ('shape = "box", pose = { position_m = [1.0, 0.0, 0.25], rotation_vector_rad = [0, 0, 0.785398] }, '
         'size_m = [0.2, 0.2, 0.5]', (1.09, 0.09), False),
    ],
)  # fmt: skip
def test_an_object_that_falls_on_a_level_top_lies_there(entry: str, place: tuple[float, float], lands: bool):
    landing = landed((*place, 0.8, 0.0, 0.0, 0.0), among(entry))
    np.testing.assert_allclose(landing["position_m"], [*place, 0.5 if lands else 0.0], atol=NEAR_M)
    assert landing["surface"] == ("keep_out[0]" if lands else "floor")


@pytest.mark.parametrize(
    ("entry", "top_z"),
    [
        ('shape = "box", pose = { position_m = [1.0, 0.0, 0.3], rotation_vector_rad = [0, 0.3, 0] }, '
         'size_m = [0.4, 0.4, 0.2]', 0.3 + (0.1 + RADIUS) / math.cos(0.3)),
        ('shape = "sphere", pose = { position_m = [1.0, 0.0, 0.3] }, radius_m = 0.2', 0.5 + RADIUS),
        ('shape = "capsule", pose = { position_m = [1.0, 0.0, 0.3], rotation_vector_rad = [1.570796, 0, 0] }, '
         'radius_m = 0.1, length_m = 0.4', 0.4 + RADIUS),
    ],
)  # fmt: skip
def test_a_slope_or_a_round_top_stops_an_object_where_it_touches(entry: str, top_z: float):
    landing = landed((1.0, 0.0, 0.9, 0.0, 0.0, 0.0), among(entry))
    np.testing.assert_allclose(landing["position_m"], [1.0, 0.0, top_z], atol=NEAR_M)
    assert landing["surface"] == "keep_out[0]"


@pytest.mark.parametrize("speed", [0.0, 0.5, -1.5])
def test_a_bin_on_a_belt_catches_what_meets_it_and_nothing_else(speed: float):
    """A lob that comes down at x = 1.0 after a second, where the bin then is, or was half a second before."""
    lob = (0.0, 0.0, 0.1, 1.0, 0.0, G / 2.0)
    caught = landed(lob, bin=RoundBin((1.0, 0.0, 0.1), 0.15, 0.05, (0.0, speed, 0.0), 1.0))
    assert (caught["surface"], caught["t"]) == ("bin", pytest.approx(1.0, abs=1e-6))
    assert caught["position_m"] == pytest.approx([1.0, 0.0, 0.1], abs=1e-6)
    gone = landed(lob, bin=RoundBin((1.0, 0.0, 0.1), 0.15, 0.05, (0.0, speed, 0.0), 0.5))
    assert (gone["surface"] == "bin") == (abs(0.5 * speed) < 0.15)


def test_what_touches_the_wall_inside_moves_on_with_the_bin():
    lob = (0.0, 0.0, 0.5, 1.0, 0.0, 0.0)
    speed = 0.4
    inside = landed(lob, bin=RoundBin((0.15, 0.0, 0.0), 0.1, 0.45, (0.0, speed, 0.0), 0.0))
    assert inside["surface"] == "bin"
    assert abs(inside["position_m"][1] - speed * inside["t"]) < 0.1
