"""Calls of the Ruckig library: from state to state, and from a state to rest."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.cell import Limits
from planner.errors import BackendUnavailable, SolverFailed

Vector = NDArray[np.float64]
State = tuple[Vector, Vector, Vector]

TICKS_MIN = 3  # fewest ticks in which the grid projection can restore any end state
TICKS_MAX = 20_000  # longest phase: 40 s at 500 Hz, far beyond a throw


def ruckig_module() -> ModuleType:
    """Returns the imported library.

    Raises:
        BackendUnavailable: ruckig is not installed.
    """
    try:
        import ruckig
    except ImportError as error:
        raise BackendUnavailable("ruckig", "ruckig") from error
    return ruckig


def state_to_state(start: State, end: State, limits: Limits, dt: float, on_ticks: bool) -> Any:
    """Returns Ruckig's trajectory in which all joints arrive together.

    Args:
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (n,).
        end: the same quantities at the end.
        limits: on velocity, acceleration and jerk.
        dt: one tick [s].
        on_ticks: whether the duration is rounded up to whole ticks.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    ruckig = ruckig_module()
    request = _input(ruckig, start, end, limits)
    if on_ticks:
        request.duration_discretization = ruckig.DurationDiscretization.Discrete
    return _calculate(ruckig, request, dt)


def state_to_rest(state: State, limits: Limits, dt: float) -> Any:
    """Returns Ruckig's trajectory in which all joints come to rest together, anywhere, after whole ticks of `dt` [s].

    Raises:
        SolverFailed: Ruckig refuses the state.
        BackendUnavailable: ruckig is not installed.
    """
    ruckig = ruckig_module()
    request = _input(ruckig, state, (np.zeros(6), np.zeros(6), np.zeros(6)), limits)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    return _calculate(ruckig, request, dt)


def ticks(motion: Any, dt: float) -> int:
    """Returns the number of ticks of `dt` [s] that a trajectory takes, at least `TICKS_MIN`.

    Raises:
        SolverFailed: more than `TICKS_MAX`.
    """
    count = max(TICKS_MIN, round(motion.duration / dt))
    if count > TICKS_MAX:
        raise SolverFailed(f"the motion would take {motion.duration:.1f} s")
    return count


def accelerations(motion: Any, count: int, dt: float) -> Vector:
    """Returns the accelerations (count + 1, n) [rad/s^2] of a trajectory at its ticks."""
    return np.array([motion.at_time(i * dt)[2] for i in range(count + 1)])


def _input(ruckig: ModuleType, start: State, end: State, limits: Limits) -> Any:
    request = ruckig.InputParameter(len(start[0]))
    request.current_position, request.current_velocity, request.current_acceleration = (x.tolist() for x in start)
    request.target_position, request.target_velocity, request.target_acceleration = (x.tolist() for x in end)
    # A release exactly at the velocity limit is allowed; only the launch keeps the reserve for the tick grid.
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
