"""A tool with two grippers side by side, and a motion in which both let go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from planner.cell import Cell, parse_cell

ROOT = Path(__file__).parents[2]
TARGETS = {"": (1.2, 0.3, 0.0), "left": (1.1, -0.2, 0.0)}  # of each gripper's object
SIDE_BY_SIDE = {
    "tcp_position_m = [0.0, 0.0, 0.17]": "tcp_position_m = [0.0, 0.06, 0.17]",
    "capsules = [{ from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.15], radius_m = 0.05 }]": """capsules = [
  { from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.09], radius_m = 0.05 },
  { from_m = [0.0, -0.06, 0.12], to_m = [0.0, 0.06, 0.12], radius_m = 0.03 },
]""",
}
LEFT = """
[grippers.left]
output = "standard_digital"
index = 1
delay_s = 0.030
jitter_s = 0.0005
tcp_position_m = [0.0, -0.06, 0.17]
opening_direction = [0.0, 0.0, 1.0]
opening_cone_rad = 2.0
hold_acceleration_m_s2 = 100.0
object = { mass_kg = 0.08, radius_m = 0.025 }
"""


def two_grippers(text: str, left: str = LEFT) -> str:
    """Returns the text of the shipped `ur5e-sim`, with another gripper beside its own."""
    for old, new in SIDE_BY_SIDE.items():
        assert old in text
        text = text.replace(old, new)
    return text + left


def cell_of_two(left: str = LEFT) -> Cell:
    """Returns a cell with two grippers."""
    return parse_cell(two_grippers((ROOT / "cells" / "ur5e-sim.toml").read_text(), left), "two")


def two_throws(**fields: Any) -> dict[str, Any]:
    """Returns a request that throws both objects, the cell's own gripper's first."""
    own, left = ({"kind": "target", "position": list(TARGETS[name])} for name in ("", "left"))
    first = {"name": "first", "state": own, "releases": True}
    second = {"name": "second", "state": left, "releases": "left"}
    return {"passages": [first, second], **fields}
