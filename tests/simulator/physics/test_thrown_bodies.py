"""Bodies in the simulated world: they turn free of torque, touch with their hull, and landings tell their axis."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Cell, cell_of_keys
from planner.flight import drag_constant
from planner.rotations import rotation_vector_to_matrix
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


def test_a_rod_lands_as_far_turned_as_the_flight_was_long() -> None:
    world = _thrown(_cell(), (0.5, 0.0, 0.8, 1.0, 0.0, 1.0), [0.0, 3.0, 0.0])
    landing = world.landings[0]
    angle = 3.0 * landing["t"]
    assert landing["axis"] == pytest.approx([np.cos(angle), 0.0, -np.sin(angle)], abs=1e-9)
    assert world.observations[0]["axis"] == landing["axis"]
    assert world.releases[0]["axis"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


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
