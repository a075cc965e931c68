"""Where an object went in a run that was stopped, from the states that the controller published meanwhile.

The object leaves one delay of the gripper after its output has opened it, unless the output closes it before; or when
the input that shows it goes low while the gripper is closed. Then it flies on from the arm's state of that moment,
which is interpolated between the published ones.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from collections.abc import Sequence
from itertools import dropwhile, pairwise

import numpy as np
from numpy.typing import NDArray

from executor.preflight import REST_RAD_S, gripper_is_open
from executor.records import RunResult
from executor.robot import RATE_HZ, RobotState
from planner.cell import Cell
from planner.certificate import landing_height, release_flight
from planner.flight import fly
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

PERIOD_S = 1.0 / RATE_HZ  # [s] between two states: when an output changed is not known better
OUT_OF_SIGHT_S = 0.5  # [s] without a state the controller cannot be seen
DOUBT_STD = 3.0  # [-] standard deviations of the gripper's delay within which it is open whether the object left
UNSEEN = "the gripper was told to open and cannot be seen any more: the object may have left"

Opening = tuple[float, float | None]  # controller's times at which the gripper was opened, and closed again [s]


def object_words(
    problem: ThrowProblem,
    trajectory: Trajectory,
    states: Sequence[RobotState],
    was_told: bool,
    told: Opening | None = None,
    stayed_closed: bool = False,
) -> str:
    """Returns what became of the object, in words; empty where the gripper never opened.

    Args:
        problem, trajectory: of the plan.
        states: published since the run began, in order.
        was_told: whether the run told the gripper to open.
        told: when it did, for a gripper whose outputs do not show that; None: it is not known to have opened.
        stayed_closed: whether the run's reason says that it was seen not to open.
    """
    cell = problem.cell
    opening = _opening(cell, states) if cell.gripper.link is None else told
    if opening is None and (slipped := _slipped_at(cell, states)) is not None:
        return f"the object left the gripper {_landing(problem, trajectory, states, slipped)}"
    if opening is None:
        if not was_told:
            return ""
        if states and time.monotonic() - states[-1].seen_at < OUT_OF_SIGHT_S:
            why = "" if stayed_closed else "the gripper was told to open and stayed closed: "
            return f"{why}the object is held"
        return UNSEEN
    opened, closed = opening
    left = opened + cell.gripper.delay_s
    doubt = DOUBT_STD * cell.gripper.jitter_s + PERIOD_S
    if closed is not None and closed < left - doubt:
        return f"the gripper was closed again {1e3 * (closed - opened):.0f} ms after it opened: the object is held"
    if not states or states[-1].timestamp_s < opened - OUT_OF_SIGHT_S:
        return UNSEEN
    word = "left" if closed is None or closed > left + doubt else "may have left"
    return f"the object {word} the gripper {_landing(problem, trajectory, states, left)}"


def _opening(cell: Cell, states: Sequence[RobotState]) -> Opening | None:
    """Returns when the output opened the gripper and when it closed it again, the longest time [s].

    None where it was never seen to open: a gripper that is open at first is empty. The second is None where it stayed
    open.
    """
    found: list[Opening] = []
    for before, after in pairwise(states):
        was_open = gripper_is_open(cell, before)
        is_open = gripper_is_open(cell, after)
        at = 0.5 * (before.timestamp_s + after.timestamp_s)
        if is_open and not was_open:
            found.append((at, None))
        elif was_open and not is_open and found:
            found[-1] = (found[-1][0], at)
    return max(found, key=lambda seen: math.inf if seen[1] is None else seen[1] - seen[0], default=None)


def _slipped_at(cell: Cell, states: Sequence[RobotState]) -> float | None:
    """Returns the controller's time at which the input that shows an object went low [s].

    None where the cell has none, or it did not. What it did before the arm moved was the gripper's closing.
    """
    number = cell.gripper.grip_input
    if number is None:
        return None
    moving = dropwhile(lambda state: max(map(abs, state.qd)) < REST_RAD_S, states)
    for before, after in pairwise(moving):
        if before.inputs >> number & 1 and not after.inputs >> number & 1:
            return 0.5 * (before.timestamp_s + after.timestamp_s)
    return None


def told_opening(cell: Cell, ended: RunResult) -> Opening | None:
    """Returns when outputs that were told the same would have changed; None where it was seen to stay closed."""
    if ended.output_sent_s is None or ended.stayed_closed:
        return None
    at_zero = ended.timestamp_at_zero + cell.timing.lag_s
    closed = ended.output_closed_s
    return at_zero + ended.output_sent_s, None if closed is None else at_zero + closed


def _landing(problem: ThrowProblem, trajectory: Trajectory, states: Sequence[RobotState], left: float) -> str:
    """Returns where an object lands that leaves at the controller's time `left` [s], in words."""
    q, qd = _state_at(states, left)
    tool = tool_state(problem.cell, q, qd)
    leaves = problem.release_speed_factor * tool.v_WT
    flight = fly(tool.p_WT, leaves, landing_height(problem, trajectory), problem.gravity, problem.drag)
    if flight is None:
        return "and does not come down where it was planned to land"
    x, y, z = flight.landing_point
    place = f"and lands about at ({x:.2f}, {y:.2f}, {z:.2f}) m"
    planned = release_flight(problem, trajectory)
    if planned is None:
        return place
    off = (flight.landing_point - planned.landing_point)[:2]
    return f"{place}, {np.linalg.norm(off):.2f} m from where it was planned"


def _state_at(states: Sequence[RobotState], t: float) -> tuple[Vector, Vector]:
    """Returns q and qd (6,) at the controller's time `t` [s], [rad, rad/s]; beyond the states those of the last."""
    times = [state.timestamp_s for state in states]
    i = bisect_right(times, t)
    if not 0 < i < len(states):
        nearest = states[min(i, len(states) - 1)]
        return np.array(nearest.q), np.array(nearest.qd)
    before = states[i - 1]
    after = states[i]
    share = (t - before.timestamp_s) / (after.timestamp_s - before.timestamp_s)
    q = (1.0 - share) * np.array(before.q) + share * np.array(after.q)
    qd = (1.0 - share) * np.array(before.qd) + share * np.array(after.qd)
    return q, qd
