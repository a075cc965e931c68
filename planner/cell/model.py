"""What a cell is: frozen dataclasses, every array read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from planner.cell.table import Vector
from planner.robots import Robot


@dataclass(frozen=True, eq=False)
class ToolCapsule:
    """A capsule of the tool: end points in the flange [m] and radius [m]."""

    from_m: Vector
    to_m: Vector
    radius_m: float


@dataclass(frozen=True, eq=False)
class Tool:
    """What hangs on the flange. `X_FT` is the pose of the tool centre point (the object's centre) in the flange."""

    X_FT: Vector
    mass_kg: float
    capsules: tuple[ToolCapsule, ...]


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds on the motion: per joint (6,) in rad, rad/s, rad/s^2, rad/s^3, N m; the tool centre's speed in m/s."""

    q_lower: Vector
    q_upper: Vector
    qd_max: Vector
    qdd_max: Vector
    jerk_max: Vector
    tau_max: Vector
    tcp_speed_max: float
    singularity_distance_min: float


@dataclass(frozen=True, eq=False)
class Box:
    """An axis-aligned box in the world [m]."""

    lower: Vector
    upper: Vector


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What the motion must respect, in the world. The floor is the plane z = `floor_z_m`."""

    floor_z_m: float
    clearance_m: float
    gravity_m_s2: float
    keep_in: tuple[Box, ...]
    keep_out: tuple[Box, ...]


@dataclass(frozen=True)
class ThrownObject:
    """The object: mass [kg], radius [m], drag coefficient of a sphere [-] (0: no drag)."""

    mass_kg: float
    radius_m: float
    drag_coefficient: float


@dataclass(frozen=True)
class Gripper:
    """How the gripper is told to open, how long the object takes to leave, and how much that time scatters [s]."""

    output: str
    index: int
    open_level: bool
    delay_s: float
    jitter_s: float


@dataclass(frozen=True)
class Timing:
    """`lag_s`: how long after its command the controller's motion is measured [s]."""

    lag_s: float


@dataclass(frozen=True)
class Link:
    """The controller: `kind` is "sim" or "ur"; a real arm is never a default."""

    kind: str
    host: str


@dataclass(frozen=True)
class Sim:
    """What the simulated controller is; the planner never looks here."""

    polyscope: str
    lag_s: float
    gripper_delay_s: float
    gripper_jitter_s: float
    landing_height_m: float
    seed: int


@dataclass(frozen=True, eq=False)
class Cell:
    """One robot station. `X_WB` is the pose of the arm's base in the world; `sha256` is that of the file's bytes."""

    name: str
    sha256: str
    robot: Robot
    home: Vector
    X_WB: Vector
    tool: Tool
    limits: Limits
    surroundings: Surroundings
    object: ThrownObject
    gripper: Gripper
    timing: Timing
    link: Link
    sim: Sim
    document: Mapping[str, Any] = field(repr=False)

    def as_document(self) -> dict[str, Any]:
        """Returns the file's keys and numbers with defaults filled in, and `name` and `sha256`."""
        return {"name": self.name, "sha256": self.sha256, **self.document}
