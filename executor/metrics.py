"""Metrics of a finished execution, as the contract lists them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.landing import Landing
from executor.supervision import RunResult
from executor.telemetry import Telemetry
from planner.certificate import release_flight
from planner.flight import fly
from planner.geometry import tool_state
from planner.kinematics import forward
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

RELEASE_SHARE = 0.005  # [-] of the plan's fastest joint speed by which a release may be off: issue 5; 1 % was 27 mm
RELEASE_NOISE_RAD_S = 0.01  # [rad/s] a measured joint speed scatters by less
LANDING_SHIFT_M = 0.005  # [m] by which a gripper told late may move the landing: issue 5


def metrics(
    problem: ThrowProblem, trajectory: Trajectory, result: RunResult, landing: Landing | None
) -> dict[str, Any]:
    """Returns the metrics; None stands for what this run or this cell cannot tell."""
    telemetry = Telemetry(result.rows)
    return {
        **_timing(telemetry, result),
        **_tracking(problem, telemetry),
        **_release(problem, trajectory, telemetry),
        **_gripper(problem, trajectory, result, landing),
        **_landing(problem, trajectory, landing),
    }


def judge_release(problem: ThrowProblem, trajectory: Trajectory, numbers: dict[str, Any]) -> tuple[str, str] | None:
    """Returns outcome and reason where a plan was streamed to its end, but the release was not as planned.

    That an object stayed in the gripper only a simulated cell can tell; the arm did as planned then.

    A gripper told late is judged by what that does to the landing: next to nothing within a release window, 10 mm a
    millisecond in a fast throw.
    """
    error, share, late = (
        numbers[name] or 0.0
        for name in ("release_velocity_error_rad_s", "release_velocity_error_share", "gripper_command_late_s")
    )
    shift, most = _landing_shift(problem, trajectory, late), max(problem.landing_tolerance_m, LANDING_SHIFT_M)
    if shift > most:
        moved = "" if math.isinf(shift) else f": the landing moves by {1e3 * shift:.0f} mm"
        return "late", f"the gripper was told {1e3 * late:.0f} ms late{moved}"
    if error > RELEASE_NOISE_RAD_S and share > RELEASE_SHARE:
        return "tracking", f"at the release a joint's speed was {share:.1%} ({error:.3f} rad/s) off the plan's"
    if numbers["released"] and numbers["gripper_opened_s"] is None and problem.cell.link.kind == "sim":
        return "completed", "the gripper was told to open, but nothing was seen to leave it"
    return None


def _landing_shift(problem: ThrowProblem, trajectory: Trajectory, late_s: float) -> float:
    """Returns by how much a release so much later moves the landing [m]; infinite where it then lands nowhere."""
    ticks = round(late_s * trajectory.sample_rate_hz)
    nominal = release_flight(problem, trajectory)
    if ticks <= 0 or nominal is None:
        return 0.0
    k = min(trajectory.release_index + ticks, len(trajectory.q) - 1)
    X_WT, V_WT = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    flight = fly(X_WT[:3, 3], V_WT[:3], problem.plane_z, problem.gravity, problem.drag)
    return math.inf if flight is None else float(np.linalg.norm(flight.landing_point - nominal.landing_point))


def _timing(telemetry: Telemetry, result: RunResult) -> dict[str, Any]:
    periods = np.diff(telemetry.scalar("host_s"))
    p50, p99, most = np.percentile(periods, [50, 99, 100]) if len(periods) else (None, None, None)
    return {"ticks": len(telemetry), "missed_ticks": result.missed, "period_p50_s": _number(p50),
            "period_p99_s": _number(p99), "period_max_s": _number(most), "realtime": result.realtime}  # fmt: skip


def _tracking(problem: ThrowProblem, telemetry: Telemetry) -> dict[str, Any]:
    if not len(telemetry):
        return {"tracking_error_max_rad": None, "tracking_error_max_m": None}
    cell = problem.cell
    planned, measured = telemetry.vector("planned_q"), telemetry.vector("q")
    p, p_planned = (forward(cell.robot, q, cell.tool.X_FT)[:, :3, 3] for q in (measured, planned))
    return {"tracking_error_max_rad": float(np.abs(measured - planned).max()),
            "tracking_error_max_m": float(np.linalg.norm(p - p_planned, axis=1).max())}  # fmt: skip


def _release(problem: ThrowProblem, trajectory: Trajectory, telemetry: Telemetry) -> dict[str, Any]:
    """The error is what is looked up between two rows, not the speed: that bends between them."""
    fastest = float(np.abs(trajectory.qd[trajectory.release_index]).max())
    planned, measured = (telemetry.at_clock(name, trajectory.release_time_s) for name in ("planned_qd", "qd"))
    if problem.ends_at_rest or measured is None or planned is None:
        return {"release_velocity_error_rad_s": None, "release_velocity_error_share": None}
    error = float(np.abs(measured - planned).max())
    return {"release_velocity_error_rad_s": error, "release_velocity_error_share": error / fastest}


def _gripper(
    problem: ThrowProblem, trajectory: Trajectory, result: RunResult, landing: Landing | None
) -> dict[str, Any]:
    opened = None if landing is None else landing.released_at - result.timestamp_at_zero
    late = None if opened is None else opened - trajectory.release_time_s
    told = result.output_sent_s
    return {"gripper_commanded_s": told, "gripper_command_late_s": None if told is None else result.output_late_s,
            "gripper_opened_s": opened, "gripper_opened_late_s": late, "released": told is not None}  # fmt: skip


def _landing(problem: ThrowProblem, trajectory: Trajectory, landing: Landing | None) -> dict[str, Any]:
    flight = release_flight(problem, trajectory)
    if landing is None or landing.point is None or flight is None:
        return {"landing_point": None, "landing_error_m": None}
    error = float(np.linalg.norm(landing.point - flight.landing_point))
    return {"landing_point": landing.point.tolist(), "landing_error_m": error}


def _number(value: Any) -> float | None:
    return None if value is None else float(value)
