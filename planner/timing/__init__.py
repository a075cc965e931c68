"""From velocities and accelerations to a trajectory on the tick grid: grid projection, smoothing, velocity profiles."""

from planner.timing.grid import RESERVES, fits, grid_limits, onto_grid
from planner.timing.smoothing import RawMotion, smooth
from planner.timing.velocity_profiles import (
    CubicGuess,
    CubicProfile,
    TrapezoidProfile,
    cubic_brake,
    linear_brake,
    shortest_cubic,
    shortest_ramp,
    shortest_trapezoid,
    shortest_triangle,
    whole_ticks,
)

__all__ = [
    "RESERVES",
    "CubicGuess",
    "CubicProfile",
    "RawMotion",
    "TrapezoidProfile",
    "cubic_brake",
    "fits",
    "grid_limits",
    "linear_brake",
    "onto_grid",
    "shortest_cubic",
    "shortest_ramp",
    "shortest_trapezoid",
    "shortest_triangle",
    "smooth",
    "whole_ticks",
]
