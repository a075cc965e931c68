"""RTDE output variables that are computed only for a client that asks for them.

Source of names and meanings: Universal Robots, RTDE guide, "Robot controller outputs".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from planner.calibration import published_table
from simulator.controller import Controller
from simulator.physics import kinematics
from simulator.settings import BIT_REGISTERS, BIT_WORDS_END, REGISTERS

DEVIATION_MAX_RAD = 0.2  # [rad] chosen: deviation of a joint at which its ratio is 1; UR publishes none
SUPPLY_W = 24.0  # [W] chosen: what a robot at rest draws, half an ampere at 48 V
CONFIGURABLE_SHIFT = 8
CONFIGURABLE_MASK = 0xFF  # of the configurable ones among all digital bits; source: RTDE guide
Vector = Sequence[float]


class DerivedValues:
    """Values of single output variables, computed on request.

    Attributes:
        functions: output variable -> function that returns its numbers.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        # A measured table may have the second frame far along its axis: the elbow is where the published one has it.
        self.published = kinematics.KinematicChain(published_table(controller.cell.robot))
        self.functions: dict[str, Callable[[], Vector]] = {
            "elbow_position": lambda: self._elbow()[0],
            "elbow_velocity": lambda: self._elbow()[1],
            "target_TCP_acceleration": self._tcp_acceleration,
            "actual_TCP_acceleration": self._tcp_acceleration,  # the sensor's noise is not simulated
            "joint_position_deviation_ratio": self._deviation_ratio,
            "control_step": lambda: [controller.timeline.cycles],
            "target_gravity": lambda: controller.installation.gravity_m_s2,
            "actual_robot_energy_consumed": lambda: [SUPPLY_W * controller.timeline.t],
            "actual_configurable_digital_output_bits": lambda: _configurable(controller.workcell.outputs.bits),
            "actual_configurable_digital_input_bits": lambda: _configurable(controller.workcell.input_bits),
            **self._register_functions(),
        }

    def _register_functions(self) -> dict[str, Callable[[], Vector]]:
        registers = self.controller.registers
        found: dict[str, Callable[[], Vector]] = {}
        for i in range(REGISTERS):
            found[f"input_int_register_{i}"] = lambda i=i: [registers.int_in[i]]
            found[f"input_double_register_{i}"] = lambda i=i: [registers.double_in[i]]
        for direction, bits in (("input", registers.bit_in), ("output", registers.bit_out)):
            for i in range(BIT_WORDS_END, BIT_REGISTERS):
                found[f"{direction}_bit_register_{i}"] = lambda bits=bits, i=i: [bits[i]]
            for first in (0, 32):
                name = f"{direction}_bit_registers{first}_to_{first + 31}"
                found[name] = lambda bits=bits, first=first: [word_of(bits[first : first + 32])]
        return found

    def _elbow(self) -> tuple[Vector, Vector]:
        """Returns position and velocity of the elbow, the origin of the second link's frame."""
        arm = self.controller.arm
        return kinematics.point_motion(self.published.frames(arm.measured_q)[:3], arm.measured_qd)

    def _tcp_acceleration(self) -> list[float]:
        """Returns the change of the commanded twist over the last cycle."""
        c = self.controller
        (q, qd, _) = self.controller.arm.before
        _, now = c.commanded_motion()
        _, before = c.arm.chain.motion(q, qd, c.installation.tcp)
        return [(b - a) / c.timeline.dt for a, b in zip(before, now, strict=True)]

    def _deviation_ratio(self) -> list[float]:
        arm = self.controller.arm
        return [max(abs(a - b) for a, b in zip(arm.q, arm.measured_q, strict=True)) / DEVIATION_MAX_RAD]


def _configurable(bits: int) -> list[float]:
    """Returns those of the configurable lines among all digital bits."""
    return [bits >> CONFIGURABLE_SHIFT & CONFIGURABLE_MASK]


def word_of(bits: Sequence[bool]) -> int:
    """Returns the number with these bits, the first one the lowest."""
    return sum(bit << i for i, bit in enumerate(bits))
