"""Metrics of a finished execution, and the verdict on its release."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.records.landing import Landing
from executor.records.outputs import output_warnings, switched_outputs
from executor.records.telemetry import RunResult, Telemetry
from executor.records.timing import path_error_m, tool_points
from learning import CellKnowledge, lag_advice
from planner.certificate import release_flight, window_landing_points
from planner.flight import fly
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

RELEASE_SHARE = 0.005  # [-] release error without a warning, share of the fastest planned joint speed; 1 %: 27 mm off
RELEASE_NOISE_RAD_S = 0.01  # [rad/s] scatter of a measured joint speed
RELEASE_NUMBERS = ("release_velocity_error_rad_s", "release_velocity_error_share", "release_velocity_unexpected_rad_s")
OF_MOTION = ("timing", "tracking_error_max_rad", "tracking_error_max_m", "path_error_max_m", *RELEASE_NUMBERS)
EXPECTED_STD = 3.0  # [-] standard deviations of a joint's speed that are no surprise: 3 in 1,000 joints by chance
LANDING_FAR_M = 0.05  # [m] landing error without a warning where no tolerance is larger: a bin is missed
LANDING_SHIFT_M = 0.005  # [m] accepted shift of the landing by a late gripper command: `late` in docs/executor.md


def metrics(
    problem: ThrowProblem,
    trajectory: Trajectory,
    result: RunResult,
    landing: Landing | None,
    timing: dict[str, Any] | None = None,
    aim_shift: Vector | None = None,
    known: CellKnowledge | None = None,
) -> dict[str, Any]:
    """Returns the metrics; None where this run or this cell has no value.

    Args:
        problem: of the plan, with its target moved to the aim.
        trajectory: of the plan.
        result: end of the run.
        landing: as it was observed.
        timing: of `arm_timing`.
        aim_shift: by how much the plan's aim lies off its target (3,) [m]; None: it does not.
        known: of the cell, as the plan's profile says, where joints were streamed by speed; None: nothing.
    """
    telemetry = Telemetry(result.rows)
    return {
        **_timing(telemetry, result),
        "timing": timing,
        **_tracking(problem, telemetry, timing),
        **_release(problem, trajectory, telemetry, known),
        **_gripper(trajectory, result, landing),
        "object_left": _object_left(problem, result, landing),
        **_grip(problem, result),
        "outputs": switched_outputs(problem, trajectory, result),
        **_landing(problem, trajectory, landing, np.zeros(3) if aim_shift is None else aim_shift),
    }


def without_motion(numbers: dict[str, Any]) -> dict[str, Any]:
    """Returns the metrics of a dry run: those of the motion are null, as the arm stood still."""
    return {**numbers, **dict.fromkeys(OF_MOTION)}


def release_verdict(
    problem: ThrowProblem,
    trajectory: Trajectory,
    numbers: dict[str, Any],
    landing: Landing | None,
    aim_shift: Vector | None = None,
) -> tuple[str, str] | None:
    """Returns outcome and reason of a fully streamed plan whose release was not as planned; None if it was.

    A late gripper command counts by its effect on the landing: next to nothing within a release window, 10 mm a
    millisecond in a fast throw. A speed that was off while the position kept to the plan endangers nothing: the object
    lands elsewhere, and the warning says by how much the speed differed, unless the plan's profile expects that: then
    the aim makes up for it. A landing that was seen far from the plan is a warning, whatever the arm did. Only a
    simulated cell can report that no object was seen to leave; the arm completed its motion then.
    """
    late = numbers["gripper_command_late_s"] or 0.0
    shift = _landing_shift(problem, trajectory, late)
    most = max(problem.landing_tolerance_m if problem.is_robust else 0.0, LANDING_SHIFT_M)
    if shift > most:
        moved = "" if math.isinf(shift) else f": the landing moves by {1e3 * shift:.0f} mm"
        return "late", f"the gripper command was {1e3 * late:.0f} ms late{moved}"
    off = [*_speed_warning(numbers), *_landing_warning(problem, trajectory, landing, aim_shift)]
    if numbers["released"] and landing is None and problem.cell.link.kind == "sim":
        return "completed", "the gripper was commanded to open, but no object left it"
    if warnings := [*off, *output_warnings(numbers["outputs"], problem), *timing_advice(problem, numbers)]:
        return "completed", f"warning: {'; '.join(warnings)}"
    return None


def _speed_warning(numbers: dict[str, Any]) -> list[str]:
    """Returns by how much a joint's speed was off at the release, where neither noise nor the profile explains it."""
    error = numbers["release_velocity_error_rad_s"] or 0.0
    unexpected = numbers["release_velocity_unexpected_rad_s"]
    share = numbers["release_velocity_error_share"] or 0.0
    counts = error if unexpected is None else unexpected
    if not error > 0.0 or counts <= RELEASE_NOISE_RAD_S or share * counts / error <= RELEASE_SHARE:
        return []
    beyond = "" if unexpected is None else f", {unexpected:.3f} rad/s beyond what the profile expects"
    return [f"at the release a joint's speed was {share:.1%} ({error:.3f} rad/s) off the plan's{beyond}"]


