"""One execution, from the claimed row to its result."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from executor import records
from executor import shared_memory as shm
from executor.grippers import GripperConnection, GripperUnavailable
from executor.lost_object import object_words, told_opening
from executor.preflight import (
    ExecutionRefused,
    gripper_is_open,
    open_grippers,
    output_level_warnings,
    prove_plan,
    readiness,
    verify_plan,
)
from executor.preparation import landing_of, prepare_job, with_approach
from executor.replacement import CannotJoin, Certifier, Motion, Question
from executor.robot import RobotSession, RobotState
from executor.stream_job import StreamJob
from executor.stream_process import SpareStream
from executor.streaming.state_checks import EMERGENCY_BITS, NORMAL, power_words, safety_words
from executor.supervision import StreamRun
from fling import tracing
from learning import CellKnowledge, knowledge_of
from planner.answer import aimed_problem
from planner.approach import Approach, find_approach, jog_advice, obstacle_words
from planner.certificate import Check, release_flight
from planner.controller_program import NoProgram
from planner.passages import passed_until
from planner.problem import ThrowProblem
from planner.stream_rows import lead_in_s
from planner.trajectory import Trajectory
from store import TICK_PASSED, ExecutionRow, ProfileRow, new_id

SAFETY_WAIT_S = 0.2  # [s] after a fault, for a state that is newer than the fault
MONITOR_WAIT_S = 1.0  # [s] longest wait for it: the machine may be busy, the link may be gone
POLL_S = 0.02  # [s] between two readings of that state
WITHOUT_LOSS = ("completed", "refused", "held")  # outcomes in which nobody asks where the object is
KEPT = ("refused", "held")  # of them those in which nothing lands
BRAKING = (shm.BRAKING, shm.STOPPING, shm.DONE)


@dataclass
class Execution:
    """One execution of a session: `prepare`, `start`, then `finish` once `run` has ended."""

    session: RobotSession
    row: ExecutionRow
    log: list[tuple[float, str]] = field(default_factory=list)
    run: StreamRun | None = None
    gripper: GripperConnection | None = None
    profile: ProfileRow | None = None
    motions: list[Motion] = field(default_factory=list)  # that of its plan, then those of plans that were to replace it
    span: tracing.TracedSpan = field(default_factory=tracing.TracedSpan)
    taken_at_s: float = field(default_factory=time.monotonic)  # as it was taken on [s, monotonic]

    def note(self, text: str) -> None:
        """Adds a line to the recording's log."""
        self.log.append((time.time(), text))

    def prepare(self, document: bytes) -> StreamJob:
        """Verifies the plan, checks the robot and finds an approach; returns the stream job.

        Raises:
            ExecutionRefused: with every reason.
        """
        cell = self.session.cell
        session = self.session
        with ThreadPoolExecutor(1) as pool:
            reading = pool.submit(session.kinematics_reader.read)  # up to 0.1 s, in which the plan is prepared
            job = self._job_of(document)
        reading.result()
        ready = readiness(session)
        state = session.monitor.fresh()
        refusals = [*ready.refusals, *([] if state is None else open_grippers(cell, state))]
        if refusals:
            raise ExecutionRefused("; ".join(refusals))
        for warning in ready.warnings:
            self.note(f"warning: {warning}")
        self.note(f"robot: {cell.robot.name}, serial number {ready.serial or 'not told'}")
        self._connect_gripper()
        state = session.monitor.fresh()
        if state is None:
            raise ExecutionRefused("the controller stopped sending its state")
        pace = session.settings.approach_pace
        approach, failures = self._approach(state, pace)
        self._check_start(self.motion, state, approach.duration_s)
        if not approach.is_straight and approach.trajectory is not None:
            duration_s = approach.trajectory.duration_s
            self.note(f"planned approach of {duration_s:.1f} s; a straight move: {obstacle_words(failures)}")
        for warning in output_level_warnings(self.problem, self.trajectory, state):
            self.note(f"warning: {warning}")
        try:
            return with_approach(job, approach, session.settings)
        except NoProgram as error:
            raise ExecutionRefused(str(error)) from error

    def _job_of(self, document: bytes) -> StreamJob:
        """Returns the stream job of a plan that is certified again, without its approach.

        Raises:
            ExecutionRefused: with the reason.
        """
        self.motions = [self._motion_of(document)]
        if not self.problem.starts_at_rest:
            raise ExecutionRefused("the plan starts in motion: it can only replace a running one")
        landing = landing_of(document, self.problem, self.trajectory, self.profile)
        how = (self.row.mode, self.row.dry_run, self.session.settings, landing)
        try:
            return prepare_job(self.problem, self.trajectory, None, *how)
        except NoProgram as error:
            raise ExecutionRefused(str(error)) from error

    def _check_wait(self, motion: Motion) -> None:
        """Checks a plan that is to replace the one whose start the arm waits for.

        Raises:
            CannotJoin: it starts too soon, or too late.
        """
        state = self.session.monitor.fresh()
        if state is None:
            raise CannotJoin("the controller stopped sending its state")
        try:
            self._check_start(motion, state, 0.0)
        except ExecutionRefused as refused:
            raise CannotJoin(str(refused)) from refused

    def _check_start(self, motion: Motion, state: RobotState, ready_in_s: float) -> None:
        """Refuses a plan that starts at an instant which the arm cannot reach, or has to wait for too long.

        The arm must be there by the first row's time: outputs may be due before the motion starts.
        While it waits, the arm keeps out of the path of the bin: `swept_s` before the landing.

        Args:
            motion: of the plan.
            state: of the robot.
            ready_in_s: time until the arm is at the plan's start [s].

        Raises:
            ExecutionRefused: by how much.
        """
        starts_at_s = motion.problem.starts_at_s
        if starts_at_s is None:
            return
        if self.row.mode == "script":
            raise ExecutionRefused("the plan starts at an instant: a program in the controller does not wait for it")
        left_s = starts_at_s - state.timestamp_s - (time.monotonic() - state.seen_at)
        lacks_s = ready_in_s - (left_s - lead_in_s(motion.problem, motion.trajectory))
        if lacks_s > 0.0:
            reason = (
                f"the arm is at the plan's start {lacks_s:.2f} s after it was to begin, and its target has moved on"
            )
            raise ExecutionRefused(f"too late: {reason}")
        flight = release_flight(motion.problem, motion.trajectory)
        flies_s = 0.0 if flight is None else flight.time_of_flight_s
        longest_s = motion.problem.swept_s[0] - motion.trajectory.release_time_s - flies_s
        if left_s > longest_s:
            raise ExecutionRefused(f"too early: the plan starts in {left_s:.1f} s, and waits for {longest_s:.1f} s")

    @property
    def motion(self) -> Motion:
        """What it makes; after a replacement, the whole of it."""
        return self.motions[0 if self.run is None else self.run.taken]

    @property
    def problem(self) -> ThrowProblem:
        """The problem of what it makes."""
        return self.motion.problem

    @property
    def trajectory(self) -> Trajectory:
        """What it makes."""
        return self.motion.trajectory

    @property
    def aim_shift(self) -> NDArray[np.float64]:
        """By how much the aim lies off the target (3,) [m]."""
        return self.motion.aim_shift

    def _motion_of(self, document: bytes) -> Motion:
        """Returns the motion of a plan, certified again, and proven where the settings say so.

        Raises:
            ExecutionRefused: it is not.
        """
        motion = Motion(*verify_plan(document, self.session.cell, self.profile))
        if self.session.settings.must_be_proven:
            prove_plan(document, self.session.cell, self.profile)
        return motion

    def replace(self, document: bytes, certifier: Certifier) -> float:
        """Goes on with a plan that begins on the running motion; returns when it begins, on this run's clock [s].

        Args:
            document: of the plan.
            certifier: joins it to the motion.

        Raises:
            CannotJoin: the running motion goes on untouched.
        """
        run = self.run
        waits = run is not None and run.state == shm.APPROACHING and self.problem.starts_at_s is not None
        if run is None or not (waits or run.state == shm.STREAMING):
            raise CannotJoin("the execution does not stream its plan: there is no motion to join")
        if self.row.mode == "script" or self.row.dry_run:
            what = "a dry run moves nothing" if self.row.dry_run else "in script mode the plan runs in the controller"
            raise CannotJoin(f"{what}: nothing can be replaced")
        question = Question(
            execution_id=self.row.id,
            document=document,
            cell=self.session.cell,
            profile=self.profile,
            running=self.motion.fresh(),
            job=run.job.packed(),
            present=run.present_row(),
            settings=self.session.settings,
            waits=waits,
        )
        found = certifier.ask(question)
        if waits:
            self._check_wait(found.motion)
        if not run.has_room(found.job):
            raise CannotJoin("the whole motion would be longer than what one execution records")
        self.motions.append(found.motion)
        begins_s = found.motion.joins_s or 0.0
        if not run.offer(found.job):
            why = {shm.STREAMING: f"{TICK_PASSED} while the plan was certified", shm.BRAKING: "the motion brakes"}
            late = why.get(run.state, "the motion has ended")
            if waits:
                raise CannotJoin(f"{TICK_PASSED} while the plan was certified: the execution does not wait any more")
            raise CannotJoin(f"{late}: it would have begun at {begins_s:.3f} s")
        if self.session.cell.link.kind == "sim":
            self._announce_again()
        return begins_s

    def _connect_gripper(self) -> None:
        """Connects to the gripper, and checks it; a run that lets go of nothing leaves it alone.

        Raises:
            ExecutionRefused: it does not answer, or is not ready.
        """
        link = self.session.cell.gripper.link
        if link is None or not self.problem.throws or self.row.dry_run:
            return
        try:
            self.gripper = GripperConnection(link, self.session.cell.link.host)
        except GripperUnavailable as error:
            raise ExecutionRefused(str(error)) from error

    def close(self) -> None:
        """Gives back what the run did not: it may have been refused."""
        if self.gripper is not None:
            self.gripper.close()

    def _known(self) -> CellKnowledge | None:
        """Returns what the plan's profile knows of the cell; None without one."""
        return None if self.profile is None else knowledge_of(orjson.loads(self.profile.document))

    def _approach(self, state: RobotState, pace: float) -> tuple[Approach, tuple[Check, ...]]:
        """Returns the approach, and the checks that a straight move fails.

        The tool may hold an object. If its gripper is open it is empty, as the plan before left it: then a way without
        the object's clearance will do.

        Raises:
            ExecutionRefused: there is none; with what is too close, and how to jog the arm.
        """
        cell = self.problem.cell_with_bin
        now = np.array(state.q)
        goal = self.trajectory.q[0]
        carried = True
        approach, failures = find_approach(cell, now, goal, pace)
        if approach is None and self._is_open(state):
            carried = False
            approach, failures = find_approach(cell, now, goal, pace, carried)
        if approach is not None:
            return approach, failures
        reason = f"no certified approach to the plan's start was found; a straight move: {obstacle_words(failures)}"
        raise ExecutionRefused("; ".join(filter(None, [reason, jog_advice(cell, now, carried)])))

    def _is_open(self, state: RobotState) -> bool:
        if self.gripper is not None:
            return self.gripper.driver.is_open() is True
        return gripper_is_open(self.session.cell, state)

    def start(self, job: StreamJob, spare: SpareStream) -> None:
        """Starts the run, by the process that waits; in a simulated cell the throw is announced before, with its bin.

        Raises:
            ExecutionRefused: the simulated controller refuses it.
        """
        if self.session.cell.link.kind == "sim":
            self._announce()
        settings = self.session.settings
        self.session.monitor.forget()
        self.run = StreamRun(job, spare, settings.keep_awake, self.gripper)
        self.run.start()

    def _announce(self) -> None:
        try:
            problem = aimed_problem(self.problem, -self.aim_shift)  # the bin stands at the target
            self.throw = records.expect_throw(self.session.cell.link.host, problem)
        except ValueError as error:
            raise ExecutionRefused(f"the simulated controller refuses the throw: {error}") from error

    def _announce_again(self) -> None:
        """Announces the throw of a plan that the run goes by already, whether or not its landing will be seen."""
        try:
            self._announce()
        except (ExecutionRefused, OSError) as error:
            self.throw = None
            self.note(f"the landing of the new throw is not seen: {error}")

    def abort(self) -> None:
        """Requests the brake, where anything runs."""
        if self.run is not None:
            self.run.abort()

    def states(self) -> list[str]:
        """Returns the public states entered so far, in order; an early end skips those that it came before."""
        run = self.run
        entered = ["preparing"]
        if run is None:
            return entered
        state = run.state
        row_count = run.row_count
        furthest = run.furthest  # read last: a stream notes that it was entered before it brakes
        if furthest < shm.APPROACHING:
            return entered
        entered.append("approaching")
        if furthest == shm.STREAMING:
            entered.append("streaming")
        last = passed_until(self.problem.passages, self.trajectory)[-1]
        last_s = last * self.trajectory.dt - run.job.first_clock_s
        if state in BRAKING or row_count > round(last_s / run.job.dt) + run.job.lag_ticks:
            entered.append("braking")
        return entered

    def finish(self) -> records.ExecutionResult:
        """Returns the result of the ended run; waits for the landing where that can be observed."""
        assert self.run is not None and self.run.result is not None
        ended = self.run.result
        if self.row.dry_run:
            never = (math.nan,) * len(ended.switched_s)
            ended = replace(ended, output_sent_s=None, switched_s=never)  # its time came, and nothing was switched
        outcome, reason = self._outcome(ended)
        telemetry = records.Telemetry(ended.rows)
        landing = None if outcome in KEPT else self._landing()
        timing = self._timing(telemetry)
        known = self._known() if self.row.mode == "speedj" else None
        numbers = records.metrics(self.problem, self.trajectory, ended, landing, timing, self.aim_shift, known)
        numbers["ready_s"] = None if ended.ready_at_s is None else ended.ready_at_s - self.taken_at_s
        if self.problem.parts:
            further = {} if outcome == "held" else self._further_landings()
            numbers["grippers"] = records.further_releases(self.problem, self.trajectory, ended, further)
        if self.row.dry_run:
            numbers = records.without_motion(numbers)
        if outcome == "completed" and not self.row.dry_run:
            verdict = records.release_verdict(self.problem, self.trajectory, numbers, landing, self.aim_shift)
            outcome, reason = verdict or (outcome, reason)
        if outcome not in WITHOUT_LOSS and not self.row.dry_run:
            reason = "; ".join(filter(None, [reason, self._object_words(ended)]))
        if outcome == "held":
            reason = "; ".join([reason, *records.timing_advice(self.problem, numbers)])
        self.note(f"{outcome}: {reason}" if reason else outcome)
        mcap = self._recording(telemetry, outcome)
        samples = records.to_samples(telemetry)
        observed = None if landing is None else landing.observed
        return records.ExecutionResult(
            self.row.id, outcome, reason, numbers, mcap, samples, self._observation(observed)
        )

    def _object_words(self, ended: records.RunResult) -> str:
        """Returns what became of the object in a run that was stopped; empty where the gripper stayed closed."""
        states = list(self.session.monitor.history)
        told = told_opening(self.problem.cell, ended)
        was_told = ended.output_sent_s is not None
        is_said = ended.stayed_closed and ended.outcome == "not_released"
        first = object_words(self.problem, self.trajectory, states, was_told, told, is_said)
        words = [first, *records.further_words(self.problem, self.trajectory, ended)]
        return "; ".join(filter(None, words))

    def _observation(self, observed: records.ObservedLanding | None) -> dict[str, Any] | None:
        """Returns the observation of the simulated camera, to be stored once."""
        if observed is None:
            return None
        position = observed.position.tolist()
        return {"id": new_id(), "at": time.time(), "position": position, "std_m": observed.std_m}

    def _timing(self, telemetry: records.Telemetry) -> dict[str, Any] | None:
        """Returns the timing of the arm that the run shows."""
        if self.row.dry_run or self.run is None:
            return None
        return records.arm_timing(self.problem.cell, telemetry, self.row.mode, self.run.job.acceleration)

    def _recording(self, telemetry: records.Telemetry, outcome: str) -> bytes:
        """Returns the run as MCAP."""
        row = self.row
        cell = self.session.cell
        age_s = time.monotonic() - telemetry.scalar("host_s")[0] if len(telemetry) else 0.0
        about = {"execution": row.id, "plan": row.plan_id, "cell": cell.name, "cell_sha256": cell.sha256}
        about |= {"outcome": outcome, "request_id": row.request_id or ""}
        return records.to_mcap(telemetry, cell.robot.joint_names, time.time() - age_s, self.log, about)

    def _outcome(self, ended: records.RunResult) -> tuple[str, str]:
        """Returns outcome and reason; after a fault a stop that the daemon has seen itself takes precedence.

        The streaming process may have died of what stopped the robot, or have seen the program stop before the reason.
        """
        if ended.in_order or ended.outcome in ("protective_stop", "emergency_stop", "refused"):
            return ended.outcome, ended.reason
        monitor = self.session.monitor
        began_at = time.monotonic()
        while monitor.stop_seen is None and not self._has_looked(began_at):
            time.sleep(POLL_S)
        stop = monitor.stop_seen
        if stop is None or (stop.safety_bits == NORMAL and ended.outcome == "power_off"):
            return ended.outcome, ended.reason
        if stop.safety_bits == NORMAL:
            return "power_off", f"{power_words(stop.robot_mode)}: {ended.reason}"
        kind = "emergency_stop" if stop.safety_bits & EMERGENCY_BITS else "protective_stop"
        return kind, f"{safety_words(stop.safety_bits)}: {ended.reason}"

    def _has_looked(self, began_at: float) -> bool:
        """Returns whether the monitor has seen the controller long enough after a fault; gives up without it."""
        waited_s = time.monotonic() - began_at
        state = self.session.monitor.state
        seen_s = 0.0 if state is None else state.seen_at - began_at
        return seen_s > SAFETY_WAIT_S or waited_s > MONITOR_WAIT_S

    def _further_landings(self) -> dict[str, records.Landing | None]:
        """Returns the observed landings of what other grippers let go than the first, by their names."""
        further = [part for part in self.problem.parts[1:] if part.problem.throws]
        return {part.problem.cell.mounted: self._landing_of(part.problem, part.of(self.trajectory)) for part in further}

    def _landing(self) -> records.Landing | None:
        """Returns the observed landing of the object that leaves first; None where the cell cannot observe one."""
        return self._landing_of(self.problem, self.trajectory)

    def _landing_of(self, problem: ThrowProblem, trajectory: Trajectory) -> records.Landing | None:
        if self.session.cell.link.kind != "sim" or self.row.dry_run or self.throw is None:
            return None
        flight = release_flight(problem, trajectory)
        duration = 0.0 if flight is None else flight.time_of_flight_s
        gripper = problem.cell.mounted
        try:
            return records.wait_for_landing(self.session.cell.link.host, self.throw, duration, gripper)
        except (OSError, ValueError):
            return None  # the simulator is gone
