"""OnRobot's RG2, RG6 and VG10, by Modbus TCP of the compute box.

Source of registers: OnRobot, "Modbus TCP/RTU" of the compute box, as public drivers use them; 1/10 mm, 1/10 N, 1/1000.
"""

from __future__ import annotations

from collections.abc import Sequence

from executor.grippers import modbus
from executor.grippers.fingers import ReportedFingers
from planner.grippers import GripperLink

FORCE = {"rg2": 400, "rg6": 1200}  # [1/10 N] the strongest, as the fingers open with it too
CONTROL_AT = 0
GRIP = 1  # go to the width
WIDTH_AT = 267  # and its status behind it
BUSY = 1
GRIPS = 2
WIDTH_STEP = 10.0  # [1/10 mm]
VACUUM_AT = 258  # of both channels
SUCKS = 0x0100 + 80  # [%] the strongest vacuum that is taken
RELEASES = 0
HOLDS = 100  # [1/1000] of vacuum: less holds nothing
VACUUM_STEP = 100.0  # [1/1000]


class OnRobotGripper:
    """The fingers of an RG, or the cups of a VG10."""

    answers = True
    reports = True
    fault = ""
    reconnects = False
    quiet_s = 0.0

    def __init__(self, link: GripperLink) -> None:
        self.slave_id = link.slave_id
        self.has_fingers = link.stroke_m > 0.0
        if self.has_fingers:
            width = round(1e4 * link.open_width_m)
            force = FORCE[link.model]
            self._commands = {True: [force, width, GRIP], False: [force, 0, GRIP]}
            self._asks = modbus.read(WIDTH_AT, 2)
            self.fingers = ReportedFingers(WIDTH_STEP)
        else:
            self._commands = {True: [RELEASES, RELEASES], False: [SUCKS, SUCKS]}
            self._asks = modbus.read(VACUUM_AT, 2)
            self.fingers = ReportedFingers(VACUUM_STEP)
        self._transaction = 0

    def preparation(self) -> tuple[bytes, ...]:
        """Returns a request for its state."""
        return (self.question(),)

    def unready(self) -> str:
        """Returns why it cannot be used; empty where it can."""
        return self.fault

    def tell(self, opens: bool) -> bytes:
        """Returns the command to open or close."""
        self.fingers.tell(opens)
        return self._frame(modbus.write(CONTROL_AT, self._commands[opens]))

    def question(self) -> bytes:
        """Returns a request for its state."""
        return self._frame(self._asks)

    def take(self, received: bytearray) -> int:
        """Takes whole frames."""
        count = 0
        while (pdu := modbus.take_tcp(received)) is not None:
            count += 1
            if pdu and pdu[0] & modbus.FAILED:
                self.fault = f"the compute box refuses a request (Modbus exception {pdu[1] if len(pdu) > 1 else '?'})"
            registers = modbus.registers_of(pdu)
            if len(registers) == 2:
                self._report(registers)
        return count

    def _report(self, registers: Sequence[int]) -> None:
        if self.has_fingers:
            width, status = registers
            busy = bool(status & BUSY)
            self.fingers.report(width, None if busy else bool(status & GRIPS), not busy)
            return
        vacuum = max(registers)
        self.fingers.report(-vacuum, vacuum >= HOLDS, vacuum >= HOLDS)

    def _frame(self, pdu: bytes) -> bytes:
        self._transaction += 1
        return modbus.tcp(self._transaction, self.slave_id, pdu)

    def is_open(self) -> bool | None:
        """Returns whether it opens; None before it was seen closed."""
        return self.fingers.is_open

    def is_closed(self) -> bool:
        """Returns whether it stands closed."""
        return self.fingers.is_closed

    def holds(self) -> bool | None:
        """Returns whether its fingers stand closed with an object, or whether the vacuum that holds one was reached."""
        return self.fingers.holds if self.has_fingers else self.fingers.is_closed

    def motion(self) -> tuple[int, bool] | None:
        """Returns the same of fingers; a vacuum is gone well before its object is."""
        return self.fingers.motion if self.has_fingers else None

    def has_lost_object(self) -> bool:
        """Returns whether fingers closed further without their object; a vacuum that goes is one that opens."""
        return self.has_fingers and self.fingers.has_lost_object
