"""The Denavit–Hartenberg table of one arm, as its controller knows and tells it.

Link i moves by Rz(q + theta) Tz(d) Tx(a) Rx(alpha). Every arm of Universal Robots is measured in the factory; its
controller computes with the measured numbers and sends them, with a checksum a joint, in the "kinematics info" of its
primary interface. Clients compare the checksums to tell one arm from another.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from executor.simulator.truth import DhDeviation
from planner.calibration import published_table, table_of
from planner.robots import Robot

Joints = tuple[float, ...]
PUBLISHED = DhDeviation()  # no deviation


@dataclass(frozen=True)
class ControllerKinematics:
    """The controller's own table of its arm: Denavit–Hartenberg parameters of six joints.

    Attributes:
        theta: offsets of the joint angles (6,) [rad]; zero in the published table.
        a, d: lengths (6,) [m].
        alpha: twists (6,) [rad].
    """

    theta: Joints
    a: Joints
    d: Joints
    alpha: Joints

    @property
    def checksums(self) -> tuple[int, ...]:
        """A checksum a joint (6,): CRC-32 of its four numbers. UR publishes no formula; clients only compare them."""
        rows = zip(self.theta, self.a, self.d, self.alpha, strict=True)
        return tuple(zlib.crc32(struct.pack(">4d", *row)) for row in rows)


def controller_kinematics(robot: Robot, deviation: DhDeviation | None = PUBLISHED) -> ControllerKinematics:
    """Returns the table of an arm that deviates from the published one; None: of the arm as the cell has it."""
    if deviation is None:
        table, deviation = table_of(robot), PUBLISHED
    else:
        table = published_table(robot)
    return ControllerKinematics(
        theta=_sums(table.theta.tolist(), deviation.theta_rad),
        a=_sums(table.a.tolist(), deviation.a_m),
        d=_sums(table.d.tolist(), deviation.d_m),
        alpha=_sums(table.alpha.tolist(), deviation.alpha_rad),
    )


def _sums(published: list[float], deviation: Joints) -> Joints:
    return tuple(x + y for x, y in zip(published, deviation, strict=True))
