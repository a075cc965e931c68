"""A motion that runs inside the controller, watched from here: it is started, kept alive by a heartbeat, and stopped.

Nothing of it is streamed. The program publishes the row that it is at, so that each state is judged as in the loop that
streams: tracking, the gripper's output, where the object would land. What it is asked for is sent with every heartbeat:
a package that is lost delays it by one.
"""

from __future__ import annotations

import contextlib
import socket
from time import monotonic, sleep

from executor import shared_memory as shm
from executor.stream_job import Row, StreamJob
from executor.streaming.clock import Silence
from executor.streaming.loop import Stream
from executor.streaming.rtde_connection import ProgramState, RtdeConnection
from executor.streaming.state_checks import PLAYING, StopRequests, StreamFault
from executor.undelivered import discard_at_close
from planner import controller_program

SCRIPT_PORT = 30002  # source: Universal Robots, "Primary and secondary interfaces"
START_S = 5.0  # [s] for the controller to compile and start a program
WAITS_S = 1.0  # [s] without a new state, while nothing moves: a controller compiles a program meanwhile
BEAT_S = 0.004  # [s] from one heartbeat to the next: ten within the dead-man time
POLL_S = 2e-4  # [s] between two looks for a new state: it is watched, and nothing has to be sent at once
KEEP_AHEAD_S = 0.010  # [s] before the gripper's command at which it is decided: a request has to get there


class Upload:
    """A program on its way to the controller; the connection stays open until it runs."""

    def __init__(self, job: StreamJob) -> None:
        """Begins to connect; nothing here waits, since the daemon ends a process that is silent."""
        self._rest = job.program.encode()
        self._socket = socket.socket()
        discard_at_close(self._socket)
        self._socket.setblocking(False)
        self._socket.connect_ex((job.host, SCRIPT_PORT))

    def go_on(self) -> None:
        """Sends what goes out at once, and discards the states that the controller sends here.

        Raises:
            StreamFault: the connection failed.
        """
        try:
            if self._rest:
                self._rest = self._rest[self._socket.send(self._rest) :]
            while self._socket.recv(65536):
                pass
        except BlockingIOError:
            return
        except OSError as error:
            raise StreamFault("refused", f"sending the program: {error}") from error

    def close(self) -> None:
        """Closes the connection."""
        self._socket.close()


class ProgramClock:
    """Counts ticks by the rows that the program publishes; raises the heartbeat while it waits for a state.

    The state that shows a row shows what it commanded, as that of the next tick does where rows are streamed.

    Attributes:
        first, stamp: controller's time of row 0, and of the newest state [s].
        missed, total_missed: 0: no tick depends on this process.
        host_s: monotonic time at which the newest state was read [s].
        request: what the program is asked for, with every heartbeat.
        stale_s: longest accepted time without a new state [s].
        silent_s: longest time that this process did not send a heartbeat, since the program began [s].
    """

    missed = total_missed = 0

    def __init__(self, connection: RtdeConnection) -> None:
        self.connection = connection
        self.first = self.stamp = connection.timestamp()
        self.host_s = self._beaten_s = monotonic()
        self.request = 0
        self.stale_s = WAITS_S
        self.silent_s = 0.0
        self._beats = 0

    @property
    def program(self) -> ProgramState:
        """What the program published in the newest state."""
        assert self.connection.program is not None
        return self.connection.program

    @property
    def tick(self) -> int:
        """Tick of the newest state: one more than the row that it shows."""
        return self.program.row + 1

    def wait(self) -> None:
        """Returns at the next new state.

        Raises:
            StreamFault: none came in time.
        """
        silence = Silence(self.host_s, self.stale_s)
        while (stamp := self.connection.timestamp()) == self.stamp:
            self._beat(silence.polled)
            sleep(POLL_S)
            silence.look()
        self._beat(silence.polled)
        self.host_s = silence.polled
        self.stamp = stamp

    def _beat(self, now: float) -> None:
        """Raises the heartbeat where that is due at `now` [s]."""
        if now - self._beaten_s < BEAT_S:
            return
        self.silent_s = max(self.silent_s, now - self._beaten_s)
        self._beaten_s = now
        self._beats += 1
        self.connection.memory.fields[shm.PULSE] = now
        self.connection.beat(self._beats, self.request)


