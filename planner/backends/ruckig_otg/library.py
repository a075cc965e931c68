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
ALL_JOINTS = slice(None)


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


def fastest_motion(
    start: State,
    end: State | None,
    limits: Limits,
    dt: float,
    joints: slice = ALL_JOINTS,
    on_ticks: bool = True,
    least_s: float = 0.0,
) -> Any:
    """Returns Ruckig's trajectory in which all joints arrive together.

    Args:
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (6,).
        end: the same quantities at the end; None for rest, anywhere.
        limits: on velocity, acceleration and jerk.
        dt: one tick [s].
        joints: those that move.
        on_ticks: whether the duration is rounded up to whole ticks.
        least_s: shortest duration [s].

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    ruckig = ruckig_module()
    current, target = ([x[joints].tolist() for x in state] for state in (start, end or 3 * (np.zeros(6),)))
    request = ruckig.InputParameter(len(current[0]))
    motion = ruckig.Trajectory(len(current[0]))
    request.current_position, request.current_velocity, request.current_acceleration = current
    request.target_position, request.target_velocity, request.target_acceleration = target
    # A release exactly at the velocity limit is allowed; only the launch keeps the reserve for the tick grid.
    request.max_velocity = np.maximum(limits.qd_max[joints], np.abs(target[1])).tolist()
    request.max_acceleration, request.max_jerk = limits.qdd_max[joints].tolist(), limits.jerk_max[joints].tolist()
    if end is None:
        request.control_interface = ruckig.ControlInterface.Velocity
    if least_s > 0.0:
        request.minimum_duration = least_s
    if on_ticks:
        request.duration_discretization = ruckig.DurationDiscretization.Discrete
    try:
        result = ruckig.Ruckig(len(current[0]), dt).calculate(request, motion)
    except ruckig.RuckigError as error:
        raise SolverFailed(f"ruckig refuses the request: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise SolverFailed(f"ruckig answers {result}")
    return motion


def accelerations(motion: Any, dt: float) -> Vector:
    """Returns the accelerations (N+1, n) [rad/s^2] of a trajectory at its ticks of `dt` [s], at least `TICKS_MIN`.

    Between the knots of its profiles a joint's acceleration is linear: one interpolation a joint instead of one call of
    the library a tick.

    Raises:
        SolverFailed: it takes more than `TICKS_MAX`.
    """
    count = max(TICKS_MIN, round(motion.duration / dt))
    if count > TICKS_MAX:
        raise SolverFailed(f"the motion would take {motion.duration:.1f} s, and may {dt * TICKS_MAX:g} s")
    (profiles,) = motion.profiles
    t = dt * np.arange(count + 1)
    return np.stack([np.interp(t, *_acceleration_knots(profile)) for profile in profiles], axis=1)


def _acceleration_knots(profile: Any) -> tuple[Vector, list[float]]:
    """Returns times (k,) [s] and accelerations [rad/s^2] of a joint's profile where its jerk changes.

    Seven phases of constant jerk, after up to two that bring the joint within its limits.
    """
    lengths = profile.t
    values = profile.a
    before = profile.brake
    if before.duration > 0.0:
        phases = [(length, a) for length, a in zip(before.t, before.a, strict=True) if length > 0.0]
        lengths = [length for length, _ in phases] + lengths
        values = [a for _, a in phases] + values
    return np.cumsum([0.0, *lengths]), values