def _landing_warning(
    problem: ThrowProblem, trajectory: Trajectory, landing: Landing | None, aim_shift: Vector | None
) -> list[str]:
    """Returns how far from the plan the object was seen to land, where that is beyond what was promised."""
    flight = release_flight(problem, trajectory)
    observed = None if landing is None else landing.observed
    if flight is None or observed is None:
        return []
    planned = flight.landing_point - (np.zeros(3) if aim_shift is None else aim_shift)
    off = float(np.linalg.norm(observed.position[:2] - planned[:2]))
    if off <= max(problem.landing_tolerance_m, LANDING_FAR_M) + EXPECTED_STD * observed.std_m:
        return []
    x, y, _ = observed.position
    on = f" on {landing.surface}" if landing is not None and landing.surface else ""
    return [f"the object landed {off:.2f} m from where it was planned, at ({x:.2f}, {y:.2f}) m{on}"]


def timing_advice(problem: ThrowProblem, numbers: dict[str, Any]) -> list[str]:
    """Returns the lag to set where the run shows another one than the cell file's."""
    timing = numbers["timing"]
    if timing is None or timing["lag_change_s"] is None:
        return []
    return [lag_advice(timing["lag_s"], timing["lag_std_s"], problem.cell.timing.lag_s)]


def _landing_shift(problem: ThrowProblem, trajectory: Trajectory, late_s: float) -> float:
    """Returns the shift of the landing by a release `late_s` later [m]; infinite where it then lands nowhere."""
    ticks = round(late_s * trajectory.sample_rate_hz)
    nominal = release_flight(problem, trajectory)
    if ticks <= 0 or nominal is None:
        return 0.0
    if problem.body is not None:
        late = window_landing_points(problem, trajectory, np.array([ticks / trajectory.sample_rate_hz]))[0]
        return float(np.nan_to_num(np.linalg.norm(late - nominal.landing_point), nan=math.inf))
    k = min(trajectory.release_index + ticks, len(trajectory.q) - 1)
    X_WT, V_WT = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    leaves = problem.release_speed_factor * V_WT[:3]
    flight = fly(X_WT[:3, 3], leaves, problem.plane_z, problem.gravity, problem.drag)
    return math.inf if flight is None else float(np.linalg.norm(flight.landing_point - nominal.landing_point))


def _timing(telemetry: Telemetry, result: RunResult) -> dict[str, Any]:
    periods = np.diff(telemetry.scalar("host_s"))
    p50, p99, most = map(float, np.percentile(periods, [50, 99, 100])) if len(periods) else (None, None, None)
    return {
        "ticks": len(telemetry),
        "missed_ticks": result.missed,
        "period_p50_s": p50,
        "period_p99_s": p99,
        "period_max_s": most,
        "realtime": result.realtime,
    }


