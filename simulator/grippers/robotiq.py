"""Robotiq's 2F-85, 2F-140 and Hand-E: the registers, and the URCap's text protocol for them.

Source: Robotiq, instruction manuals, "Control"; of the text protocol: what public clients send and expect.
"""

from __future__ import annotations

from planner.grippers import GripperLink
from simulator.grippers.modbus import ModbusServer, RegisterMap, RtuFraming
from simulator.interfaces import Connection, ConnectionHandler
from simulator.physics import SimulatedGripper

OPEN = 3  # position that it reports when open
CLOSED = 230  # and when closed without an object; source: public clients' calibrations, 225 to 231
REQUEST_MAX = 255
MOVING = 0  # OBJ
STOPPED_CLOSING = 2
AT_REQUEST = 3
RESET = 0  # STA
ACTIVE = 3
NOT_ACTIVATED = 7  # FLT: "the activation bit must be set prior to action"
AWAY_M = 1e-4  # [m] from the request, at which the fingers have not arrived
OUTPUTS_AT = 1000
INPUTS_AT = 2000


def twin(link: GripperLink, gripper: SimulatedGripper) -> ConnectionHandler:
    """Returns the URCap's socket, or the tool's serial line with the gripper at its end."""
    state = RobotiqState(gripper)
    if link.transport == "socket":
        return RobotiqServer(state)
    return ModbusServer(RtuFraming(), RobotiqRegisters(state), link.slave_id)


class RobotiqState:
    """What the gripper was asked, and what it reports; it starts activated, as on a robot that is set up.

    Attributes:
        asked: values of the variables that clients set.
        fault: code of a fault; 0 without one.
    """

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        position = 0 if gripper.open else REQUEST_MAX
        self.asked = {"ACT": 1, "GTO": 1, "ATR": 0, "ARD": 0, "FOR": 0, "SPE": REQUEST_MAX, "POS": position}
        self.fault = 0

    def set(self, values: dict[str, int]) -> None:
        """Takes values together; with GTO it goes to the position."""
        self.asked |= values
        moves = bool(self.asked["GTO"]) and not values.keys().isdisjoint(("POS", "GTO"))
        self.fault = NOT_ACTIVATED if moves and not self.asked["ACT"] else 0
        if moves and not self.fault:
            goal_m = self.gripper.stroke_m * (1.0 - self.asked["POS"] / REQUEST_MAX)
            self.gripper.request(goal_m > self.gripper.object_m, goal_m)

    def value(self, name: str) -> int | None:
        """Returns a variable; None where there is none of this name."""
        if name == "POS":
            return self.position
        if name == "PRE":
            return self.asked["POS"]
        if name == "OBJ":
            return self.reached
        if name == "STA":
            return ACTIVE if self.asked["ACT"] else RESET
        return self.fault if name == "FLT" else self.asked.get(name)

    @property
    def position(self) -> int:
        """Position of the fingers, 3 (open) to 230 (closed)."""
        return round(CLOSED + (OPEN - CLOSED) * self.gripper.width_m / self.gripper.stroke_m)

    @property
    def reached(self) -> int:
        """How the last motion ended: OBJ."""
        gripper = self.gripper
        if gripper.is_busy:
            return MOVING
        return STOPPED_CLOSING if gripper.width_m > gripper.goal_m + AWAY_M else AT_REQUEST


class RobotiqServer(ConnectionHandler):
    """`SET NAME value …` is answered `ack`, without an end of line, `GET NAME` by `NAME value`, all else by `?`."""

    def __init__(self, state: RobotiqState) -> None:
        self.state = state

    def arrived(self, connection: Connection) -> None:
        """Answers every complete line."""
        for line in connection.take_lines():
            if words := line.decode("ascii", "replace").split():
                connection.send(self._answer(words))

    def _answer(self, words: list[str]) -> bytes:
        verb, *rest = words
        if verb == "GET" and len(rest) == 1:
            value = self.state.value(rest[0])
            return b"?\n" if value is None else f"{rest[0]} {value}\n".encode()
        if verb == "SET" and rest and len(rest) % 2 == 0:
            names = rest[::2]
            numbers = rest[1::2]
            if all(number.isdigit() and int(number) <= REQUEST_MAX for number in numbers):
                self.state.set({n: int(v) for n, v in zip(names, numbers, strict=True) if n in self.state.asked})
                return b"ack"
        return b"?\n"


class RobotiqRegisters(RegisterMap):
    """The same over a bus: three registers to write, three to read."""

    def __init__(self, state: RobotiqState) -> None:
        self.state = state

    def read(self, first: int, count: int) -> list[int] | None:
        """Returns registers; None beyond those that there are."""
        s = self.state
        status = s.reached << 6 | (s.value("STA") or 0) << 4 | s.asked["GTO"] << 3 | s.asked["ACT"]
        inputs = [status << 8, s.fault << 8 | s.asked["POS"], s.position << 8]
        outputs = [(s.asked["GTO"] << 3 | s.asked["ACT"]) << 8, s.asked["POS"], s.asked["SPE"] << 8 | s.asked["FOR"]]
        for at, registers in ((INPUTS_AT, inputs), (OUTPUTS_AT, outputs)):
            if at <= first and first + count <= at + len(registers):
                return registers[first - at : first - at + count]
        return None

    def write(self, first: int, values: list[int]) -> bool:
        """Takes registers; returns whether there are such."""
        if not first >= OUTPUTS_AT or first + len(values) > OUTPUTS_AT + 3:
            return False
        asked: dict[str, int] = {}
        for register, value in enumerate(values, first - OUTPUTS_AT):
            if register == 0:
                asked |= {"ACT": value >> 8 & 1, "GTO": value >> 11 & 1}
            elif register == 1:
                asked["POS"] = value & 0xFF
            else:
                asked |= {"SPE": value >> 8, "FOR": value & 0xFF}
        self.state.set(asked)
        return True
