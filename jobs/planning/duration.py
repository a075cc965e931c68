"""The bound on a motion's duration: it bounds the time and the bytes of an answer, whatever limits a request gives."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.errors import FieldError, InvalidProblem
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

MOTION_MAX_S = 60.0  # [s] 10 MB of JSON at 500 Hz; throws take about one second
TRAVEL_RAD = 1.0  # [rad] a motion of one joint that must be possible in that time; most throws move one further
NAMES = ("velocity", "acceleration", "jerk")
UNITS = ("rad/s", "rad/s^2", "rad/s^3")


def check_limits(problem: ThrowProblem) -> None:
    """Checks before planning that no limit of the request alone makes the motion too long.

    A joint that travels d from rest to rest within v, a, j needs at least d/v, 2 sqrt(d/a) and cbrt(32 d/j); to a
    velocity, at least d/v, sqrt(2 d/a) and cbrt(6 d/j).

    Raises:
        InvalidProblem: One does; with the field, its value and the time that it costs.
    """
    travel = _least_travel(problem)
    bounds = (problem.limits.qd_max, problem.limits.qdd_max, problem.limits.jerk_max)
    orders = (lambda d, v: d / v, lambda d, a: np.sqrt(2.0 * d / a), lambda d, j: np.cbrt(6.0 * d / j))
    errors = []
    for name, unit, bound, least in zip(NAMES, UNITS, bounds, orders, strict=True):
        with np.errstate(over="ignore"):  # of a limit near 0 the time is infinite
            times = np.broadcast_to(least(travel, bound), (6,))
        joint = int(times.argmax())
        if times[joint] > MOTION_MAX_S:
            value = float(np.broadcast_to(bound, (6,))[joint])
            reason = (
                f"at {value:g} {unit} joint {joint + 1} needs at least {times[joint]:.3g} s for {travel[joint]:.3g} rad"
            )
            errors.append(FieldError(f"limits.{name}", f"{reason}; a motion may take {MOTION_MAX_S:g} s"))
    if errors:
        raise InvalidProblem(errors)


def check_duration(problem: ThrowProblem, trajectory: Trajectory) -> None:
    """Checks the duration of what was planned.

    Raises:
        InvalidProblem: It is too long to be answered.
    """
    if trajectory.duration_s > MOTION_MAX_S:
        reason = f"the motion would take {trajectory.duration_s:.0f} s; a motion may take {MOTION_MAX_S:g} s"
        raise InvalidProblem([FieldError("limits", f"{reason}: allow more velocity, acceleration or jerk")])


def _least_travel(problem: ThrowProblem) -> Array:
    """Returns how far each joint travels (6,) [rad]: known for a release in joints, else `TRAVEL_RAD`."""
    state = problem.release.joint_state
    if state is not None:
        return np.abs(state.q - problem.start)
    return np.full(6, TRAVEL_RAD)
