"""The control loop: one tick, one command. Whatever happens, the next command is a valid one or a stop.

The schedule gives the state to command at each tick: the plan's or, once diverted, the verified brake's.
"""

from __future__ import annotations

from executor import shared_memory as shm
from executor.stream_job import Row, StreamJob
from executor.streaming.clock import ControllerClock, LostTicks
from executor.streaming.command_watch import CommandWatch
from executor.streaming.gripper_watch import GripperWatch
from executor.streaming.landing_watch import LandingWatch
from executor.streaming.output_switches import OutputSwitches
from executor.streaming.rtde_connection import POSITION_LIMITS, SERVO_CONSTANT_S, RtdeConnection
from executor.streaming.state_checks import StopRequests, StreamFault
from planner.brake_profile import brake_weights

ARRIVED_RAD = 1e-3  # [rad] at the end of an approach: 1 mm at a reach of 1 m; an encoder resolves 1e-5
STANDS_RAD_S = 5e-3  # [rad/s] measured speed of an arm at rest, noise included
WATCHDOG_SHARE = 0.5  # [-] of the watchdog's period: it stopped a program that ends after a longer gap


class Schedule:
    """Rows by tick, before and after a diversion.

    Attributes:
        last: the row after which the arm is at rest.
        diverted: the row at which the brake starts; None on the plan.
    """

    def __init__(self, job: StreamJob) -> None:
        self.job = job
        self.last = len(job.q) - 1
        self.diverted: int | None = None
        self.brake_s = 0.0

    def go_by(self, job: StreamJob) -> None:
        """Goes by another job from now on, whose rows so far are this one's."""
        self.job = job
        self.last = len(job.q) - 1

    def divert(self, row: int) -> None:
        """Brakes from the first row at or after `row` whose brake is verified; only the first call counts."""
        if self.diverted is not None:
            return
        job = self.job
        start = job.brake_row[min(row, self.last)]
        self.diverted = start
        self.brake_s = job.brake_ticks[start] * job.dt
        self.last = start + job.brake_ticks[start] + int(job.lag_ticks) + 2

    def command(self, row: int) -> tuple[Row, Row]:
        """Returns q and qd (6,) to be reached one lag after row `row` is sent [rad, rad/s]."""
        row = min(row, self.last)
        if self.diverted is None or row <= self.diverted:
            return self.job.q[row], self.job.qd[row]
        return self._braking((row - self.diverted) * self.job.dt)

    def reference(self, row: int) -> tuple[Row, Row]:
        """Returns the expected measurement q and qd (6,) when row `row` is sent [rad, rad/s]."""
        if self.diverted is None or row - self.job.lag_ticks <= self.diverted:
            row = min(row, len(self.job.q) - 1)
            return self.job.reference_q[row], self.job.reference_qd[row]
        return self._braking((row - self.job.lag_ticks - self.diverted) * self.job.dt)

    def _braking(self, s: float) -> tuple[Row, Row]:
        """Returns q and qd (6,) at `s` [s] after the start of the brake."""
        start = self.diverted or 0
        T = self.brake_s
        q_per_qd, q_per_qdd, qd_per_qd, qd_per_qdd, _, _ = brake_weights(s / T if T > 0.0 else 1.0)
        q0 = self.job.q[start]
        qd0 = self.job.qd[start]
        qdd0 = self.job.qdd[start]
        q = [x + T * (q_per_qd * v + T * q_per_qdd * a) for x, v, a in zip(q0, qd0, qdd0, strict=True)]
        return q, [qd_per_qd * v + T * qd_per_qdd * a for v, a in zip(qd0, qdd0, strict=True)]


