"""Answers of entries: read and checked for their shape, put on the controller's ticks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

DURATION_MAX_S = 60.0
ON_TICK_S = 1e-6  # [s] a release is on a tick within this


class BadAnswer(Exception):
    """An answer that cannot be read.

    Attributes:
        rule: "format" or "release_time".
        value, limit: The number that is wrong, and what it may be; 0 where it is no number.
    """

    def __init__(self, rule: str, text: str, value: float = 0.0, limit: float = 0.0) -> None:
        super().__init__(text)
        self.rule = rule
        self.value = value
        self.limit = limit


def motion_of(answer: dict[str, Any], rate: float) -> Trajectory:
    """Returns the motion of an answer on ticks.

    Between the given samples it is the cubic polynomial through their positions and velocities.

    Args:
        answer: With "positions", "velocities", "release_time_s" and perhaps "times_s".
        rate: Ticks per second.

    Raises:
        BadAnswer: It has not the right shape, or no release on a tick.
    """
    q, qd = (_samples(answer, key) for key in ("positions", "velocities"))
    if q.shape != qd.shape:
        raise BadAnswer("format", f"positions have {len(q)} samples, velocities {len(qd)}", len(qd), len(q))
    if answer.get("times_s") is not None:
        q, qd = _on_ticks(_times(answer["times_s"], len(q)), q, qd, rate)
    if len(q) - 1 > DURATION_MAX_S * rate:
        raise BadAnswer("format", "the motion is too long, in s", (len(q) - 1) / rate, DURATION_MAX_S)
    return Trajectory(rate, q, qd, np.zeros_like(q), _release_index(answer.get("release_time_s"), len(q), rate))


def _samples(answer: dict[str, Any], key: str) -> Vector:
    try:
        values = np.array(answer[key], dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise BadAnswer("format", f"{key} is not a list of samples of 6 numbers") from error
    if values.ndim != 2 or values.shape[1] != 6 or len(values) < 2:
        raise BadAnswer("format", f"{key} has the shape {values.shape}, not (N, 6) with N of 2 or more")
    if not np.isfinite(values).all():
        raise BadAnswer("format", f"{key} has a number that is not finite")
    return values


def _times(given: Any, count: int) -> Vector:
    try:
        t = np.array(given, dtype=float)
    except (ValueError, TypeError) as error:
        raise BadAnswer("format", "times_s is not a list of numbers") from error
    if t.shape != (count,) or not np.isfinite(t).all() or abs(t[0]) > ON_TICK_S or np.any(np.diff(t) <= 0.0):
        raise BadAnswer("format", f"times_s is not {count} ascending numbers from 0 on")
    if t[-1] > DURATION_MAX_S:
        raise BadAnswer("format", "the motion is too long, in s", float(t[-1]), DURATION_MAX_S)
    return t


def _on_ticks(t: Vector, q: Vector, qd: Vector, rate: float) -> tuple[Vector, Vector]:
    """Returns samples on ticks; after the last given sample the arm stays where it is."""
    spline = CubicHermiteSpline(t, q, qd)
    ticks = np.arange(math.ceil(t[-1] * rate - ON_TICK_S * rate) + 1) / rate
    inside = np.minimum(ticks, t[-1])
    velocity = spline(inside, 1)
    velocity[ticks > t[-1] + ON_TICK_S] = qd[-1]
    return spline(inside), velocity


def _release_index(given: Any, count: int, rate: float) -> int:
    if isinstance(given, bool) or not isinstance(given, int | float) or not math.isfinite(given):
        raise BadAnswer("format", "release_time_s is not a number")
    index = round(given * rate)
    if abs(given - index / rate) > ON_TICK_S:
        raise BadAnswer("release_time", "the release is not on a tick, in s", float(given), index / rate)
    if not 0 <= index < count:
        raise BadAnswer("release_time", "the release is not within the motion, in s", float(given), (count - 1) / rate)
    return index
