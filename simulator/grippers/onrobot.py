"""OnRobot's RG2, RG6 and VG10 behind a compute box: the registers that public drivers use."""

from __future__ import annotations

from planner.grippers import GripperLink
from simulator.grippers.modbus import ModbusServer, RegisterMap, TcpFraming
from simulator.interfaces import ConnectionHandler
from simulator.physics import SimulatedGripper

CONTROL_LAST = 2  # RG: force, width [1/10 mm], control; VG10: channels A and B, limit of the current
GRIP = (1, 16)  # with or without the offset of the fingertips
BUSY = 1
GRIPPED = 2
FINGERS = (258, 275)  # first and last register that can be read: offset of the fingertips to width with offset
WIDTHS = (267, 275)
STATUS = 268
GRIPPED_M = 1e-4  # [m] wider than asked for, fingers hold something
CHANNELS = (258, 259)
MODE_GRIP = 1  # of VG10, in the upper byte
VACUUM = 600  # [1/1000] that it reaches on a smooth object


def twin(link: GripperLink, gripper: SimulatedGripper) -> ConnectionHandler:
    """Returns the compute box."""
    registers = FingerRegisters(gripper) if link.stroke_m > 0.0 else VacuumRegisters(gripper)
    return ModbusServer(TcpFraming(), registers, link.slave_id)


class FingerRegisters(RegisterMap):
    """RG2, RG6: a new command is taken only once the fingers stand."""

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        self.control = [0, 0, 0]

    def read(self, first: int, count: int) -> list[int] | None:
        """Returns registers."""
        if first >= 0 and first + count <= CONTROL_LAST + 1:
            return self.control[first : first + count]
        if first < FINGERS[0] or first + count > FINGERS[1] + 1:
            return None
        gripper = self.gripper
        grips = not gripper.is_busy and gripper.width_m > gripper.goal_m + GRIPPED_M
        values: dict[int, int] = dict.fromkeys(WIDTHS, round(1e4 * gripper.width_m))
        values[STATUS] = (BUSY if gripper.is_busy else 0) | (GRIPPED if grips else 0)
        return [values.get(register, 0) for register in range(first, first + count)]

    def write(self, first: int, values: list[int]) -> bool:
        """Takes registers; the control register starts a motion."""
        if first + len(values) > CONTROL_LAST + 1:
            return False
        self.control[first : first + len(values)] = values
        started = first + len(values) == CONTROL_LAST + 1 and self.control[CONTROL_LAST] in GRIP
        gripper = self.gripper
        if started and not gripper.is_busy:
            goal_m = min(1e-4 * self.control[1], gripper.stroke_m)
            gripper.request(goal_m > gripper.object_m, goal_m)
        return True


class VacuumRegisters(RegisterMap):
    """VG10: both channels at the object; it holds while either sucks."""

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        channel = 0 if gripper.open else MODE_GRIP << 8 | 80
        self.control = [channel, channel, 500]

    def read(self, first: int, count: int) -> list[int] | None:
        """Returns registers."""
        if first >= 0 and first + count <= CONTROL_LAST + 1:
            return self.control[first : first + count]
        if first < CHANNELS[0] or first + count > CHANNELS[1] + 1:
            return None
        gripper = self.gripper
        holds = gripper.holds is not None and gripper.release_at is None
        channels = [VACUUM if holds and value >> 8 == MODE_GRIP else 0 for value in self.control[:2]]
        return channels[first - CHANNELS[0] : first - CHANNELS[0] + count]

    def write(self, first: int, values: list[int]) -> bool:
        """Takes registers."""
        if first + len(values) > CONTROL_LAST + 1:
            return False
        self.control[first : first + len(values)] = values
        self.gripper.request(all(value >> 8 != MODE_GRIP for value in self.control[:2]))
        return True