def _tracking(problem: ThrowProblem, telemetry: Telemetry, timing: dict[str, Any] | None) -> dict[str, Any]:
    if not len(telemetry):
        return {"tracking_error_max_rad": None, "tracking_error_max_m": None, "path_error_max_m": None}
    cell = problem.cell
    planned = telemetry.vector("planned_q")
    measured = telemetry.vector("q")
    p_BT, p_BT_planned = (tool_points(cell, q) for q in (measured, planned))
    late_s = 0.0 if timing is None else timing["lag_s"] - cell.timing.lag_s
    return {
        "tracking_error_max_rad": float(np.abs(measured - planned).max()),
        "tracking_error_max_m": float(np.linalg.norm(p_BT - p_BT_planned, axis=1).max()),
        "path_error_max_m": path_error_m(cell, telemetry, p_BT, late_s),
    }


def _release(
    problem: ThrowProblem, trajectory: Trajectory, telemetry: Telemetry, known: CellKnowledge | None
) -> dict[str, Any]:
    """Returns the velocity error at the release; both speeds are interpolated alike, as they bend between rows.

    What is unexpected is a joint's error less what the profile expects of it and three standard deviations.
    """
    fastest = float(np.abs(trajectory.qd[trajectory.release_index]).max())
    planned, measured = (telemetry.at_clock(name, trajectory.release_time_s) for name in ("planned_qd", "qd"))
    if not problem.throws or measured is None or planned is None:
        return dict.fromkeys(RELEASE_NUMBERS)
    error = np.abs(measured - planned)
    unexpected = None
    if known is not None:
        _, expected = known.release_deviation(problem.cell, trajectory)
        room = EXPECTED_STD * known.speeds.std(trajectory.qd[trajectory.release_index])
        unexpected = float(np.maximum(np.abs(measured - planned - expected) - room, 0.0).max())
    return dict(zip(RELEASE_NUMBERS, (float(error.max()), float(error.max()) / fastest, unexpected), strict=True))


def _gripper(trajectory: Trajectory, result: RunResult, landing: Landing | None) -> dict[str, Any]:
    at = None if landing is None else landing.released_at
    opened = None if at is None else at - result.timestamp_at_zero
    sent = result.output_sent_s
    moved = [at - result.timestamp_at_zero for at in result.moved_between]
    return {
        "gripper_commanded_s": sent,
        "gripper_command_late_s": None if sent is None else result.output_late_s,
        "gripper_moved_s": moved if np.isfinite(moved).all() else None,
        "gripper_opened_s": opened,
        "gripper_opened_late_s": None if opened is None else opened - trajectory.release_time_s,
        "released": sent is not None,
    }


def _object_left(problem: ThrowProblem, result: RunResult, landing: Landing | None) -> bool | None:
    """Returns whether an object was seen to leave a gripper that was told to open; None where nobody can tell."""
    if result.output_sent_s is None or problem.cell.link.kind != "sim":
        return None
    if landing is None:
        return False
    is_told = landing.released_at is not None or landing.observed is not None  # a simulator may hide what left
    return True if is_told else None


def _grip(problem: ThrowProblem, result: RunResult) -> dict[str, Any]:
    """Returns what was seen of the grip before the motion, and what showed it; nothing where nobody can tell."""
    if result.grip_held is None:
        return {}
    by = "gripper" if problem.cell.gripper.grip_input is None else "input"
    return {"grip": {"held": result.grip_held, "by": by, "opened_again": result.opened_again}}


def _landing(
    problem: ThrowProblem, trajectory: Trajectory, landing: Landing | None, aim_shift: Vector
) -> dict[str, Any]:
    """Returns the true landing; null where the simulated controller hides it."""
    flight = release_flight(problem, trajectory)
    surface = None if landing is None else landing.surface
    if landing is None or landing.point is None or flight is None:
        return {"landing_point": None, "landing_error_m": None, "landed_on": surface}
    planned = flight.landing_point
    target = problem.moving
    if target is not None and landing.landed_at is not None:
        planned = planned + (landing.landed_at - target.at_s) * target.v_W
    error = float(np.linalg.norm(landing.point + aim_shift - planned))
    return {"landing_point": landing.point.tolist(), "landing_error_m": error, "landed_on": surface}
