"""The stream job: everything the streaming process needs for one execution, computed and checked before any motion.

Rows lie on the controller's ticks. Row m is the state that should be measured one lag after it is sent.
"""

from __future__ import annotations

import json
import math
import os
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from planner.controller_program import SwitchRow
from planner.grippers import GripperLink, SecondOutput

Row = list[float]
COLUMNS = ("q", "qd", "qdd", "reference_q", "reference_qd")  # of six, in a packed job
WIDTH = 6 * len(COLUMNS) + 2  # numbers of a packed row; row and duration of its brake come last
HEAD = struct.Struct("=qq")  # of a packed job: bytes of its other fields, number of its rows
ALIGNED = 8  # [bytes]

APPROACH_LATE_S = 0.1  # [s] by which the arm may be late on an approach: it keeps to the path, and nothing is thrown

NOT_IN_MOTION = -(2**31)  # [rows] before all that a stream can be at

OUTCOMES = (
    "completed",
    "aborted",
    "refused",
    "protective_stop",
    "emergency_stop",
    "link_lost",
    "late",
    "tracking",
    "executor_lost",
    "foreign_program",
    "power_off",
    "held",
    "released_early",
    "not_released",
)


@dataclass(frozen=True, kw_only=True)
class ExpectedLanding:
    """Where a throw is to land, and how an arm that is off its plan moves that, about the release.

    Shifts are along x and y of the world, from where the plan lands.

    Attributes:
        tolerance_m: landing error beyond which the object is kept [m].
        shift: what is known of the arm already, so that the plan's aim makes up for it (2,) [m].
        late_from_s, late_step_s: first lateness of `by_lateness`, and from one to the next [s].
        by_lateness: shifts where the arm is late by so much (n, 2) [m]; 1 km where the object never lands.
        qd: planned joint speeds at the release (6,) [rad/s].
        by_q, by_qd: derivatives of the shift by that state (2, 6) [m/rad, m s/rad].
    """

    tolerance_m: float
    shift: Row
    late_from_s: float
    late_step_s: float
    by_lateness: list[Row]
    qd: Row
    by_q: list[Row]
    by_qd: list[Row]

    def shift_when_late(self, late_s: float) -> Row:
        """Returns the shift (2,) of an arm that is `late_s` late [s]; beyond the table that of its end."""
        last = len(self.by_lateness) - 1
        at = min(max((late_s - self.late_from_s) / self.late_step_s, 0.0), float(last))
        i = min(int(at), last - 1)
        share = at - i
        before = self.by_lateness[i]
        after = self.by_lateness[i + 1]
        return [(1.0 - share) * a + share * b for a, b in zip(before, after, strict=True)]


@dataclass(frozen=True, kw_only=True)
class JobRows:
    """Rows of one motion on the controller's ticks, and the brake from each of them.

    Attributes:
        first_clock_s: plan time of row 0 [s]; row m is at first_clock_s + m dt.
        q, qd, qdd: rows (M, 6) of the motion [rad, rad/s, rad/s^2].
        reference_q, reference_qd: rows (M, 6) one lag earlier: the expected measurement when row m is sent.
        brake_row: for every row the first row from which a verified brake starts.
        brake_ticks: for every row the duration of the brake from there [ticks].
        run, program: number and text of the program that makes the motion inside the controller; "" if it is streamed.
    """

    first_clock_s: float
    q: Sequence[Row]
    qd: Sequence[Row]
    qdd: Sequence[Row]
    reference_q: Sequence[Row]
    reference_qd: Sequence[Row]
    brake_row: Sequence[int]
    brake_ticks: Sequence[int]
    run: int
    program: str


PACKED = (*COLUMNS, "brake_row", "brake_ticks")


