"""From a certified plan to a stream job: rows on the controller's ticks, a brake for each of them, and the approach."""

from __future__ import annotations

import secrets
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from executor import realtime
from executor.settings import ExecutorSettings
from executor.stream_job import ExpectedLanding, JobRows, StreamJob
from learning import FEEDBACK_GAIN, FEEDBACK_MAX, CellKnowledge, knowledge_of
from planner.answer import promised_tolerance
from planner.approach import Approach, Brakes, find_brakes
from planner.certificate import landing_height, window_landing_points
from planner.controller_program import NUMBERS, Watch
from planner.flight import landing_points
from planner.geometry import tool_state
from planner.passages import output_edges
from planner.problem import ThrowProblem
from planner.stream_rows import StreamRows, controller_program, sample_rows
from planner.trajectory import Trajectory
from store import ProfileRow

Vector = NDArray[np.float64]

TRACKING_MAX_RAD = 0.05  # [rad] 20 times the error of a gap of 10 ms at 15 rad/s^2
LATENESS_MAX_S = 0.1
LATENESS_STEP_S = 0.002  # [s] of the table of landings of an arm that is late, or early
DIFFERENCE = 1e-5  # [rad, rad/s] step of the central differences of the landing
NOWHERE_M = 1e3  # [m] shift where the object never lands
LATE_STD = 3.0  # [-] standard deviations by which a gripper may open late: 99.7 % of normal delays
REPORT_S = 0.05  # [s] more until it says so: within 20 ms fingers move by a step of what they report
SILENT_S = 0.100  # [s] the daemon's pulse comes every 5 ms; this long without one it is frozen or dead
SILENT_ORDINARY_S = 0.250  # [s] without real-time scheduling gaps of 20 to 100 ms were measured on a busy machine
RUNS = 2**28  # [-] numbers that tell one run in the controller from another


class RunningRows(NamedTuple):
    """A running job that another one goes on from.

    Attributes:
        job: that is running.
        present: row that has been sent; what is before it need not be braked any more.
    """

    job: StreamJob
    present: int


def prepare_job(
    problem: ThrowProblem,
    trajectory: Trajectory,
    approach: Approach | None,
    mode: str,
    dry_run: bool,
    settings: ExecutorSettings,
    landing: ExpectedLanding | None = None,
    running: RunningRows | None = None,
) -> StreamJob:
    """Returns the stream job of a certified plan and an approach to its start.

    Args:
        problem, trajectory: of the plan.
        approach: to its start; None where the arm is on its way already, or it is not known yet.
        mode: "speedj", "servoj" or "script".
        dry_run: connect and record without any motion.
        settings: of the executor.
        landing: where the object is to land; None: it is let go wherever it lands.
        running: what this job goes on from; None: it is a run of its own.

    Raises:
        NoProgram: a program of the controller cannot make the motion.
    """
    cell = problem.cell
    gripper = cell.gripper
    dt = 1.0 / cell.robot.sample_rate_hz
    dead_man_s = _dead_man_s(settings, mode, dry_run)
    edges = output_edges(cell, problem.passages, trajectory)
    rows = sample_rows(cell, trajectory, problem.throws, edges, running and running.job.first_clock_s)
    return StreamJob(
        host=cell.link.host,
        mode=mode,
        dry_run=dry_run,
        dt=dt,
        lag_ticks=cell.timing.lag_s / dt,
        dead_man_s=settings.dead_man_s,
        **vars(_job_rows(problem, trajectory, rows, dead_man_s, running=running)),
        release_row=rows.release_row,
        output_row=rows.output_row,
        output=gripper.output,
        output_index=gripper.index,
        output_level=gripper.open_level,
        second=gripper.second,
        switches=list(rows.switches),
        link=gripper.link,
        close_s=gripper.close_s,
        grip_input=gripper.grip_input,
        opens_in_s=0.0 if gripper.link is None else gripper.delay_s + LATE_STD * gripper.jitter_s + REPORT_S,
        landing=landing if problem.throws else None,
        starts_at_s=problem.starts_at_s,
        approach=None if approach is None else _approach_rows(approach, dead_man_s),
        qd_max=cell.robot.qd_max.tolist(),
        acceleration=float(np.min(cell.robot.qdd_max)),
        feedback_gain=FEEDBACK_GAIN,
        feedback_max=FEEDBACK_MAX,
        tracking_max=TRACKING_MAX_RAD,
        watchdog_hz=settings.watchdog_hz,
        core=settings.core,
        priority=realtime.STREAM_PRIORITY,
        daemon_silent_s=SILENT_S if realtime.is_permitted() else SILENT_ORDINARY_S,
    )


def with_approach(job: StreamJob, approach: Approach, settings: ExecutorSettings) -> StreamJob:
    """Returns a job with the approach to its start.

    Raises:
        NoProgram: a program of the controller cannot make the approach.
    """
    return replace(job, approach=_approach_rows(approach, _dead_man_s(settings, job.mode, job.dry_run)))


def _dead_man_s(settings: ExecutorSettings, mode: str, dry_run: bool) -> float | None:
    """Returns the time without a heartbeat after which a program stops the arm [s]; None where none runs."""
    return settings.dead_man_s if mode == "script" and not dry_run else None


