"""Turned and round shapes: distances against coal, depth, bounds, level tops, and where an object fits beside them."""

import numpy as np
import pytest

from benchmarks.shape_distances import BODIES, MESH_TOLERANCE_M, TOLERANCE_M, compared
from planner.cell import Box, shape_of
from planner.geometry import Arcs, footprint, landing_surfaces, misfit, segment_shape_distance
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell, with_shapes

KINDS = ("box", "cylinder", "sphere", "capsule")
PAIRS = 500


def sizes_of(kind, rng):
    sizes = rng.uniform(0.02, 0.8, 3 if kind == "box" else 2)
    return np.array([sizes[0], 0.0]) if kind == "sphere" else sizes


def turned(rng, place=(-0.5, 0.5)):
    return pose(rng.uniform(*place, 3), rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3)))


def drawn(kind, seed):
    """Shapes with points within and about each."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    for _ in range(20):
        X = turned(rng)
        yield shape_of(kind, X, sizes_of(kind, rng)), rng.uniform(-1.2, 1.2, (400, 3))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, "mesh"])
@pytest.mark.parametrize("body", BODIES)
def test_the_distance_of_a_body_from_a_shape_is_that_of_coal(body, kind):
    found = compared(body, kind, PAIRS, seed=3)
    assert found.apart > 0.7 * PAIRS
    assert found.worst_m < (MESH_TOLERANCE_M if kind == "mesh" else TOLERANCE_M)
    assert found.outside == 0


@pytest.mark.parametrize(
    ("p0", "p1", "expected"),
    [
        ([2, 0, 0], [2, 0, 5], 1.0),  # along the wall
        ([-3, 1.5, 0], [3, 1.5, 0], 0.5),  # past the wall
        ([-3, 0.2, 2], [3, 0.2, 2], 1.0),  # over the top
        ([2, -3, 2], [2, 3, 2], np.sqrt(2.0)),  # past the rim
        ([-3, 0, 0], [3, 0, 0], 0.0),  # through
        ([0, 0, 0.5], [0, 0, 0.5], 0.0),  # a point inside
        ([0, 0, 3], [0, 0, 3], 2.0),  # a point above
        ([0, 3, 4], [0, 1.5, 2], np.hypot(0.5, 1.0)),  # an end
    ],
)
def test_cylinders_in_closed_form(p0, p1, expected):
    cylinder = shape_of("cylinder", np.eye(4), np.array([1.0, 2.0]))
    assert segment_shape_distance(p0, p1, cylinder) == pytest.approx(expected, abs=1e-12)
    assert segment_shape_distance(p1, p0, cylinder) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shape_reaches_its_bounds_and_no_farther(kind):
    for shape, p in drawn(kind, 1):
        near = shape.nearest(p.T).T
        apart = p - near
        away = np.linalg.norm(apart, axis=1, keepdims=True)
        on = near + shape.radius_m * apart / np.maximum(away, 1e-12)
        on = on[away[:, 0] > 1e-6]
        assert (on > shape.lower - 1e-9).all()
        assert (on < shape.upper + 1e-9).all()
        for axis in range(3):  # far along an axis the nearest points are where the shape ends
            far = 1e6 * np.eye(3)[axis]
            assert shape.nearest(far)[axis] + shape.radius_m == pytest.approx(shape.upper[axis], abs=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_depth_and_distance_tell_in_from_out(kind):
    for shape, p in drawn(kind, 2):
        depth = shape.depth(p)
        distance = segment_shape_distance(p, p, shape)
        assert ((depth > 0.0) == (distance <= 0.0)).all()
        inside = p[depth > 0.0]
        if len(inside) and kind in ("box", "cylinder"):  # so far in every direction it is still inside
            steps = np.random.default_rng(0).normal(size=(50, 1, 3))
            steps = 0.999 * depth[depth > 0.0][:, None] * steps / np.linalg.norm(steps, axis=2, keepdims=True)
            assert (shape.depth(inside + steps) >= 0.0).all()


def test_a_box_that_is_not_turned_is_a_box_along_the_axes():
    straight = shape_of("box", pose([1.0, 2.0, 3.0], np.eye(3)), np.array([0.2, 0.4, 0.6]))
    assert isinstance(straight, Box)
    np.testing.assert_allclose([straight.lower, straight.upper], [[0.9, 1.8, 2.7], [1.1, 2.2, 3.3]])
    np.testing.assert_allclose(straight.extent, [0.2, 0.4, 0.6])
    quarter = shape_of("box", pose([1.0, 2.0, 3.0], rotation_vector_to_matrix([0, 0, np.pi / 2])), straight.extent)
    np.testing.assert_allclose([quarter.lower, quarter.upper], [[0.8, 1.9, 2.7], [1.2, 2.1, 3.3]])


def on_table(kind, turn, top_m=0.4):
    X = pose([1.2, 0.2, 0.5 * top_m], rotation_vector_to_matrix(turn))
    sizes = np.array([0.4, 0.2, top_m]) if kind == "box" else np.array([0.2, top_m])
    return shape_of(kind, X, sizes)


@pytest.mark.parametrize(("kind", "turn"), [("box", [0, 0, 0.7]), ("cylinder", [0, 0, 0.7]), ("cylinder", [0, 0, 0])])
def test_an_object_lands_on_a_level_top_within_its_outline(kind, turn):
    table = on_table(kind, turn)
    here = with_shapes(cell(), table)
    middle = np.array([1.2, 0.2, 0.4])
    (surface,) = landing_surfaces(here, middle)
    assert surface.height_m == pytest.approx(0.4)
    rng = np.random.default_rng(1)
    for x in middle + rng.uniform(-0.3, 0.3, (300, 3)) * [1.0, 1.0, 0.0]:
        inside = footprint(table).depth(x) >= 0.0
        assert inside == (table.depth(x - [0.0, 0.0, 0.1]) >= 0.0)
        on = [each for each in landing_surfaces(here, x) if each.height_m > 0.1]
        assert bool(on) == inside
    assert misfit(here, middle) is None
    assert misfit(here, middle - [0.0, 0.0, 0.01]).name == f"{kind} 0"


@pytest.mark.parametrize(("kind", "turn"), [("box", 0.3), ("cylinder", 0.2)])
def test_an_object_does_not_lie_on_a_slope(kind, turn):
    shape = on_table(kind, [turn, 0, 0])
    here = with_shapes(cell(), shape)
    top = np.array([1.2, 0.2, 0.2 + 0.2 / np.cos(turn)])
    assert not shape.has_level_top
    assert all(surface.of is None and np.isinf(surface.upper).all() for surface in landing_surfaces(here, top))
    up = np.array([0.0, 0.0, 1.0])
    assert misfit(here, top + 0.001 * up).name == f"{kind} 0"
    assert misfit(here, top + 0.2 * up) is None


@pytest.mark.parametrize("corner", [(1.0, 0.35), (-2.0, -2.0)])  # beside it, and far away
def test_tops_that_are_turned_are_not_joined_to_others(corner):
    table = on_table("box", [0, 0, 0.7])
    as_high = Box(np.array([*corner, 0.0]), np.array([corner[0] + 0.5, corner[1] + 0.5, 0.4]))
    surfaces = landing_surfaces(with_shapes(cell(), table, as_high), np.array([1.2, 0.2, 0.4]))
    assert [surface.of for surface in surfaces] == [table]


@pytest.mark.parametrize("kind", KINDS)
def test_the_room_of_a_flight_is_its_distance_from_a_shape(kind):
    rng = np.random.default_rng(5)
    p = rng.uniform([-1.5, -1.5, 0.5], [1.5, 1.5, 1.5], (200, 3))
    v = rng.uniform([-3.0, -3.0, -1.0], [3.0, 3.0, 3.0], (200, 3))
    arcs = Arcs(p, v, np.full(200, 0.5), 9.81, 0.03)
    shape = shape_of(kind, turned(rng), sizes_of(kind, rng) * 0.5 + 0.1)
    t = np.linspace(0.0, 0.5, 1001)
    x = np.array([arcs.at(np.full(200, s)) for s in t])
    least = segment_shape_distance(x, x, shape).min(axis=0) - 0.03 - 0.01
    room = arcs.room_beside_shape(shape, 0.01)
    hit = least < -0.02
    assert hit.any()
    assert (room[hit] < 0.0).all()
    assert (room[least > 0.0] >= 0.0).all()