class _Packed:
    """A column of packed rows from its first number on."""

    def __init__(self, numbers: memoryview[float], first: int) -> None:
        self._numbers = numbers
        self._first = first
        self._count = len(numbers) // WIDTH

    def __len__(self) -> int:
        return self._count

    def _at(self, row: int) -> int:
        """Returns the place of a row's first number; negative rows count from the end."""
        if not -self._count <= row < self._count:
            raise IndexError(row)
        return row % self._count * WIDTH + self._first


class PackedRows(_Packed, Sequence[Row]):
    """Rows of six numbers."""

    def __getitem__(self, row: Any) -> Any:
        """Returns the numbers of a row."""
        at = self._at(row)
        return self._numbers[at : at + 6].tolist()


class PackedNumbers(_Packed, Sequence[int]):
    """A whole number of each row."""

    def __getitem__(self, row: Any) -> Any:
        """Returns the number of a row."""
        return int(self._numbers[self._at(row)])


@dataclass(frozen=True, kw_only=True)
class StreamJob(JobRows):
    """One execution: the rows of its plan, and how they are streamed.

    Attributes:
        host: address of the controller.
        mode: "speedj" or "servoj", which stream it, or "script".
        dry_run: connect and record without any motion.
        dt: duration of one tick [s].
        lag_ticks: lag of the cell [ticks], not necessarily whole.
        release_row: row nearest to the release; the object leaves within the next tick.
        output_row: row whose tick opens the gripper; -1: never.
        output: "tool_digital", "standard_digital" or "configurable_digital".
        output_index, output_level: index of that output, and the level that opens the gripper.
        second: an output that changes with it; None without one.
        switches: the outputs that are switched about the passages, in the order of their rows.
        link: how the gripper is reached where no output switches it; None: outputs do.
        gripper_fd: the streaming process's descriptor of the connection to it; -1: none, the run lets go of nothing.
        close_s: time that the gripper is given to close [s]; where it reports that it is closed, at most.
        grip_input: number of the digital input that is high while it holds an object; None without one.
        opens_in_s: longest time from one lag after the command until such a gripper reports that it opens [s].
        landing: where the object is to land; None: it is let go wherever it lands.
        approach: rows of the motion that leads to row 0; None: the arm stands there.
        qd_max: bounds of every command (6,) [rad/s].
        acceleration: acceleration argument of speedj [rad/s^2].
        feedback_gain, feedback_max: of the position feedback [1/s, rad/s].
        tracking_max: position error that ends the run [rad].
        watchdog_hz: lowest command rate accepted by the controller [Hz]; None: chosen by real-time permission.
        dead_man_s: time without a heartbeat after which a program in the controller stops the arm [s].
        core: processor of the stream; -1: any.
        priority: SCHED_FIFO priority.
        daemon_silent_s: longest accepted silence of the daemon [s].
        starts_at_s: when its plan starts, on the controller's clock [s]; None: when it is executed.
        joins_row: of a job that replaces another, the first row that is not the other's; `NOT_IN_MOTION` where it only
            replaces one that still waits for its start.
    """

    host: str
    mode: str
    dry_run: bool
    dt: float
    lag_ticks: float
    release_row: int
    output_row: int
    output: str
    output_index: int
    output_level: bool
    second: SecondOutput | None
    switches: list[SwitchRow]
    link: GripperLink | None
    close_s: float
    grip_input: int | None
    opens_in_s: float
    landing: ExpectedLanding | None
    approach: JobRows | None
    qd_max: Row
    acceleration: float
    feedback_gain: float
    feedback_max: float
    tracking_max: float
    watchdog_hz: float | None
    dead_man_s: float
    core: int
    priority: int
    daemon_silent_s: float
    starts_at_s: float | None = None
    joins_row: int = 0
    gripper_fd: int = -1

    def stop_levels(self, sent: int, reached: int = -1, row: float = math.inf) -> list[SwitchRow]:
        """Returns what a stop switches: the last level of each output that was switched, and may have another.

        A gripper that was told to open is told to close again where its object has not left.

        Args:
            sent: how many of the `switches` are known to have been made.
            reached: row up to which a program in the controller may have made more.
            row: with which the stop begins; infinite: there is none.
        """
        found = []
        for last in {each.line: each for each in self.switches}.values():
            own = [(number, each) for number, each in enumerate(self.switches) if each.line == last.line]
            made = [each for number, each in own if number < sent]
            doubtful = [each for number, each in own if number >= sent and each.row <= reached]
            if any(each.level != last.level for each in made[-1:] + doubtful):
                found.append(last)
            elif (made or doubtful) and row < last.held_until:
                found.append(replace(last, level=not last.level))
        return found

    def write(self) -> int:
        """Returns the descriptor of an anonymous file that holds the job."""
        fd = os.memfd_create("fling-stream-job")
        os.write(fd, json.dumps(vars(self), default=vars).encode())  # `asdict` would copy every row
        return fd

    @classmethod
    def read(cls, fd: int) -> StreamJob:
        """Returns the job behind an inherited descriptor."""
        return cls._of(json.loads(os.pread(fd, os.fstat(fd).st_size, 0)))

    def packed(self) -> bytes:
        """Returns the job with its rows as plain numbers: a process in real time reads it within a tick."""
        fields = {name: value for name, value in vars(self).items() if name not in PACKED}
        kept = {"landing": self.landing, "second": self.second, "link": self.link}
        fields |= {name: None if each is None else asdict(each) for name, each in kept.items()}
        fields |= {"approach": None, "switches": [asdict(each) for each in self.switches]}
        text = json.dumps(fields).encode()
        text += b" " * (-len(text) % ALIGNED)
        rows = zip(*(getattr(self, name) for name in PACKED), strict=True)
        numbers = [x for *vectors, row, ticks in rows for x in (*(y for each in vectors for y in each), row, ticks)]
        return HEAD.pack(len(text), len(self.q)) + text + struct.pack(f"={len(numbers)}d", *numbers)

    @classmethod
    def unpacked(cls, memory: memoryview) -> StreamJob:
        """Returns the job at the beginning of a memory, whose rows are read there when they are asked for."""
        size, count = HEAD.unpack_from(memory)
        begin = HEAD.size + size
        numbers = memory[begin : begin + 8 * WIDTH * count].cast("d")
        rows: dict[str, Any] = {name: PackedRows(numbers, 6 * i) for i, name in enumerate(COLUMNS)}
        rows["brake_row"] = PackedNumbers(numbers, WIDTH - 2)
        rows["brake_ticks"] = PackedNumbers(numbers, WIDTH - 1)
        return cls._of({**json.loads(bytes(memory[HEAD.size : begin])), **rows})

    @classmethod
    def _of(cls, fields: dict[str, Any]) -> StreamJob:
        """Returns the job of fields as JSON has them."""
        approach = fields.pop("approach")
        landing = fields.pop("landing")
        second = fields.pop("second")
        switches = fields.pop("switches")
        link = fields.pop("link")
        return cls(
            **fields,
            second=None if second is None else SecondOutput(**second),
            switches=[SwitchRow(**each) for each in switches],
            link=None if link is None else GripperLink(**link),
            approach=None if approach is None else JobRows(**approach),
            landing=None if landing is None else ExpectedLanding(**landing),
        )

    def approach_job(self) -> StreamJob:
        """Returns the job that streams the approach; it never opens the gripper.

        An arm whose lag the cell does not know gets there too: it is how such an arm comes home to be measured.
        """
        assert self.approach is not None
        rows = vars(self.approach)
        throws_nothing = {"output_row": -1, "release_row": len(self.approach.q) - 1, "landing": None, "switches": []}
        fastest = max(abs(v) for qd in self.approach.qd for v in qd)
        tracking_max = self.tracking_max + APPROACH_LATE_S * fastest
        mode = self.mode if self.mode == "script" else "speedj"
        return replace(self, **rows, **throws_nothing, tracking_max=tracking_max, mode=mode, approach=None)
