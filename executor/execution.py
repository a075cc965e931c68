"""One execution, from the claimed row to the kept result."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from executor import board as words
from executor.job import Approach, Job
from executor.journal import Result
from executor.landing import Landing, last_release, watch_landing
from executor.metrics import judge_release, metrics
from executor.preflight import Refused, judge_plan
from executor.preparation import Rows, approach_of, make_job, rows_of
from executor.recording import to_csv, to_mcap
from executor.station import Station
from executor.streaming.safety import EMERGENCY_BITS, NORMAL
from executor.supervision import Run, RunResult
from executor.telemetry import Telemetry
from planner.approach import Approach as PlannedApproach
from planner.approach import Brakes, find_approach, find_brakes
from planner.certificate import release_flight
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory
from store import ExecutionRow

APPROACH_BRAKE_EVERY = 5  # [rows] of a way at 1 rad/s: 1 cm further on at 500 Hz, a second less of preparation
TRUTH_AGE_S = 0.2  # [s] how long after a fault a state is waited for that is newer than it
STATES = {words.APPROACHING: "approaching", words.STREAMING: "streaming", words.BRAKING: "braking",
          words.STOPPING: "braking", words.DONE: "braking"}  # fmt: skip


@dataclass
class Execution:
    """One execution on a station. `prepare`, `start`, then `finish` once `run` has ended."""

    station: Station
    row: ExecutionRow
    log: list[tuple[float, str]] = field(default_factory=list)
    run: Run | None = None

    def note(self, text: str) -> None:
        """Remembers what happened, for the recording."""
        self.log.append((time.time(), text))

    def prepare(self, document: bytes) -> Job:
        """Judges plan, robot and way; returns the job.

        Raises:
            Refused: with every reason.
        """
        station, cell = self.station, self.station.cell
        self.problem, self.trajectory = judge_plan(document, cell)
        if reasons := station.refusals():
            raise Refused("; ".join(reasons))
        state = station.monitor.fresh()
        if state is None:
            raise Refused("the controller fell silent")
        way, hit = find_approach(cell, np.array(state.q), self.trajectory.q[0], station.settings.approach_pace)
        if way is None:
            raise Refused(f"no way to the plan's start keeps clear: {hit}")
        self.released_before = last_release(cell.link.host) if cell.link.kind == "sim" else -np.inf
        return self._job(way)

    def start(self, job: Job) -> None:
        """Starts the streaming process."""
        self.run = Run(job, self.station.cell.link.host, self.station.settings.data / "streaming.log")
        self.run.start()

    def state(self) -> str:
        """Returns the contract's word for what goes on."""
        run = self.run
        if run is None:
            return "preparing"
        if run.state == words.STREAMING and run.row_count > run.job.release_row + run.job.lag_ticks:
            return "braking"
        return STATES.get(run.state, "approaching" if run.state == words.CONNECTED else "preparing")

    def finish(self) -> Result:
        """Returns the result of the ended run; waits for the object to land where that can be seen."""
        run = self.run
        assert run is not None and run.result is not None
        ended = run.result
        outcome, reason = self._judge_end(ended)
        landing = self._landing(ended)
        numbers = metrics(self.problem, self.trajectory, ended, landing)
        if outcome == "completed" and not self.row.dry_run:
            outcome, reason = judge_release(self.problem, self.trajectory, numbers) or (outcome, reason)
        self.note(f"{outcome}: {reason}" if reason else outcome)
        telemetry = Telemetry(ended.rows)
        began = time.time() if not len(telemetry) else time.time() - (time.monotonic() - telemetry.scalar("host_s")[0])
        about = {"execution": self.row.id, "plan": self.row.plan_id, "cell": self.station.cell.name,
                 "cell_sha256": self.station.cell.sha256, "outcome": outcome}  # fmt: skip
        mcap = to_mcap(telemetry, self.station.cell.robot.joint_names, began, self.log, about)
        return Result(self.row.id, outcome, reason, numbers, mcap, to_csv(telemetry))

    def _job(self, way: PlannedApproach) -> Job:
        rows, ways_to_rest = self._sampled(self.problem, self.trajectory)
        cell, settings, approach = self.station.cell, self.station.settings, self._approach(way)
        return make_job(cell, rows, ways_to_rest, approach, self.row.mode, self.row.dry_run, settings)

    def _approach(self, way: PlannedApproach) -> Approach | None:
        if way.problem is None or way.trajectory is None:
            return None
        self.note(f"planned a way to the start, {way.trajectory.duration_s:.1f} s: a straight one would hit something")
        return approach_of(*self._sampled(way.problem, way.trajectory, APPROACH_BRAKE_EVERY))

    def _sampled(self, problem: ThrowProblem, trajectory: Trajectory, every: int = 1) -> tuple[Rows, Brakes]:
        """Returns a motion on the controller's ticks, and a way to rest from each of them."""
        cell = self.station.cell
        rows = rows_of(cell, trajectory, throws=not problem.ends_at_rest)
        return rows, find_brakes(cell, rows.q, rows.qd, rows.qdd, trajectory.dt, every)

    def _judge_end(self, ended: RunResult) -> tuple[str, str]:
        """Returns outcome and reason; where the link broke, what the controller itself says goes first."""
        if ended.in_order or ended.outcome in ("protective_stop", "emergency_stop", "refused"):
            return ended.outcome, ended.reason
        until = time.monotonic() + TRUTH_AGE_S
        while time.monotonic() < until:
            state = self.station.monitor.fresh()
            if state is not None and state.safety_bits != NORMAL:
                kind = "emergency_stop" if state.safety_bits & EMERGENCY_BITS else "protective_stop"
                return kind, f"the controller stopped: {ended.reason}"
            time.sleep(0.02)
        return ended.outcome, ended.reason

    def _landing(self, ended: RunResult) -> Landing | None:
        if self.station.cell.link.kind != "sim" or self.row.dry_run:
            return None
        flight = release_flight(self.problem, self.trajectory)
        duration = 0.0 if flight is None else flight.time_of_flight_s
        try:
            return watch_landing(self.station.cell.link.host, self.problem, self.released_before, duration)
        except (OSError, ValueError):
            return None  # the simulator is gone, as in a test of just that
