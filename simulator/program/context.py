"""Context of a running program: registers, installation, and the other parts of the controller it may use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from planner.dynamics import Payload, joint_torques
from planner.kinematics import inverse
from planner.robots import Robot
from simulator.physics import Arm, Transform, kinematics
from simulator.program.interpreter_queue import InterpreterQueue
from simulator.program.messages import Message
from simulator.program.progress import PathProgress
from simulator.program.safety import SafetyLimits
from simulator.settings import BIT_REGISTERS, REGISTERS


class Registers:
    """Input registers written by clients, output registers written by the program.

    Attributes:
        int_in: input integer registers; a value stays until it is overwritten.
        double_in: input double registers, kept in the same way.
        written_at: cycle of the last data package that carried each input integer register, -1 before the first.
        int_out: output integer registers, each a list of one number.
        double_out: output double registers, each a list of one number.
        bit_in, bit_out: input and output bit registers.
    """

    def __init__(self) -> None:
        self.bit_in = [False] * BIT_REGISTERS
        self.bit_out = [False] * BIT_REGISTERS
        self.int_in = [0] * REGISTERS
        self.double_in = [0.0] * REGISTERS
        self.written_at = [-1] * REGISTERS
        self.int_out: list[list[float]] = [[0] for _ in range(REGISTERS)]
        self.double_out = [[0.0] for _ in range(REGISTERS)]

    def write_bits(self, name: str, value: int) -> None:
        """Writes the input bits of an RTDE variable: `input_bit_register_N` or `input_bit_registersA_to_B`."""
        if name.startswith("input_bit_register_"):
            self.bit_in[int(name.rpartition("_")[2])] = bool(value)
        elif name.startswith("input_bit_registers"):
            first = int(name.removeprefix("input_bit_registers").partition("_")[0])
            self.bit_in[first : first + 32] = [bool(value >> i & 1) for i in range(32)]


class OffsetRegisters:
    """The registers as one client's program sees them: its indices begin at an offset."""

    def __init__(self, registers: Registers, offset_int: int, offset_double: int) -> None:
        self.registers = registers
        self.offset_int = offset_int
        self.offset_double = offset_double

    def int_in(self, index: int) -> int:
        """Returns an input integer register."""
        return self.registers.int_in[index + self.offset_int]

    def double_in(self, index: int) -> float:
        """Returns an input double register."""
        return self.registers.double_in[index + self.offset_double]

    def doubles_in(self, index: int, count: int = 6) -> list[float]:
        """Returns `count` input double registers from `index` on."""
        first = index + self.offset_double
        return self.registers.double_in[first : first + count]

    def int_out(self, index: int, value: int) -> None:
        """Writes an output integer register; the value wraps as a signed 32-bit integer."""
        self.registers.int_out[index + self.offset_int][0] = (int(value) + 2**31) % 2**32 - 2**31

    def doubles_out(self, values: list[float], index: int = 0) -> None:
        """Writes output double registers from `index` on."""
        for i, value in enumerate(values, index + self.offset_double):
            self.registers.double_out[i][0] = float(value)


@dataclass
class Installation:
    """Tool, payload and mounting as the controller believes them; a client may change them, the true ones stay.

    Attributes:
        payload_kg: mass of the payload [kg].
        payload_cog_m: its centre of mass in the flange's frame [m].
        gravity_m_s2: against the fall, in the base (UR's sign) [m/s2].
        payload_inertia: inertia of the payload (6,) [kg m2].
        tool_voltage_v: of the supply at the tool's connector [V].
        tcp: pose of the tool centre point in the flange.
        tcp_pose: the same as UR's pose (6,) [m, rad].
    """

    payload_kg: float
    payload_cog_m: list[float]
    gravity_m_s2: list[float]
    payload_inertia: list[float] = field(default_factory=lambda: [0.0] * 6)
    tool_voltage_v: int = 0
    tcp: Transform = kinematics.IDENTITY
    tcp_pose: list[float] = field(default_factory=lambda: [0.0] * 6)

    def set_tcp(self, tcp: Transform) -> None:
        """Changes the tool centre point."""
        self.tcp, self.tcp_pose = tcp, kinematics.pose_of(tcp)


