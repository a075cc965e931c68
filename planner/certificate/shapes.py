"""The capsules of a cell's arm, tool and object as tables for the checks in space, computed once a cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.certificate.bounds import levers
from planner.geometry import Capsule, body_capsules, self_collision_pairs

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

CELLS_KEPT = 32  # cells whose tables are kept


@dataclass(frozen=True, eq=False)
class Shapes:
    """k capsules, the object in the tool last, and the p pairs of them that can meet.

    Attributes:
        names: (k,).
        frame: DH frame of each (k,).
        ends: end points in it (k, 2, 3) [m].
        radius: (k,) [m].
        lever: of each capsule's points about each joint (k, 6) [m].
        moving: those that the first joint moves (j,).
        pairs: indices (p, 2) of arm and tool.
        pair_lever: of the outer one about the joints between the two (p, 6) [m].
        tool_lever: of the tool centre point about each joint (6,) [m].
    """

    names: tuple[str, ...]
    frame: Index
    ends: Vector
    radius: Vector
    lever: Vector
    moving: Index
    pairs: Index
    pair_lever: Vector
    tool_lever: Vector

    @cached_property
    def homogeneous(self) -> Vector:
        """End points with a fourth coordinate of one (k, 2, 4)."""
        return np.concatenate([self.ends, np.ones((len(self.ends), 2, 1))], axis=2)

    @property
    def object(self) -> int:
        """Index of the object."""
        return len(self.names) - 1

    def ends_in_world(self, X_WL: Vector) -> Vector:
        """Returns the end points of every capsule (k, 2, 3, n) for link poses (n, 7, 4, 4)."""
        X = X_WL[:, self.frame, :3].transpose(1, 3, 2, 0).reshape(len(self.frame), 4, -1)
        return (self.homogeneous @ X).reshape(len(self.frame), 2, 3, -1)

    def heights(self, X_WL: Vector) -> Vector:
        """Returns how high the lowest point of every moving capsule is (j, n) [m] for link poses (n, 7, 4, 4)."""
        rows = X_WL[:, self.frame[self.moving], 2].transpose(1, 2, 0)
        ends = self.homogeneous[self.moving] @ rows
        return np.minimum(ends[:, 0], ends[:, 1]) - self.radius[self.moving, None]

    def end_in_world(self, X_WL: Vector, item: Index) -> Vector:
        """Returns the end points (n, 2, 3) of capsule `item[i]` for the i-th of link poses (n, 7, 4, 4)."""
        X = X_WL[np.arange(len(item)), self.frame[item]]
        return np.matmul(self.ends[item], np.swapaxes(X[:, :3, :3], -1, -2)) + X[:, None, :3, 3]


@lru_cache(maxsize=CELLS_KEPT)
def shapes_of(cell: Cell) -> Shapes:
    """Returns the tables of a cell."""
    p_FT = cell.tool.X_FT[:3, 3]
    thing = Capsule(frame=6, p0=p_FT, p1=p_FT, radius_m=cell.object.radius_m, name="object")
    capsules = [*body_capsules(cell.robot, cell.tool.capsules), thing]
    frame = np.array([c.frame for c in capsules])
    ends = np.array([[c.p0, c.p1] for c in capsules])
    reach = np.linalg.norm(ends, axis=2).max(axis=1)
    lever = np.array([levers(cell.robot, int(f), float(r)) for f, r in zip(frame, reach, strict=True)])
    pairs = np.array(self_collision_pairs(cell.robot, cell.tool.capsules), dtype=np.intp).reshape(-1, 2)
    return Shapes(
        names=tuple(c.name for c in capsules),
        frame=frame,
        ends=ends,
        radius=np.array([c.radius_m for c in capsules]),
        lever=lever,
        moving=np.flatnonzero(frame > 0),
        pairs=pairs,
        pair_lever=_pair_levers(frame, lever, pairs),
        tool_lever=levers(cell.robot, 6, float(np.linalg.norm(p_FT))),
    )


def _pair_levers(frame: Index, lever: Vector, pairs: Index) -> Vector:
    """Returns the levers (p, 6) of the outer capsule of each pair, without the joints that move both alike."""
    rows = []
    for pair in pairs:
        near, far = sorted(pair, key=lambda i: frame[i])
        between = np.arange(6) >= frame[near]
        rows.append(np.where(between, lever[far], 0.0))
    return np.array(rows).reshape(-1, 6)
