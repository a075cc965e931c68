"""Robotiq's 2F-85, 2F-140 and Hand-E: by the socket of the URCap, or by Modbus RTU through the tool's serial port.

Source of variables and registers: Robotiq, instruction manuals, "Control"; of the socket: the URCap's own programs.
A position is 0 for open to 255 for closed; GTO makes the gripper go there, PRE repeats it, OBJ says how that ended.
"""

from __future__ import annotations

import re
from itertools import cycle

from executor.grippers import modbus
from executor.grippers.fingers import ReportedFingers
from planner.grippers import GripperLink

CLOSED = 255
STEP = 2.0  # of 255 positions, 0.4 to 1.2 mm: the least that is a motion and no noise of the last digit
ACTIVATED = 3  # of STA
MOVING = 0  # of OBJ
STOPPED_CLOSING = 2  # by an object
AT_POSITION = 3  # without an object, or it was lost
OUTPUTS_AT = 1000
INPUTS_AT = 2000
GO = 0x0900  # activated, go to the position
FASTEST_STRONGEST = 0xFFFF  # speed and force, which share a register
ANSWER = re.compile(rb"\s*(?:ack|\?|(?P<name>[A-Z]{3}) (?P<value>\d+))\s*")
BUS_QUIET_S = 0.020  # [s] a question and its answer take 5 ms each on the line, at 115,200 bits a second


def position_of(link: GripperLink) -> int:
    """Returns the position at which the fingers are as far apart as the cell asks for."""
    return round(CLOSED * (1.0 - link.open_width_m / link.stroke_m))


class _Robotiq:
    """What both ways have in common."""

    answers = True
    reports = True
    fault = ""
    reconnects = False

    def __init__(self, link: GripperLink) -> None:
        self.open_position = position_of(link)
        self.fingers = ReportedFingers(STEP)
        self.status = ACTIVATED

    def unready(self) -> str:
        """Returns why it cannot be used; empty where it can."""
        if self.fault:
            return self.fault
        if self.status != ACTIVATED:
            return "it is not activated: activate it on the pendant, which opens and closes it"
        return ""

    def is_open(self) -> bool | None:
        """Returns whether it is open, or opens."""
        return self.fingers.is_open

    def is_closed(self) -> bool:
        """Returns whether it stands closed."""
        return self.fingers.is_closed

    def holds(self) -> bool | None:
        """Returns whether its fingers stand closed with an object between them."""
        return self.fingers.holds

    def motion(self) -> tuple[int, bool] | None:
        """Returns the number of its newest report, and whether its fingers had begun to open by then."""
        return self.fingers.motion

    def has_lost_object(self) -> bool:
        """Returns whether it held an object and closed further."""
        return self.fingers.has_lost_object

    def _report(self, position: int, reached: int, asked: int) -> None:
        grips = {MOVING: None, STOPPED_CLOSING: True}.get(reached, False)
        self.fingers.report(-position, grips, reached != MOVING, asked <= self.open_position)

    def _note_fault(self, code: int) -> None:
        self.fault = f"it reports fault {code}" if code else ""


class RobotiqSocket(_Robotiq):
    """The URCap's text: `SET NAME value …` is answered `ack`, without an end of line, and `GET NAME` by `NAME value`.

    A report is made of one answer each, the command's echo first: what follows it is not from before the command.
    """

    quiet_s = 0.0

    def __init__(self, link: GripperLink) -> None:
        super().__init__(link)
        self._values: dict[str, int] = {}
        self._questions = cycle([b"GET PRE\n", b"GET POS\n", b"GET OBJ\n"])

    def preparation(self) -> tuple[bytes, ...]:
        """Returns requests for its state; its fingers are set to be fast, their force stays as it is."""
        return (b"GET STA\n", b"GET FLT\n", b"SET SPE 255\n", b"GET PRE\n", b"GET POS\n", b"GET OBJ\n")

    def tell(self, opens: bool) -> bytes:
        """Returns the command to open or close."""
        self.fingers.tell(opens)
        self._values.clear()
        return b"SET POS %d GTO 1\n" % (self.open_position if opens else CLOSED)

    def question(self) -> bytes:
        """Returns the next question."""
        return next(self._questions)

    def take(self, received: bytearray) -> int:
        """Takes whole answers."""
        count = 0
        while (answer := ANSWER.match(received)) is not None:
            name, value = answer.groups()
            del received[: answer.end()]
            count += 1
            if name:
                self._note(name.decode(), int(value))
        return count

    def _note(self, name: str, value: int) -> None:
        if name == "STA":
            self.status = value
        elif name == "FLT":
            self._note_fault(value)
        elif name == "PRE":
            self._values = {name: value}
        elif "PRE" in self._values:
            self._values[name] = value
            if name == "OBJ" and "POS" in self._values:
                self._report(self._values["POS"], value, self._values["PRE"])
                self._values = {}


class RobotiqSerial(_Robotiq):
    """Registers over the tool's serial line, which the controller passes on from a port."""

    quiet_s = BUS_QUIET_S

    def __init__(self, link: GripperLink) -> None:
        super().__init__(link)
        self.slave_id = link.slave_id

    def preparation(self) -> tuple[bytes, ...]:
        """Returns a request for its state."""
        return (self.question(),)

    def tell(self, opens: bool) -> bytes:
        """Returns the command to open or close, at full speed and force."""
        self.fingers.tell(opens)
        position = self.open_position if opens else CLOSED
        return modbus.rtu(self.slave_id, modbus.write(OUTPUTS_AT, [GO, position, FASTEST_STRONGEST]))

    def question(self) -> bytes:
        """Returns a request for all registers."""
        return modbus.rtu(self.slave_id, modbus.read(INPUTS_AT, 3))

    def take(self, received: bytearray) -> int:
        """Takes whole frames."""
        count = 0
        while (pdu := modbus.take_rtu(received)) is not None:
            count += 1
            registers = modbus.registers_of(pdu)
            if len(registers) == 3:
                self._note(*registers)
        return count

    def _note(self, status: int, echo: int, position: int) -> None:
        """Takes the registers: status byte, reserved; fault, requested position; position, current."""
        self.status = status >> 12 & 3
        self._note_fault(echo >> 8 & 0x0F)
        self._report(position >> 8, status >> 14, echo & 0xFF)
