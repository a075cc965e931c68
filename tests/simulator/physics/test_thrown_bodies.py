"""Bodies in the simulated world: they turn free of torque, land as their shape touches, and landings tell the axis."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Cell, ThrownBody, cell_of_keys
from planner.flight import drag_constant
from planner.rotations import quaternion_to_matrix, rotation_vector_to_matrix
from planner.spin import turned
from simulator.physics.turning import TurningBody
from simulator.physics.world import Attitude, World
from simulator.truth import truth_of
from tests.simulator.conftest import make_cell

DT = 0.002
ROD = {"shape": "cylinder", "mass_kg": 0.1, "radius_m": 0.01, "length_m": 0.2}


def _cell(*shapes: dict) -> Cell:
    keys = make_cell().document
    around = {**keys["surroundings"], "keep_out": list(shapes)}
    return cell_of_keys({**keys, "object": ROD, "surroundings": around})


def _thrown(cell: Cell, state: tuple[float, ...], spin: list[float], until_s: float = 2.0) -> World:
    """Returns the world after an object left with its axis along the world's x, turning at `spin` [rad/s]."""
    world = World(cell, 0.0, truth_of(cell))
    pose = np.eye(4)
    pose[:3, :3] = rotation_vector_to_matrix([0.0, 0.5 * np.pi, 0.0])
    world.release(1, 0.0, state, 0.0, Attitude(pose[:3].ravel().tolist(), spin))
    for cycle in range(round(until_s / DT)):
        world.cycle((cycle + 1) * DT, DT)
    return world


def test_a_rod_lands_as_it_touches() -> None:
    world = _thrown(_cell(), (0.5, 0.0, 0.8, 1.0, 0.0, 1.0), [0.0, 3.0, 0.0])
    landing = world.landings[0]
    t = landing["t"]
    angle = 3.0 * t
    assert landing["axis"] == pytest.approx([np.cos(angle), 0.0, -np.sin(angle)], abs=1e-7)
    assert world.observations[0]["axis"] == landing["axis"]
    assert world.releases[0]["axis"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    height = 0.8 + t - 0.5 * 9.81 * t**2
    assert height == pytest.approx(0.1 * abs(np.sin(angle)) + 0.01 * abs(np.cos(angle)), abs=1e-4)
    assert landing["position_m"] == pytest.approx([0.5 + t, 0.0, 0.0], abs=1e-6)
    assert len(world.landings) == 1


def test_a_rod_lands_on_a_table_with_its_end_and_stops_at_its_side() -> None:
    table = {"name": "table", "lower_m": [0.8, -1.0, 0.0], "upper_m": [2.5, 1.0, 0.4]}
    on = _thrown(_cell(table), (0.0, 0.0, 0.8, 2.0, 0.0, 2.0), [0.0, 3.0, 0.0]).landings[0]
    angle = 3.0 * on["t"]
    height = 0.8 + 2.0 * on["t"] - 0.5 * 9.81 * on["t"] ** 2
    assert on["surface"] == "keep_out[0]"
    assert on["position_m"][2] == pytest.approx(0.4)
    assert height - 0.4 == pytest.approx(0.1 * abs(np.sin(angle)) + 0.01 * abs(np.cos(angle)), abs=3e-4)
    side = _thrown(_cell(table), (0.0, 0.0, 0.35, 4.0, 0.0, 0.0), [0.0, 0.0, 0.0]).landings[0]
    assert side["surface"] == "keep_out[0]"
    assert side["position_m"][0] < 0.8


@pytest.mark.parametrize("name", ["rod", "brick", "capsule"])
def test_the_simulator_agrees_with_the_planner_on_shape_and_rotation(name: str) -> None:
    keys = {
        "rod": ROD,
        "brick": {"shape": "box", "mass_kg": 0.1, "size_m": [0.03, 0.05, 0.08]},
        "capsule": {"shape": "capsule", "mass_kg": 0.1, "radius_m": 0.02, "length_m": 0.1},
    }[name]
    turn = {"in_tool": {"rotation_vector_rad": [0.3, -0.2, 0.5]}}
    thing = cell_of_keys({**make_cell().document, "object": {**keys, **turn}}).object
    assert isinstance(thing, ThrownBody)
    body = TurningBody(thing)
    rng = np.random.default_rng(5)
    R_WT = quaternion_to_matrix(rng.normal(size=(20, 4)))
    w_W = 6.0 * rng.normal(size=(20, 3))
    times = rng.uniform(0.0, 0.8, 20)
    expected = turned(R_WT @ thing.R_TO, w_W, thing.inertia_kg_m2, times)
    for row in range(20):
        turning = body.after(body.leaving(R_WT[row], w_W[row].tolist()), float(times[row]))
        assert body.axes(turning) == pytest.approx(expected[row], abs=1e-6)
        assert body.below(turning) == pytest.approx(float(thing.below(expected[row])), abs=1e-5)


def test_a_ball_has_no_axis() -> None:
    world = World(make_cell(), 0.0, truth_of(make_cell()))
    world.release(1, 0.0, (0.5, 0.0, 0.8, 1.0, 0.0, 1.0), 0.0)
    for cycle in range(1000):
        world.cycle((cycle + 1) * DT, DT)
    assert "axis" not in world.landings[0]
    assert "axis" not in world.observations[0]


def test_a_rod_touches_with_its_end() -> None:
    wall = {"name": "wall", "lower_m": [0.9, -1.0, 0.0], "upper_m": [1.0, 1.0, 3.0]}
    world = _thrown(_cell(wall), (0.0, 0.0, 1.5, 2.0, 0.0, 2.0), [0.0, 0.0, 0.0])
    landing = world.landings[0]
    thing = _cell().object
    assert landing["surface"] == "keep_out[0]"
    assert landing["position_m"][0] == pytest.approx(0.9 - thing.reach_m - thing.radius_m, abs=1e-3)


def test_drag_is_that_of_the_true_mass() -> None:
    cell = _cell()
    truth = replace(truth_of(cell), mass_kg=0.05, drag_coefficient=0.8)
    k = drag_constant(0.05, cell.object.drag_radius_m, 0.8)
    assert World(cell, 0.0, truth).drag == k
