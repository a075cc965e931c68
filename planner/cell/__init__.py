"""The cell: one robot station, read from a TOML file, hashed and checked.

Everything the planner knows about a site stands here; the arm's own numbers stand in `planner.robots`.
"""

from planner.cell.file import load_cell, parse_cell
from planner.cell.model import (
    Box,
    Cell,
    Gripper,
    Limits,
    Link,
    Sim,
    Surroundings,
    ThrownObject,
    Timing,
    Tool,
    ToolCapsule,
)

__all__ = [
    "Box",
    "Cell",
    "Gripper",
    "Limits",
    "Link",
    "Sim",
    "Surroundings",
    "ThrownObject",
    "Timing",
    "Tool",
    "ToolCapsule",
    "load_cell",
    "parse_cell",
]
