"""The capsules around arm, tool and held object, read from the arm's data anew.

An arm that nobody has measured has those of another one at its own lengths: each coordinate of an end moves with what
it is nearest to, an axis, the end of a link or a tube; its tubes are as thick as their thickest part (docs/cells.md).
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from planner.cell import Cell
from verifier.elementary import Array

OBJECT = "object"
TUBES = ("upper_arm", "forearm")


@dataclass(frozen=True, eq=False)
class MovingCapsule:
    """All points within a radius of a segment that is fixed in a frame of the arm: its ends (2, 3) [m]."""

    name: str
    frame: int
    ends: Array
    radius_m: float


@cache
def _data(name: str) -> dict[str, Any]:
    return tomllib.loads((files("planner") / "robot_data" / f"{name}.toml").read_text(encoding="utf-8"))


@cache
def _measured(arm: str) -> list[MovingCapsule]:
    return [
        MovingCapsule(name, row["frame"], np.array([row["from_m"], row["to_m"]]), float(row["radius_m"]))
        for name, row in _data("capsules")[arm].items()
    ]


def _marks(a: Array, d: Array, tubes_m: tuple[float, float]) -> list[list[list[float]]]:
    """Returns places along x, y, z of the frames 0 to 5 that capsules end at or near [m]."""
    upper, fore = tubes_m
    return [
        [[0.0], [0.0], [0.0, d[0]]],
        [[0.0], [0.0], [0.0, upper]],
        [[0.0, -a[1]], [0.0], [fore, upper]],
        [[0.0, -a[2]], [0.0], [fore, d[3]]],
        [[0.0], [0.0], [0.0, d[4]]],
        [[0.0], [0.0], [0.0, d[5]]],
    ]


def _estimated(cell: Cell) -> list[MovingCapsule]:
    """Returns the capsules of an arm that nobody has measured: those of another one at its own lengths."""
    own = cell.robot.published
    measured = _measured(own.shape.of)
    assert own.shape.tubes_m is not None
    z_of = {c.name: float(c.ends[0, 2]) for c in measured}
    table = _data(own.shape.of)["dh"]
    before = _marks(table["a_m"], table["d_m"], (z_of["upper_arm"], z_of["forearm"]))
    after = _marks(own.a, own.d, own.shape.tubes_m)

    def place(frame: int, p: Array) -> Array:
        moved = []
        for x, old, new in zip(p.tolist(), before[frame], after[frame], strict=True):
            nearest = int(np.argmin(np.abs(np.array(old) - x)))
            moved.append(x + float(new[nearest]) - float(old[nearest]))
        return np.array(moved)

    starts = {tube: next(c.ends[0] for c in measured if c.name == f"{tube}_start") for tube in TUBES}
    thick = {tube: max(c.radius_m for c in measured if c.name.startswith(tube)) for tube in TUBES}
    if own.shape.foot_radius_m is not None:
        thick["foot"] = own.shape.foot_radius_m
    return [
        MovingCapsule(
            c.name,
            c.frame,
            np.array([place(c.frame, c.ends[0]), place(c.frame, starts.get(c.name, c.ends[1]))]),
            thick.get(c.name, c.radius_m),
        )
        for c in measured
    ]


def capsules_of(cell: Cell) -> list[MovingCapsule]:
    """Returns the capsules of arm and tool, and that of the held object last: the hull of a body."""
    shape = cell.robot.shape
    found = list(_estimated(cell) if shape.is_estimate else _measured(shape.of))
    for i, capsule in enumerate(cell.tool.capsules):
        ends = np.array([capsule.from_m, capsule.to_m])
        found.append(MovingCapsule(f"tool_{i}", 6, ends, capsule.radius_m))
    thing = cell.object
    along = thing.reach_m * (cell.tool.X_FT[:3, :3] @ thing.hull_axis)
    p_FT = cell.tool.X_FT[:3, 3]
    return [*found, MovingCapsule(OBJECT, 6, np.array([p_FT - along, p_FT + along]), thing.radius_m)]
