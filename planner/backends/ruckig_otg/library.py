"""Calls of the Ruckig library: state to state, and from a state to rest."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.cell import Limits
from planner.errors import BackendUnavailable, SolverFailed

Vector = NDArray[np.float64]
State = tuple[Vector, Vector, Vector]

TICKS_MAX = 20_000  # a phase longer than this is no throw


def library() -> ModuleType:
    """Returns the library.

    Raises:
        BackendUnavailable: ruckig is not installed.
    """
    try:
        import ruckig
    except ImportError as error:
        raise BackendUnavailable("ruckig", "ruckig") from error
    return ruckig


def reaching(start: State, end: State, limits: Limits, dt: float, on_ticks: bool) -> Any:
    """Returns Ruckig's trajectory in which all joints arrive together, lasting whole ticks of `dt` [s] if asked for."""
    ruckig = library()
    request = _input(ruckig, start, end, limits)
    if on_ticks:
        request.duration_discretization = ruckig.DurationDiscretization.Discrete
    return _calculate(ruckig, request, dt)


def resting(state: State, limits: Limits, dt: float) -> Any:
    """Returns Ruckig's trajectory in which all joints come to rest together, wherever, on a tick of `dt` [s]."""
    ruckig = library()
    request = _input(ruckig, state, (np.zeros(6), np.zeros(6), np.zeros(6)), limits)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    return _calculate(ruckig, request, dt)


def ticks(motion: Any, dt: float) -> int:
    """Returns how many ticks of `dt` [s] a trajectory takes, three at least.

    Raises:
        SolverFailed: more than `TICKS_MAX`.
    """
    count = max(3, round(motion.duration / dt))
    if count > TICKS_MAX:
        raise SolverFailed(f"the motion would take {motion.duration:.1f} s")
    return count


def accelerations(motion: Any, count: int, dt: float) -> Vector:
    """Returns the accelerations (count + 1, n) of a trajectory at its ticks."""
    return np.array([motion.at_time(i * dt)[2] for i in range(count + 1)])


def _input(ruckig: ModuleType, start: State, end: State, limits: Limits) -> Any:
    request = ruckig.InputParameter(len(start[0]))
    request.current_position, request.current_velocity, request.current_acceleration = (x.tolist() for x in start)
    request.target_position, request.target_velocity, request.target_acceleration = (x.tolist() for x in end)
    # A release at the very limit is allowed: only the way there keeps the room that the grid needs.
    request.max_velocity = np.maximum(limits.qd_max, np.abs(end[1])).tolist()
    request.max_acceleration, request.max_jerk = limits.qdd_max.tolist(), limits.jerk_max.tolist()
    return request


def _calculate(ruckig: ModuleType, request: Any, dt: float) -> Any:
    motion = ruckig.Trajectory(request.degrees_of_freedom)
    try:
        result = ruckig.Ruckig(request.degrees_of_freedom, dt).calculate(request, motion)
    except ruckig.RuckigError as error:
        raise SolverFailed(f"ruckig refuses the request: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise SolverFailed(f"ruckig answers {result}")
    return motion
