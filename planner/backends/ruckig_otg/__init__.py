"""Ruckig: jerk-limited, time-optimal joint motion from state to state, in microseconds.

Source: Berscheid and Kroeger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target States, RSS 2021.
"""

from planner.backends.ruckig_otg.arrival import arrival, joint_times, least_times
from planner.backends.ruckig_otg.library import TICKS_MIN, ruckig_module
from planner.backends.ruckig_otg.motions import (
    VARIANTS,
    LaunchVariant,
    initial_guess,
    least_leg_time,
    leg,
    solve,
)

__all__ = [
    "TICKS_MIN",
    "VARIANTS",
    "LaunchVariant",
    "arrival",
    "initial_guess",
    "joint_times",
    "least_leg_time",
    "least_times",
    "leg",
    "ruckig_module",
    "solve",
]