class Stream:
    """One run of one job, over a connection whose watchdog is armed."""

    def __init__(
        self,
        connection: RtdeConnection,
        job: StreamJob,
        requests: StopRequests,
        recorded: bool = True,
        settle_s: float = 0.0,
        first_s: float | None = None,
    ) -> None:
        """Starts the clock.

        Args:
            connection: with an armed watchdog.
            job: rows, and how they are streamed.
            requests: reasons to stop early.
            recorded: whether every tick writes a row of telemetry.
            settle_s: longest time after the last row in which the arm is drawn to it [s]; it ends on arrival.
            first_s: the controller's time at which row 0 is due [s]; None: now.
        """
        self.connection = connection
        self.job = job
        self.requests = requests
        self.recorded = recorded
        self.settle_ticks = round(settle_s / job.dt)
        self.fields = connection.memory.fields
        self.memory = connection.memory
        self.schedule = Schedule(job)
        self.lost_ticks = LostTicks(job.dt, realtime=bool(self.fields[shm.REALTIME]))
        self.clock = ControllerClock(connection, job.dt, first_s)
        self.verdict = ("completed", "")
        self.output_sent = False
        self.opened_at = -1  # row with which the gripper was told to open
        self.commands = CommandWatch()
        self.outputs = OutputSwitches(connection, job)
        self.gripper = self._gripper_watch()
        self.watch = None if job.landing is None or job.dry_run else LandingWatch(job, job.landing)
        self.decides_at = job.output_row  # row at which it is decided whether the object is kept
        self._note_first(self.clock.first)

    def run(self) -> tuple[str, str]:
        """Streams to the end of the schedule; returns outcome and reason.

        Raises:
            StreamFault: the connection failed; nothing was sent after that.
        """
        while self._goes_on():
            self.clock.wait()
            self.connection.read()
            self.commands.look(self.connection.target_qd, self.connection.stamp)
            self._check()
            row = self.clock.tick
            self._answer_offer(row)
            reference = self.schedule.reference(row)
            stop = self._stop(reference[0])
            if stop is not None:
                self._divert(row, stop)
            elif self.verdict[0] == "held" and row > self.job.release_row:
                self._divert(row, self.verdict)  # the plan's own brake is certified without the object
            self._watch_gripper(row)
            command = self._send(row, reference[0])
            self._open_gripper(row, command)
            self._switch_outputs(row)
            self._record(reference, command)
        return self.verdict

    def _answer_offer(self, row: int) -> None:
        """Goes by the job that the daemon offers, unless the motion brakes, or the row where the two part has passed.

        Up to that row both send the same. So it does not matter which tick takes it, and nothing is computed here.
        """
        fields = self.fields
        number = fields[shm.OFFERED]
        if number == fields[shm.ANSWERED] or not self.recorded:
            return
        if self.schedule.diverted is None and self.verdict[0] == "completed":
            job = StreamJob.unpacked(self.memory.offered())
            if row <= job.joins_row:
                self._go_by(job)
                fields[shm.TAKEN] = number
        fields[shm.ANSWERED] = number

    def _go_by(self, job: StreamJob) -> None:
        self.job = job
        self.schedule.go_by(job)
        self.outputs.go_by(job)
        self.decides_at = job.output_row
        if job.landing is None:
            self.watch = None
        elif self.watch is None:
            self.watch = LandingWatch(job, job.landing)
        else:
            self.watch.go_by(job, job.landing)

    def _note_first(self, first_s: float) -> None:
        """Notes the controller's time of row 0 [s]."""
        job = self.job
        self.fields[shm.TIMESTAMP_AT_ZERO] = first_s - job.first_clock_s + job.lag_ticks * job.dt

    def _goes_on(self) -> bool:
        return self.clock.tick <= self.schedule.last or self._settles()

    def _settles(self) -> bool:
        """Returns whether the last row is held, for an arm that has not arrived there yet."""
        if self.schedule.diverted is not None or self.clock.tick > self.schedule.last + self.settle_ticks:
            return False
        off = max([abs(a - b) for a, b in zip(self.job.q[-1], self.connection.q, strict=True)])
        return off > ARRIVED_RAD or max(map(abs, self.connection.qd)) > STANDS_RAD_S

    def _check(self) -> None:
        """Checks the controller's state; after a stop by its watchdog the outcome is `late`, or `link_lost`."""
        try:
            self.connection.check()
        except StreamFault as fault:
            silent = max(self.clock.missed * self.job.dt, self.clock.host_s - self.connection.sent_at)
            trips_s = WATCHDOG_SHARE / self.connection.watchdog_hz
            if fault.outcome == "aborted" and silent > trips_s:
                reason = f"no command for {silent * 1e3:.0f} ms: the controller's watchdog stopped the program"
                raise StreamFault("late", reason) from fault
            lost = self.commands.lost_s(self.connection.stamp)
            if fault.outcome == "aborted" and lost > trips_s:
                reason = f"commands were lost on the way for {lost * 1e3:.0f} ms: {fault.reason}"
                raise StreamFault("link_lost", reason) from fault
            raise

    def _stop(self, reference_q: Row) -> tuple[str, str] | None:
        """Returns outcome and reason of a stop that begins at this tick; None otherwise."""
        if self.schedule.diverted is not None:
            return None
        if self.lost_ticks.are_too_many(self.clock.missed, self.connection.delayed_s):
            lost = f"{self.clock.total_missed} ticks lost so far, {self.clock.missed} in a row just now"
            return "late", f"{lost}: {self.lost_ticks.cause}"
        error = max([abs(a - b) for a, b in zip(reference_q, self.connection.q, strict=True)])
        if error > self.job.tracking_max and not self.job.dry_run:
            lag_ms = 1e3 * self.job.lag_ticks * self.job.dt
            return "tracking", f"{error:.3f} rad from the plan of an arm that is {lag_ms:.0f} ms late (timing.lag_s)"
        return self.requests.pending()

    def _object_words(self, row: int) -> str:
        """Returns what becomes of the object in a brake from a row after the gripper's command.

        Outputs are as late as motions: what is told before the release row arrives before the object leaves, and a
        brake from later rows does not reach the release.
        """
        if row < self.job.release_row:
            return "the gripper was told to close before the object left"
        return "the object left as planned"

    def _brake(self, row: int, stop: tuple[str, str]) -> None:
        self.verdict = stop
        self.schedule.divert(row)
        self.outputs.stop(row)
        self.fields[shm.STATE] = shm.BRAKING

    def _divert(self, row: int, stop: tuple[str, str]) -> None:
        if stop[0] == "executor_lost" and self.output_sent:  # nobody else can tell
            stop = (stop[0], f"{stop[1]}; {self._object_words(row)}")
        self._brake(row, stop)
        if self.output_sent and row < self.job.release_row + self.job.lag_ticks:
            self._close_gripper()  # not released yet: keep hold of the object

    def _gripper_watch(self) -> GripperWatch | None:
        """Returns what watches the gripper; None where it holds nothing, or nothing moves."""
        throws = self.connection.job.output_row >= 0  # its approach too, which has no output row
        holds = throws or self.connection.gripper.is_open() is False
        if self.job.dry_run or not holds:
            return None
        return GripperWatch(self.job, held=self.fields[shm.GRIP] == shm.GRIP_HELD)

    def _watch_gripper(self, row: int) -> None:
        """Stops the motion where the gripper changed by itself, and closes it: the object may still be in it.

        Once the object has left in time there is nothing more to watch.
        """
        port = self.connection.gripper
        port.cycle(asks=not 0.0 <= (self.job.output_row - row) * self.job.dt <= port.quiet_s)
        if self.gripper is None:
            return
        reported = port.problem()
        found = reported or self.gripper.look(port.is_open(), self.connection.stamp, port.holds())
        if found is not None:
            self.fields[shm.STAYED_CLOSED] = reported is None and found[0] == "not_released"
            self._brake(row, found)
            self._close_gripper()
            self.gripper = None
        elif (
            self.gripper.is_open and row > self.job.release_row + self.job.lag_ticks and self.schedule.diverted is None
        ):
            self.gripper = None

    def _close_gripper(self) -> None:
        """Tells the gripper to close, whatever it was told before."""
        self.connection.gripper.tell(False)
        self.fields[shm.OUTPUT_CLOSED_S] = self.job.first_clock_s + (self.clock.tick - self.job.lag_ticks) * self.job.dt
        if self.gripper is not None:
            self.gripper.tell(False, self.connection.stamp)

    def _send(self, row: int, reference_q: Row) -> Row:
        """Sends the command of a row, and returns it."""
        _, qd = self.schedule.command(row)
        if self.job.mode == "servoj":
            before, _ = self.schedule.command(max(row - 1, 0))  # position of the arm when the goal arrives there
            ahead = [x + SERVO_CONSTANT_S * v for x, v in zip(before, qd, strict=True)]
            self.connection.servo(ahead, POSITION_LIMITS)
            return ahead
        most = self.job.feedback_max
        gain = self.job.feedback_gain
        errors = [gain * (a - b) for a, b in zip(reference_q, self.connection.q, strict=True)]
        feedback = [most if e > most else -most if e < -most else e for e in errors]
        limits = self.job.qd_max
        command = [min(max(v + b, -m), m) for v, b, m in zip(qd, feedback, limits, strict=True)]
        self.connection.speed(command)
        self.commands.sent(command)
        return command

    def _open_gripper(self, row: int, command: Row) -> None:
        """Tells the gripper to open at the tick of its row, or at the next one after lost ticks.

        Where the object would land beyond its tolerance the output is never sent: the arm flies on with it.
        """
        job = self.job
        if self.output_sent or job.output_row < 0 or self.schedule.diverted is not None:
            return
        if self._keeps(row, command) or row < job.output_row:
            return
        self._note_opening(row)  # before it is told: where this process ends between the two, the daemon closes it
        self.connection.gripper.tell(True)

    def _switch_outputs(self, row: int) -> None:
        """Switches what the plan switches with a row.

        An output of the gripper's kind waits for the next one where the gripper is told to open with this: a controller
        might take only the last of two packages of a kind in a cycle.
        """
        job = self.job
        told = [job.output, *([job.second.output] if job.second else [])]
        self.outputs.send(row, told if self.opened_at == row and job.link is None else ())

    def _note_opening(self, row: int) -> None:
        """Notes that the gripper was told to open with a row."""
        job = self.job
        if self.gripper is not None:
            self.gripper.tell(True, self.connection.stamp)
        self.output_sent = True
        self.opened_at = row
        self.fields[shm.OUTPUT_SENT_S] = job.first_clock_s + (row - job.lag_ticks) * job.dt
        self.fields[shm.OUTPUT_LATE_S] = (row - job.output_row) * job.dt

    def _keeps(self, row: int, command: Row) -> bool:
        """Returns whether the object is kept, which is decided once: at the tick that would let go of it."""
        watch = self.watch
        job = self.job
        if watch is None or self.verdict[0] == "held":
            return watch is not None
        feedback = [0.0] * 6  # servoj has none
        if job.mode == "speedj":
            feedback = [a - b for a, b in zip(command, self.schedule.command(row)[1], strict=True)]
        watch.add(row, (self.connection.q, self.connection.qd), feedback)
        if row < self.decides_at:
            return False
        reason = watch.reason(row)
        if reason:
            self.verdict = ("held", reason)
        return bool(reason)

    def _record(self, reference: tuple[Row, Row], command: Row) -> None:
        """Writes the pulse and one row of telemetry."""
        job = self.job
        connection = self.connection
        clock = self.clock
        self.fields[shm.PULSE] = clock.host_s
        if not self.recorded:
            return
        self.fields[shm.MISSED] = clock.total_missed
        self.memory.add_row(
            [
                job.first_clock_s + (clock.tick - job.lag_ticks) * job.dt,
                connection.stamp,
                clock.host_s,
                connection.safety_bits,
                connection.runtime_state,
                connection.scaling,
                connection.outputs,
                connection.inputs,
                clock.missed,
                connection.call_s,
                *reference[0],
                *reference[1],
                *command,
                *connection.q,
                *connection.qd,
                *connection.current,
            ]
        )
