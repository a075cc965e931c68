"""RTDE output variables that are computed only for a client that asks for them.

Source of names and meanings: Universal Robots, RTDE guide, "Robot controller outputs".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from simulator.controller import Controller
from simulator.physics import Transform, kinematics
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
        self.elbow_links = kinematics.PublishedChain(controller.cell.robot.published).links[:2]
        self.functions: dict[str, Callable[[], Vector]] = {
            "elbow_position": lambda: self._elbow()[0],
            "elbow_velocity": lambda: self._elbow()[1],
            "target_TCP_acceleration": self._tcp_acceleration,
            "actual_TCP_acceleration": self._tcp_acceleration,  # the sensor's noise is not simulated
            "joint_position_deviation_ratio": self._deviation_ratio,
            "control_step": lambda: [controller.timeline.cycles],
            "target_gravity": lambda: controller.installation.gravity_m_s2,
            "actual_robot_energy_consumed": lambda: [SUPPLY_W * controller.timeline.t],
            "actual_configurable_digital_output_bits": self._configurable_outputs,
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

    def _elbow(self) -> tuple[list[float], list[float]]:
        arm = self.controller.arm
        return point_motion(self.elbow_links, arm.measured_q, arm.measured_qd, kinematics.IDENTITY)

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

    def _configurable_outputs(self) -> list[float]:
        return [self.controller.workcell.outputs.bits >> CONFIGURABLE_SHIFT & CONFIGURABLE_MASK]


def word_of(bits: Sequence[bool]) -> int:
    """Returns the number with these bits, the first one the lowest."""
    return sum(bit << i for i, bit in enumerate(bits))


def point_motion(
    links: Sequence[tuple[float, float, float, float]], q: Vector, qd: Vector, place: Transform
) -> tuple[list[float], list[float]]:
    """Returns position and velocity, in the base, of a point that moves with the last of some links.

    Args:
        links: a, d, cosine and sine of alpha of each link from the base on (Denavit-Hartenberg).
        q, qd: joint positions and speeds [rad, rad/s]; those beyond the links are ignored.
        place: frame at the point, in the frame of the last link.
    """
    pose = kinematics.IDENTITY
    axes = []
    for (a, d, ca, sa), angle in zip(links, q, strict=False):
        axes.append((pose[2], pose[6], pose[10], pose[3], pose[7], pose[11]))
        c = math.cos(angle)
        s = math.sin(angle)
        pose = kinematics.product(pose, (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d))
    pose = kinematics.product(pose, place)
    velocity = [0.0, 0.0, 0.0]
    for (zx, zy, zz, px, py, pz), rate in zip(axes, qd, strict=False):
        rx = pose[3] - px
        ry = pose[7] - py
        rz = pose[11] - pz
        velocity[0] += rate * (zy * rz - zz * ry)
        velocity[1] += rate * (zz * rx - zx * rz)
        velocity[2] += rate * (zx * ry - zy * rx)
    return [pose[3], pose[7], pose[11]], velocity


def linear_momentum(
    links: Sequence[tuple[float, float, float, float]], bodies: Sequence[tuple[float, Vector]], q: Vector, qd: Vector
) -> float:
    """Returns the norm of the linear momentum [kg m/s] of bodies that move with the links, in one pass over them.

    Args:
        links: as for `point_motion`.
        bodies: mass [kg] and centre of mass, in the frame of its link, of the body on each link.
        q, qd: joint positions, with the offsets of the arm's table, and speeds [rad, rad/s].
    """
    pose = kinematics.IDENTITY
    wx = wy = wz = vx = vy = vz = mx = my = mz = 0.0  # spin and speed of the link's origin; momentum so far
    for (a, d, ca, sa), angle, rate, (mass, (x, y, z)) in zip(links, q, qd, bodies, strict=True):
        wx = wx + pose[2] * rate
        wy = wy + pose[6] * rate
        wz = wz + pose[10] * rate
        px = pose[3]
        py = pose[7]
        pz = pose[11]
        c = math.cos(angle)
        s = math.sin(angle)
        pose = kinematics.product(pose, (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d))
        rx = pose[3] - px
        ry = pose[7] - py
        rz = pose[11] - pz
        vx = vx + wy * rz - wz * ry
        vy = vy + wz * rx - wx * rz
        vz = vz + wx * ry - wy * rx
        rx, ry, rz = (pose[i] * x + pose[i + 1] * y + pose[i + 2] * z for i in (0, 4, 8))
        mx += mass * (vx + wy * rz - wz * ry)
        my += mass * (vy + wz * rx - wx * rz)
        mz += mass * (vz + wx * ry - wy * rx)
    return math.hypot(mx, my, mz)
