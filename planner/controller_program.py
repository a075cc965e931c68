"""A certified motion as one URScript program, which runs inside the controller: nothing is streamed.

A row is one line: the joint speeds of a cycle, and how long the verified brake from there takes. The program sends a
row a cycle by speedj, switches outputs at their rows, and flies the brake of the present row where that is
asked for. It stops the arm at once where the controller's own target has left the motion: no brake is verified there. A
*watched* program begins when an RTDE client tells it to, and stops the arm, too, once that client has not raised its
heartbeat for the dead-man time; one for the pendant has no such client (docs/decisions/0029-script-mode.md).
`executor.streaming.script_stream` watches it.

Source of the functions: Universal Robots, "The URScript Programming Language". No numpy: the streaming process imports
this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from planner.brake_profile import RAMP, SLOPE
from planner.grippers import SET_OUTPUT

PROGRAM = "fling_motion"
# Integer registers that ur_rtde leaves to applications. source: ur_rtde 1.6.5, RTDEIOInterface and RTDEReceiveInterface
HEARTBEAT = 18
REQUEST = 19  # inputs
ROW = 12  # output: the newest row whose speeds were commanded
BRAKE_ROW = 13  # output: row from which the brake is flown; -1: none
SWITCHED_ROW = 14  # output: row at which the gripper was told to open; -1: not yet
END = 15  # output: one of the words below
RUN = 16  # output: the run's number, so that a program's outputs are not taken for those of the one before
RUNNING, FINISHED, BRAKED, UNHEARD, OFF_COURSE = range(5)
GO, KEEP, BRAKE = range(3)  # what is asked for, added to the run's number: any other number is a brake
NUMBERS = 4  # [-] from one run's number to the next

# UR publishes no limit of a program. source: ros-industrial/universal_robot, issue 411 (programs of fewer than 1,000
# targets run, of more do not); visose/Robots, issue 55 (fewer than some 2,500 on a UR5); zhangty019/S3_DeformFDM, issue
# 19 (18 MB crash it). A row is a statement as a target is, and no longer.
ROWS_MAX = 1000
STRIDE_MAX_S = 0.01  # [s] from one row of an approach to the next; a request for its brake waits for as long
PULL_PER_S = 5.0
PULL_MAX_RAD_S = 0.05  # [1/s, rad/s] feedback: as the streamed one, but from the controller's target: nothing lags
OFF_COURSE_RAD = 0.05  # [rad] of the controller's target from the motion: it was slowed down, or paused
OFF_SPEED_RAD_S = 0.1  # [rad/s] the same of its speed, beyond what a cycle may change
FINAL_STOP_RAD_S2 = 20.0  # [rad/s^2] of the final stopj, where only rounding is left to stop
AT_START_RAD = 0.01  # [rad] as an execution accepts it
BEGIN_S = 10.0  # [s] for which a watched program waits for its start


class NoProgram(ValueError):
    """A program of the controller cannot make the motion: it has too many rows, or another kind of gripper."""


@dataclass(frozen=True, kw_only=True)
class GripperEdge:
    """The output that opens the gripper.

    Attributes:
        output, index, open_level: as in the cell file.
        row: row with which it is switched; -1: it stays closed.
        closes_until: row before which a brake closes it again: the object has not left yet.
        close_s: time that it is given to close, on the pendant [s].
    """

    output: str
    index: int
    open_level: bool
    row: int
    closes_until: int
    close_s: float

    def text(self, opens: bool) -> str:
        """Returns the statement that switches it."""
        return f"{SET_OUTPUT[self.output]}({self.index}, {self.open_level == opens})"


@dataclass(frozen=True)
class SwitchRow:
    """A digital output that is switched with a row.

    Attributes:
        row: that it is switched with.
        output, index, level: kind and number of the output, and the level that it changes to.
        held_until: of a gripper's, row before which a stop switches it back, as the object has not left; else -1.
    """

    row: int
    output: str
    index: int
    level: bool
    held_until: int = -1

    @property
    def line(self) -> tuple[str, int]:
        """Which output it is: its kind and index."""
        return self.output, self.index

    @property
    def text(self) -> str:
        """The statement that switches it."""
        return f"{SET_OUTPUT[self.output]}({self.index}, {self.level})"


@dataclass(frozen=True, kw_only=True)
class Watch:
    """The RTDE client of a watched program.

    Attributes:
        run: number of the run, a multiple of `NUMBERS`.
        dead_man_s: time without a heartbeat after which the program stops the arm [s].
    """

    run: int
    dead_man_s: float


@dataclass(frozen=True, kw_only=True)
class ControllerProgram:
    """What a program does.

    Attributes:
        start: joint positions (6,) at its first row [rad].
        qd: rows (M, 6) of joint speeds, the last at rest [rad/s].
        brake_ticks: duration of the verified brake from each row [ticks]; -1 where it is not verified.
        dt: duration of one tick [s].
        stride: ticks from one row to the next.
        rest_ticks: ticks at rest after a brake, in which the measured motion comes to its end.
        acceleration: argument of speedj [rad/s^2].
        gripper: the output; row -1 where nothing is thrown.
        switches: further outputs, in the order of their rows; a stop gives those that were switched their last level.
    """

    start: Sequence[float]
    qd: Sequence[Sequence[float]]
    brake_ticks: Sequence[int]
    dt: float
    stride: int
    rest_ticks: int
    acceleration: float
    gripper: GripperEdge
    switches: Sequence[SwitchRow] = ()

    def __post_init__(self) -> None:
        if len(self.qd) > ROWS_MAX:
            seconds = (len(self.qd) - 1) * self.stride * self.dt
            raise NoProgram(
                f"{seconds:.1f} s of motion take {len(self.qd)} rows; a program holds {ROWS_MAX}: use speedj or servoj"
            )

    @property
    def off_speed(self) -> float:
        """Difference of the controller's target speed from the motion's at which the arm is stopped [rad/s]."""
        return OFF_SPEED_RAD_S + self.acceleration * self.dt  # the target that is read may be a cycle old

    def text(self, watch: Watch | None, header: Sequence[str] = ()) -> str:
        """Returns the program.

        Args:
            watch: its RTDE client; None: it is for the pendant.
            header: lines of comment that come first.
        """
        rows = [
            f"{self._switching(number)}  follow([{', '.join(f'{v:.6f}' for v in qd)}], {ticks})"
            for number, (qd, ticks) in enumerate(zip(self.qd, self.brake_ticks, strict=True))
        ]
        parts = [
            *(f"# {line}".rstrip() for line in header),
            f"def {PROGRAM}():",
            self._state(),
            self._give_up(watch),
            *([_LISTEN.format(**self._listening(watch))] if watch else []),
            self._step(watch),
            self._brake(watch),
            self._follow(watch),
            self._begin(watch),
            *rows,
            *([f"  write_output_integer_register({END}, {FINISHED})"] if watch else []),
            f"  stopj({FINAL_STOP_RAD_S2})",
            "end",
            *([] if watch else [f"{PROGRAM}()"]),
        ]
        return "\n".join(parts) + "\n"

    def _state(self) -> str:
        flags = "".join(f"\n  global {_flag(last)} = False" for last in self._ended_by_a_stop())
        return _STATE.format(before_first=-self.stride, start=_numbers(self.start)) + flags

    def _listening(self, watch: Watch) -> dict[str, object]:
        return {
            "heartbeat": HEARTBEAT,
            "cycles": max(round(watch.dead_man_s / (self.stride * self.dt)), 1),
            "unheard": UNHEARD,
            "request": REQUEST,
            "keep": watch.run + KEEP,
            "go": watch.run + GO,
        }

    def _switching(self, row: int) -> str:
        """Returns what switches the further outputs with a row."""
        lines = []
        for switch in self.switches:
            if switch.row == row:
                lines.append(f"    {switch.text}\n")
                lines += [
                    f"    {_flag(last)} = {switch.level != last.level}\n"
                    for last in self._ended_by_a_stop()
                    if last.line == switch.line
                ]
        return f"  if not braking:\n{''.join(lines)}  end\n" if lines else ""

    def _ended_by_a_stop(self) -> list[SwitchRow]:
        """Returns the last edge of each output that has several: a stop between them gives it that level."""
        last = {switch.line: switch for switch in self.switches}
        lines = [switch.line for switch in self.switches]
        return [switch for line, switch in last.items() if lines.count(line) > 1]

    def _closing(self, indent: str) -> str:
        """Returns what closes the gripper again while it holds the object, and ends the switching of outputs."""
        gripper = self.gripper
        lines = [f"if opened and row < {gripper.closes_until}:", f"  {gripper.text(False)}", "end"]
        for last in self._ended_by_a_stop():
            lines += [f"if {_flag(last)}:", f"  {last.text}", "end"]
        return "\n".join(indent + line for line in lines)

    def _give_up(self, watch: Watch | None) -> str:
        tell = f"    write_output_integer_register({END}, end_word)\n" if watch else ""
        return _GIVE_UP.format(close=self._closing("    "), tell=tell, deceleration=f"{self.acceleration:.3f}")

    def _step(self, watch: Watch | None) -> str:
        tell = f"    write_output_integer_register({ROW}, row)\n" if watch else ""
        numbers = {"gain": PULL_PER_S, "most": PULL_MAX_RAD_S, "half": 0.5 * self.dt}
        off = {"off": OFF_COURSE_RAD, "off_speed": f"{self.off_speed:.3f}", "off_course": OFF_COURSE}
        return _STEP.format(tell=tell, dt=self.dt, acceleration=f"{self.acceleration:.3f}", **numbers, **off)

    def _brake(self, watch: Watch | None) -> str:
        tell = f"    write_output_integer_register({BRAKE_ROW}, row)\n" if watch else ""
        end = f"    write_output_integer_register({END}, {BRAKED})\n" if watch else ""
        r = RAMP
        return _BRAKE.format(
            tell=tell,
            end=end,
            close=self._closing("    "),
            rest=self.rest_ticks,
            stride=self.stride,
            r=r,
            half_ramp=0.5 * r,
            whole=1.0 - r,
            slope=SLOPE,
            tilt=0.5 * r - 2.0 * r * r / 3.0 - r + r * r,
            weight=repr(1.0 / (1.0 - r)),
            share=repr(0.5 * r / (1.0 - r)),
            stop=FINAL_STOP_RAD_S2,
        )

    def _follow(self, watch: Watch | None) -> str:
        last = ", ".join(f"before[{j}]" for j in range(6))
        lines = ["  def follow(qd, ticks):", f"    local last = [{last}]"]
        lines += ["    listen()"] if watch else []
        if self.gripper.row >= 0:
            lines += [
                f"    if row + {self.stride} == {self.gripper.row} and not braking and not keeps:",
                f"      {self.gripper.text(True)}",
                "      opened = True",
                *([f"      write_output_integer_register({SWITCHED_ROW}, {self.gripper.row})"] if watch else []),
                "    end",
            ]
        lines += [
            f"    step(qd, {self.stride})",
            "    if braking and ticks >= 0:",
            "      brake(qd, last, ticks)",
            "    end",
            "  end",
        ]
        return "\n".join(lines)

    def _begin(self, watch: Watch | None) -> str:
        if watch is None:
            start = _numbers(self.start)
            closing = {"close": self.gripper.text(False), "grip": self.gripper.close_s}
            return _BEGIN_ON_PENDANT.format(start=start, near=AT_START_RAD, **closing)
        first = ((ROW, -1), (BRAKE_ROW, -1), (SWITCHED_ROW, -1), (END, RUNNING), (RUN, watch.run))
        return _BEGIN_WATCHED.format(
            registers="\n".join(f"  write_output_integer_register({register}, {value})" for register, value in first),
            request=REQUEST,
            go=watch.run + GO,
            brake=watch.run + BRAKE,
            cycles=round(BEGIN_S / self.dt),
            heartbeat=HEARTBEAT,
        )


def _flag(switch: SwitchRow) -> str:
    """Returns the variable that says whether a stop has to give an output its last level."""
    return f"ends_{switch.output}_{switch.index}"


def _numbers(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{x:.9f}' for x in values)}]"


_STATE = """\
  global row = {before_first}
  global opened = False
  global keeps = False
  global braking = False
  global before = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  global planned = {start}
  global heard = 0
  global silent = 0"""

_GIVE_UP = """\
  # Stops the arm at once, and ends the program.
  def give_up(end_word):
{close}
{tell}    stopj({deceleration})
    halt
  end"""

_LISTEN = """\
  # Stops the arm where the heartbeat has stopped; takes requests.
  def listen():
    local beat = read_input_integer_register({heartbeat})
    if beat == heard:
      silent = silent + 1
    else:
      heard = beat
      silent = 0
    end
    if silent >= {cycles}:
      give_up({unheard})
    end
    local asked = read_input_integer_register({request})
    if asked == {keep}:
      keeps = True
    elif asked != {go}:
      braking = True
    end
  end"""

_STEP = """\
  # Commands joint speeds for so many cycles, drawn to where the arm should be by now.
  def step(qd, cycles):
    row = row + cycles
    local q = get_target_joint_positions()
    local now = get_target_joint_speeds()
    local command = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    local change = 0.0
    local error = 0.0
    local pull = 0.0
    local j = 0
    while j < 6:
      error = planned[j] - q[j]
      if norm(error) > {off} or norm(before[j] - now[j]) > {off_speed}:
        give_up({off_course})
      end
      pull = {gain} * error
      if pull > {most}:
        pull = {most}
      elif pull < -{most}:
        pull = -{most}
      end
      command[j] = qd[j] + pull
      if norm(command[j] - now[j]) > change:
        change = norm(command[j] - now[j])
      end
      planned[j] = planned[j] + {half} * cycles * (before[j] + qd[j])
      before[j] = qd[j]
      j = j + 1
    end
{tell}    if cycles == 1:
      speedj(command, {acceleration}, {dt})
    else:
      speedj(command, change / (cycles * {dt}) + 0.001, cycles * {dt})
    end
  end"""

_BRAKE = """\
  # Flies the verified brake from the present row, and ends the program at rest.
  def brake(qd, last, ticks):
    local k = 1
    local u = 1.0
    local m = 0.0
    local slowing = 0.0
    local fade = 0.0
    local of_speed = 0.0
    local of_change = 0.0
    local j = 0
    local command = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
{tell}{close}
    while k <= ticks + {rest}:
      u = 1.0
      if k < ticks:
        u = 1.0 * k / ticks
      end
      if u < {r}:
        slowing = 0.5 * u * u / {r}
        fade = u - 0.5 * u * u / {r}
      elif u <= {whole}:
        slowing = u - {half_ramp}
        fade = {half_ramp}
      else:
        slowing = {whole} - 0.5 * (1.0 - u) * (1.0 - u) / {r}
        fade = {half_ramp}
      end
      m = u
      if u > 0.5:
        m = 1.0 - u
      end
      if m < {r}:
        slowing = slowing + {slope} * (0.5 * m * m / {r} - 2.0 * m * m * m / (3.0 * {r}))
      else:
        slowing = slowing + {slope} * ({tilt} + m - m * m)
      end
      of_speed = 1.0 - {weight} * slowing
      of_change = (fade - {share} * slowing) * ticks / {stride}
      j = 0
      while j < 6:
        command[j] = of_speed * qd[j] + of_change * (qd[j] - last[j])
        j = j + 1
      end
      step(command, 1)
      k = k + 1
    end
{end}    stopj({stop})
    halt
  end"""

_BEGIN_WATCHED = """\
{registers}
  local waited = 0
  while read_input_integer_register({request}) != {go}:
    if read_input_integer_register({request}) == {brake} or waited > {cycles}:
      halt
    end
    waited = waited + 1
    sync()
  end
  heard = read_input_integer_register({heartbeat})"""

_BEGIN_ON_PENDANT = """\
  local start = {start}
  local stands = get_actual_joint_positions()
  local j = 0
  while j < 6:
    if norm(stands[j] - start[j]) > {near}:
      popup("The arm is not at the start of this motion: see the program's head.", "Fling", error=True, blocking=True)
      halt
    end
    j = j + 1
  end
  {close}
  sleep({grip})"""
