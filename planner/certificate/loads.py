"""What the joints of a cell bear, as tables for the check of torques, computed once a cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.certificate.bounds import levers
from planner.dynamics import Bodies, Payload, bodies

Vector = NDArray[np.float64]

CELLS_KEPT = 32  # cells whose tables are kept


@dataclass(frozen=True, eq=False)
class Loads:
    """The six links, the tool and the object.

    Attributes:
        empty: the links with the tool.
        thing_kg: the object's mass, at the tool centre point until the release.
        lever: of the centre of mass of each of eight bodies about each joint (8, 6) [m].
        moment_arm: mass times the arm at which its weight can act on each joint (8, 6) [kg m].
        inertia: of everything that each joint turns, at most (6,) [kg m^2].
        mass_matrix: how much torque of each joint an acceleration of each can ask for, at most (6, 6) [kg m^2].
    """

    empty: Bodies
    thing_kg: float
    lever: Vector
    moment_arm: Vector
    inertia: Vector
    mass_matrix: Vector


@lru_cache(maxsize=CELLS_KEPT)
def loads_of(cell: Cell) -> Loads:
    """Returns the tables of a cell; the tool's mass is half way to the tool centre point."""
    p_FT, robot = cell.tool.X_FT[:3, 3], cell.robot
    tool = Payload(cell.tool.mass_kg, 0.5 * p_FT, np.zeros((3, 3)))
    reach, thing = float(np.linalg.norm(p_FT)), cell.object.mass_kg
    rows = [
        (link.mass, float(np.linalg.norm(link.com)), i, float(np.trace(link.inertia)))
        for i, link in enumerate(robot.links, start=1)
    ]
    rows += [(tool.mass_kg, 0.5 * reach, 6, 0.0), (thing, reach, 6, 0.0)]
    lever = np.array([levers(robot, frame, com) for _, com, frame, _ in rows])
    turned = np.array([np.arange(6) < frame for _, _, frame, _ in rows])
    mass, inertia = np.array([row[0] for row in rows]), np.array([row[3] for row in rows])
    along = np.where(turned, np.abs(robot.d), 0.0)  # offsets along each joint's own axis, which `levers` leaves out
    moment_arm = mass[:, None] * (lever + along)
    both_turned = turned[:, :, None] & turned[:, None, :]
    mass_matrix = moment_arm.T @ lever + np.tensordot(inertia, both_turned, axes=1)
    return Loads(bodies(robot, tool), thing, lever, moment_arm, inertia @ turned, mass_matrix)