@dataclass
class MotionState:
    """What one motion command leaves for the next.

    Attributes:
        blended: the rest of a move that blends into the next; None without.
        servo_goal: joint positions (6,) [rad] of the servoj of the cycle before; empty without.
        servoing: whether a servoj has moved the arm in this cycle.
        leads_out: whether the move of this cycle has a goal beyond a joint's limit.
    """

    blended: PathProgress | None = None
    servo_goal: list[float] = field(default_factory=list)
    servoing: bool = False
    leads_out: bool = False

    def begin_cycle(self, moving: bool) -> None:
        """Forgets what is older than a cycle; without a program that may be `moving` the arm, the blend too."""
        if not self.servoing:
            self.servo_goal = []
        self.servoing = False
        self.leads_out = False
        if not moving:
            self.blended = None


class ContactSense(Protocol):
    """Whether the tool touches something."""

    def __call__(self, q: Sequence[float] | None = None) -> bool:
        """Answers for joint positions `q` (6,) [rad]; None: for the true ones."""
        ...


@dataclass(frozen=True)
class ProgramContext:
    """Parts of the controller that script functions read or act on.

    Attributes:
        version: of the controller's software.
        robot: constants of the arm, for the closed-form inverse kinematics and for what its joints can do.
        arm: the arm the program moves.
        motion: what one motion command leaves for the next.
        interpreter: statements that clients send to a program in interpreter mode.
        registers: registers shared with the client.
        installation: tool, payload and mounting.
        limits: safety limits.
        speed_scaling: returns the present speed scaling, 0 to 1.
        in_contact: returns whether the tool touches something.
        set_watchdog: sets the RTDE watchdog: register, least frequency [Hz].
        protective_stop: triggers a protective stop with a reason.
        post: passes a message on to the clients.
        set_outputs: requests outputs, by the names of RTDE's inputs.
        output_bits, input_bits: return the physical levels of the digital outputs, and of the inputs.
    """

    version: tuple[int, int, int]
    robot: Robot
    arm: Arm
    motion: MotionState
    interpreter: InterpreterQueue
    registers: Registers
    installation: Installation
    limits: SafetyLimits
    speed_scaling: Callable[[], float]
    in_contact: ContactSense
    set_watchdog: Callable[[int, float], None]
    protective_stop: Callable[[str], None]
    post: Callable[[Message], None]
    set_outputs: Callable[[Mapping[str, Any]], None]
    output_bits: Callable[[], int]
    input_bits: Callable[[], int]

    @property
    def tcp(self) -> Transform:
        """Pose of the tool centre point in the flange, as the controller believes it."""
        return self.installation.tcp

    def inertia(self) -> np.ndarray:
        """Returns the inertia matrix (6, 6) [kg m2] of links and payload at the present posture; no rotors."""
        return self._torques(np.zeros(6), np.eye(6)).T

    def coriolis(self) -> np.ndarray:
        """Returns the Coriolis and centrifugal torques (6,) [N m] of links and payload at the present motion."""
        return self._torques(np.array(self.arm.qd), np.zeros(6))

    def _torques(self, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        installation = self.installation
        payload = Payload(installation.payload_kg, np.array(installation.payload_cog_m), np.zeros((3, 3)))
        return joint_torques(self.robot, self.arm.q, qd, qdd, np.zeros(3), payload)

    def solve(self, pose: Sequence[float], near: list[float] | None = None) -> list[float] | None:
        """Returns the joint angles of a tool pose, or None if there are none.

        Args:
            pose: UR's pose of the tool in the base (6,) [m, rad].
            near: joint angles (6,) [rad] that the solution is to be nearest to; the commanded ones by default.
        """
        near = list(self.arm.q) if near is None else near
        goal = kinematics.transform(pose)
        q = self.arm.chain.solve(goal, near, self.tcp)
        if q is not None and self.limits.allows(q):
            return q
        found = inverse(self.robot, _matrix(goal), X_FT=_matrix(self.tcp)).q
        if not len(found):
            return None
        published = found[int(np.argmin(np.abs(found - near).max(axis=1)))].tolist()
        return self.arm.chain.solve(goal, published, self.tcp) or published  # this arm may deviate from the published


def _matrix(t: Transform) -> np.ndarray:
    return np.array([*t, 0.0, 0.0, 0.0, 1.0]).reshape(4, 4)
