"""The loop: one tick, one command. Whatever happens, the next command is a valid one or a stop."""

from __future__ import annotations

import math

from executor.board import (
    BRAKING,
    MISSED,
    OUTPUT_LATE_S,
    OUTPUT_SENT_S,
    PULSE,
    REALTIME,
    STATE,
    TIMESTAMP_AT_ZERO,
    Board,
)
from executor.job import Job, Row
from executor.streaming.clock import Clock, Lateness
from executor.streaming.fault import LinkFault
from executor.streaming.link import SERVO_CONSTANT_S, Link
from executor.streaming.orders import Orders
from executor.streaming.schedule import Schedule

WATCHDOG_SHARE = 0.5  # [-] of the watchdog's period: a gap this long, and a program that stopped, belong together
POSITION_LIMITS = [2.0 * math.pi] * 6  # [rad] source: UR joint range; the certificate has checked the cell's


class Stream:
    """One run of one job over a link that is connected and whose watchdog is armed."""

    def __init__(self, link: Link, job: Job, board: Board, orders: Orders, recorded: bool = True) -> None:
        """`recorded`: whether a row of telemetry is left each tick; the way to the start leaves none."""
        self.link, self.job, self.board, self.orders, self.recorded = link, job, board, orders, recorded
        self.schedule = Schedule(job)
        self.lateness = Lateness(job.dt, realtime=bool(board.words[REALTIME]))
        self.clock = Clock(link, job.dt)
        self.verdict = ("completed", "")
        self.output_sent = False
        board.words[TIMESTAMP_AT_ZERO] = self.clock.first - job.first_clock_s + job.lag_ticks * job.dt

    def run(self) -> tuple[str, str]:
        """Streams to the end of the schedule; returns outcome and reason.

        Raises:
            LinkFault: the link failed; nothing was sent after that.
        """
        while self.clock.tick <= self.schedule.last:
            self.clock.wait()
            self.link.read()
            self._check()
            row = self.clock.tick
            reference = self.schedule.reference(row)
            stop = self._must_stop(reference[0])
            if stop is not None:
                self._divert(row, stop)
            command = self._send(row, reference[0])
            self._tell_gripper(row)
            self._record(reference, command)
        return self.verdict

    def _check(self) -> None:
        """Judges the controller's state; a program that stopped while our commands stayed out is our lateness."""
        try:
            self.link.check()
        except LinkFault as fault:
            silent = max(self.clock.missed * self.job.dt, self.clock.host_s - self.link.sent_at)
            if fault.outcome == "aborted" and silent > WATCHDOG_SHARE / self.link.watchdog_hz:
                reason = f"no command for {silent * 1e3:.0f} ms: the controller's watchdog stopped the program"
                raise LinkFault("late", reason) from fault
            raise

    def _must_stop(self, reference_q: Row) -> tuple[str, str] | None:
        if self.schedule.diverted is not None:
            return None
        if self.lateness.too_late(self.clock.missed, self.link.delayed_s):
            return "late", f"{self.clock.total_missed} ticks missed, {self.clock.missed} in a row"
        error = max([abs(a - b) for a, b in zip(reference_q, self.link.q, strict=True)])
        if error > self.job.tracking_max and not self.job.dry_run:
            return "tracking", f"{error:.3f} rad from the plan"
        return self.orders.stop()

    def _divert(self, row: int, stop: tuple[str, str]) -> None:
        self.verdict = stop
        self.schedule.divert(row)
        self.board.words[STATE] = BRAKING
        if self.output_sent and row < self.job.release_row + self.job.lag_ticks:
            self.link.output(not self.job.output_level)  # not left yet: keep hold of the object

    def _send(self, row: int, reference_q: Row) -> Row:
        _, qd = self.schedule.command(row)
        if self.job.mode == "servoj":
            before, _ = self.schedule.command(max(row - 1, 0))  # where the arm is when the goal reaches it
            ahead = [x + SERVO_CONSTANT_S * v for x, v in zip(before, qd, strict=True)]
            self.link.servo(ahead, POSITION_LIMITS)
            return ahead
        most, gain = self.job.feedback_max, self.job.feedback_gain
        errors = [gain * (a - b) for a, b in zip(reference_q, self.link.q, strict=True)]
        back = [most if e > most else -most if e < -most else e for e in errors]
        limits = self.job.qd_max
        command = [v + b if -m <= v + b <= m else v for v, b, m in zip(qd, back, limits, strict=True)]
        self.link.speed(command)
        return command

    def _tell_gripper(self, row: int) -> None:
        job = self.job
        if self.output_sent or job.output_row < 0 or row < job.output_row or self.schedule.diverted is not None:
            return
        self.link.output(job.output_level)
        self.output_sent = True
        self.board.words[OUTPUT_SENT_S] = job.first_clock_s + (row - job.lag_ticks) * job.dt
        self.board.words[OUTPUT_LATE_S] = (row - job.output_row) * job.dt

    def _record(self, reference: tuple[Row, Row], command: Row) -> None:
        job, link, clock = self.job, self.link, self.clock
        self.board.words[PULSE] = clock.host_s
        if not self.recorded:
            return
        self.board.words[MISSED] = clock.total_missed
        self.board.add_row(
            [
                job.first_clock_s + (clock.tick - job.lag_ticks) * job.dt,
                link.stamp,
                clock.host_s,
                link.safety_bits,
                link.runtime_state,
                link.scaling,
                link.outputs,
                clock.missed,
                link.call_s,
                *reference[0],
                *reference[1],
                *command,
                *link.q,
                *link.qd,
                *link.current,
            ]
        )
