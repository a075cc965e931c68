"""The Denavit–Hartenberg table of one arm, as its controller knows and tells it.

Link i moves by Rz(q + theta) Tz(d) Tx(a) Rx(alpha). Every arm of Universal Robots is measured in the factory; its
controller computes with the measured numbers and sends them, with a checksum a joint, in the "kinematics info" of its
primary interface. Clients compare the checksums to tell one arm from another.
"""

from __future__ import annotations

import struct
import zlib

from planner.calibration import DhTable, published_table, table_of
from planner.robots import Robot
from simulator.truth import DhDeviation

UNCALIBRATED = (0xFFFFFFFF,) * 6  # what URSim reports, whose arm is its model


def controller_table(robot: Robot, deviation: DhDeviation | None = None) -> DhTable:
    """Returns the table of an arm that deviates from the published one; None: of the arm as the cell has it."""
    if deviation is None:
        return table_of(robot)
    table = published_table(robot)
    d = deviation
    return DhTable(table.theta + d.theta_rad, table.a + d.a_m, table.d + d.d_m, table.alpha + d.alpha_rad)


def checksums(table: DhTable) -> tuple[int, ...]:
    """Returns a checksum a joint (6,): CRC-32 of its four numbers. UR publishes no formula; clients compare them."""
    return tuple(zlib.crc32(struct.pack(">4d", *row)) for row in table.rows)


def told_checksums(robot: Robot, table: DhTable) -> tuple[int, ...]:
    """Returns the checksums (6,) that the controller of an arm with this table tells."""
    own = checksums(table)
    return UNCALIBRATED if own == checksums(published_table(robot)) else own