def _approach_rows(approach: Approach, dead_man_s: float | None) -> JobRows | None:
    """Returns the rows of an approach; None where the arm is at the plan's start."""
    if approach.problem is None or approach.trajectory is None:
        return None
    sampled = sample_rows(approach.problem.cell, approach.trajectory, throws=False)
    return _job_rows(approach.problem, approach.trajectory, sampled, dead_man_s, is_approach=True)


def expected_landing(
    problem: ThrowProblem, trajectory: Trajectory, tolerance_m: float, known: CellKnowledge | None
) -> ExpectedLanding:
    """Returns where a throw is to land, for the streaming process to judge the arm by.

    Args:
        problem, trajectory: of the plan.
        tolerance_m: landing error beyond which the object is to be kept [m].
        known: of the cell, as its profile says: the aim makes up for that, so it is no reason to keep the object.
    """
    lateness = np.arange(-LATENESS_MAX_S, LATENESS_MAX_S + 0.5 * LATENESS_STEP_S, LATENESS_STEP_S)
    when = np.clip(trajectory.release_time_s - lateness, 0.0, trajectory.duration_s)
    points = window_landing_points(problem, trajectory, when - trajectory.release_time_s)[:, :2]
    k = trajectory.release_index
    q = trajectory.q[k]
    qd = trajectory.qd[k]
    height = landing_height(problem, trajectory)
    nominal = _landings(problem, q[None], qd[None], height)[0]
    by_q, by_qd = _landing_derivatives(problem, q, qd, height)
    shift = np.zeros(2)
    if known is not None:
        off_q, off_qd = known.release_deviation(problem.cell, trajectory)
        shift = by_q @ off_q + by_qd @ off_qd
    return ExpectedLanding(
        tolerance_m=tolerance_m,
        shift=shift.tolist(),
        late_from_s=-LATENESS_MAX_S,
        late_step_s=LATENESS_STEP_S,
        by_lateness=np.nan_to_num(points - nominal, nan=NOWHERE_M).tolist(),
        qd=qd.tolist(),
        by_q=by_q.tolist(),
        by_qd=by_qd.tolist(),
    )


def landing_of(
    document: bytes, problem: ThrowProblem, trajectory: Trajectory, profile: ProfileRow | None
) -> ExpectedLanding | None:
    """Returns where the object of a plan is to land, by what its profile knows; None where it promises no tolerance."""
    tolerance = promised_tolerance(orjson.loads(document), problem)
    if tolerance is None:
        return None
    known = None if profile is None else knowledge_of(orjson.loads(profile.document))
    return expected_landing(problem, trajectory, tolerance, known)


def _landing_derivatives(problem: ThrowProblem, q: Vector, qd: Vector, height: float) -> tuple[Vector, Vector]:
    """Returns the landing's derivatives (2, 6) by joint positions [m/rad] and joint velocities [m s/rad].

    At a height [m], which a little more or less turn of a body changes by less than a learnt flight scatters.
    """
    steps = DIFFERENCE * np.eye(6)
    n = np.zeros((6, 6))
    off_q = np.concatenate([steps, -steps, n, n])
    off_qd = np.concatenate([n, n, steps, -steps])
    points = np.nan_to_num(_landings(problem, q + off_q, qd + off_qd, height)).reshape(4, 6, 2)
    scale = 0.5 / DIFFERENCE
    return scale * (points[0] - points[1]).T, scale * (points[2] - points[3]).T


def _landings(problem: ThrowProblem, q: Vector, qd: Vector, height: float) -> Vector:
    """Returns where releases in joint states (n, 6) come down to a height [m] (n, 2) [m]; NaN where they never do."""
    state = tool_state(problem.cell, q, qd)
    leaves = problem.release_speed_factor * state.v_WT
    return landing_points(state.p_WT, leaves, height, problem.gravity, problem.drag)[:, :2]


def _job_rows(
    problem: ThrowProblem,
    trajectory: Trajectory,
    rows: StreamRows,
    dead_man_s: float | None,
    is_approach: bool = False,
    running: RunningRows | None = None,
) -> JobRows:
    """Returns the rows of a motion with the brake from each of them, as plain lists; and as a program with a dead-man.

    An approach is braked gently, and its program may leave rows out. Rows that a running job has sent keep its brakes.
    """
    sent = 0 if running is None else running.present
    motion = (rows.q[sent:], rows.qd[sent:], rows.qdd[sent:], trajectory.dt)
    brakes = find_brakes(problem.cell, *motion, problem.holds_object, is_approach)
    if running is not None:
        before = (np.array(x[:sent], np.int64) for x in (list(running.job.brake_row), list(running.job.brake_ticks)))
        row, ticks = (np.concatenate(pair) for pair in zip(before, (sent + brakes.row, brakes.ticks), strict=True))
        brakes = Brakes(row, ticks)
    run = NUMBERS * secrets.randbelow(RUNS)
    program = ""
    if dead_man_s is not None:
        compiled = controller_program(problem.cell, rows, brakes, thinned=is_approach)
        program = compiled.text(Watch(run=run, dead_man_s=dead_man_s))
    return JobRows(
        first_clock_s=rows.first_clock_s,
        q=rows.q.tolist(),
        qd=rows.qd.tolist(),
        qdd=rows.qdd.tolist(),
        reference_q=rows.reference_q.tolist(),
        reference_qd=rows.reference_qd.tolist(),
        brake_row=brakes.row.tolist(),
        brake_ticks=brakes.ticks.tolist(),
        run=run,
        program=program,
    )