class ScriptStream(Stream):
    """One run of a motion inside the controller."""

    clock: ProgramClock

    def __init__(self, connection: RtdeConnection, job: StreamJob, requests: StopRequests, recorded: bool) -> None:
        """Uploads nothing yet; arguments as of `Stream`."""
        super().__init__(connection, job, requests, recorded)
        self.clock = ProgramClock(connection)
        self.decides_at = job.output_row - max(round(KEEP_AHEAD_S / job.dt), 1)
        self._row = -1
        self._row_at_s = 0.0  # controller's time at which the row was seen first
        self._recorded = -1

    @property
    def asked_to_brake(self) -> bool:
        """Whether the program is asked for its brake."""
        return self.clock.request == self.job.run + controller_program.BRAKE

    def run(self) -> tuple[str, str]:
        """Uploads and starts the program, and watches it to its end; see `Stream.run`.

        Raises:
            StreamFault: it did not start, or the connection failed.
        """
        early = self._start()
        if early is not None:
            return early
        self._check()  # the first state that shows a row may show the program's end, too
        self._switch_outputs(self.clock.tick)
        verdict = super().run()
        self.connection.plays = False  # it ends by itself, at rest
        self.connection.wait_for_rest()
        return verdict

    def _start(self) -> tuple[str, str] | None:
        """Starts the program; returns outcome and reason of a request that came before."""
        connection = self.connection
        with contextlib.closing(Upload(self.job)) as upload:
            end = monotonic() + START_S
            while not (connection.runtime_state == PLAYING and self.clock.program.run == self.job.run):
                upload.go_on()
                self._look()
                if (early := self.requests.pending()) is not None:
                    connection.beat(0, self.job.run + controller_program.BRAKE)  # it may start yet, and ends at once
                    return early
                if monotonic() > end:
                    raise StreamFault("refused", "the controller did not start the program that was sent to it")
        connection.plays = True
        self.clock.stale_s = self.job.dead_man_s
        self.clock.silent_s = 0.0
        self.clock.request = self.job.run + controller_program.GO
        # It may move by now: a request to stop is for the run, which waits for rest.
        while self.clock.program.row < 0 and not self.clock.program.end:
            self._read()
            if not self.clock.program.end:
                self.connection.check()
        self.clock.first = self.clock.stamp - self.clock.tick * self.job.dt
        self._note_first(self.clock.first)
        return None

    def _look(self) -> None:
        """Waits for a state, and checks it."""
        self._read()
        self.connection.check()

    def _read(self) -> None:
        """Waits for a state."""
        self.clock.wait()
        self.connection.read()

    def _ask(self, request: int) -> None:
        self.clock.request = self.job.run + request

    def _goes_on(self) -> bool:
        return not self.clock.program.end

    def _check(self) -> None:
        """Checks the controller's state and how the program is getting on, and takes over what it has done."""
        program = self.clock.program
        if program.end == controller_program.UNHEARD:
            raise self._unheard()
        if program.end == controller_program.OFF_COURSE:
            self.connection.plays = False
            self.connection.check()  # what slowed the controller down, or stopped it
            raise StreamFault("tracking", "the controller's target left the motion: its program stopped the arm")
        if not program.end:
            self.connection.check()
            self._check_advance(program.row)
        if program.brake_row >= 0 and self.schedule.diverted is None:
            self.schedule.divert(program.brake_row)
            self.fields[shm.STATE] = shm.BRAKING
            if not self.asked_to_brake:
                self.verdict = ("aborted", "the program on the controller was asked to brake by another client")
        if program.switched_row >= 0 and not self.output_sent:
            self._note_opening(program.switched_row)
            if self.verdict[0] == "held":  # the program heard it too late
                self.verdict = ("completed", "")

    def _check_advance(self, row: int) -> None:
        """Checks that the program goes from row to row.

        Raises:
            StreamFault: it stands still.
        """
        if row != self._row:
            self._row = row
            self._row_at_s = self.clock.stamp
        elif self.clock.stamp - self._row_at_s > self.job.dead_man_s:
            raise StreamFault("aborted", "the program on the controller stands still")

    def _unheard(self) -> StreamFault:
        limit_ms = 1e3 * self.job.dead_man_s
        silent = self.clock.silent_s
        if silent > 0.5 * self.job.dead_man_s:
            reason = f"no heartbeat for {1e3 * silent:.0f} ms: the program stopped the arm"
            return StreamFault("late", reason)
        return StreamFault("link_lost", f"no heartbeat arrived for {limit_ms:.0f} ms: the program stopped the arm")

    def _stop(self, reference_q: Row) -> tuple[str, str] | None:
        """Returns outcome and reason of a stop; no tick is lost here, and it is asked for once."""
        return None if self.asked_to_brake else super()._stop(reference_q)

    def _brake(self, row: int, stop: tuple[str, str]) -> None:
        """Asks for the brake; where it began, the program tells."""
        self.verdict = stop
        self._ask(controller_program.BRAKE)
        self.fields[shm.STATE] = shm.BRAKING

    def _send(self, row: int, reference_q: Row) -> Row:
        """Returns the speeds that the program commands next."""
        return self.schedule.command(row)[1]

    def _record(self, reference: tuple[Row, Row], command: Row) -> None:
        """Writes a row of telemetry where the program has gone on to another."""
        if self.clock.tick > self._recorded:
            self._recorded = self.clock.tick
            super()._record(reference, command)

    def _switch_outputs(self, row: int) -> None:
        """Notes what the program has switched: with the rows up to that which it shows, or from which it brakes."""
        program = self.clock.program
        self.outputs.note(program.row if program.brake_row < 0 else program.brake_row)
        if program.brake_row >= 0:
            self.outputs.note_stop(program.brake_row)

    def _open_gripper(self, row: int, command: Row) -> None:
        """Asks the program to keep an object that would miss; it opens the gripper itself."""
        waits = self.job.output_row >= 0 and not self.output_sent and self.verdict[0] == "completed"
        if waits and self._keeps(row, command):
            self._ask(controller_program.KEEP)


def stream_of(
    connection: RtdeConnection,
    job: StreamJob,
    requests: StopRequests,
    recorded: bool = True,
    settle_s: float = 0.0,
    first_s: float | None = None,
) -> Stream:
    """Returns the run of a job: streamed, or inside the controller. Arguments as of `Stream`."""
    if job.program:
        return ScriptStream(connection, job, requests, recorded)
    return Stream(connection, job, requests, recorded, settle_s, first_s)
