"""Numbers of an arm from the table `[arm_data]` of a cell file, with their source.

Those that its maker has not published; lower limits than the published ones; and other masses of its links.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.cell.fields import must_be, number, vector
from planner.errors import CellError, IncompleteRobot, UnknownRobot
from planner.fields import did_you_mean
from planner.robots import ARM_NUMBERS, TURN_DEG, Robot, completed, published_number

WHERE = "arm_data."
SOURCE_MAX = 500  # characters
# By key: smallest and largest value of an entry, far beyond any arm of this kind; they catch wrong units.
BOUNDS = {
    "dh_a_m": (-3.0, 3.0),
    "dh_d_m": (-3.0, 3.0),
    "joint_position_lower_deg": (-720.0, 0.0),
    "joint_position_upper_deg": (0.0, 720.0),
    "joint_velocity_deg_s": (1.0, 1000.0),
    "joint_torque_n_m": (1.0, 5000.0),
    "link_mass_kg": (1e-3, 200.0),
    "link_com_m": (-3.0, 3.0),
    "link_inertia_kg_m2": (-100.0, 100.0),
    "payload_kg": (0.1, 200.0),
}
PER_LINK = {"link_com_m": 3, "link_inertia_kg_m2": 6}  # numbers of a link, of keys that have several
ROUNDING = 1e-9  # [-] of a moment of inertia: by which the sum of the others may be smaller

# The joints' axes are laid out like this on every arm of this maker: other lengths have to be 0, and these negative.
# source: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
LAYOUT = {"dh_a_m": (0, -1, -1, 0, 0, 0), "dh_d_m": (1, 0, 0, 1, 1, 1)}  # signs

ARM_DATA: dict[str, Any] = {**dict.fromkeys(ARM_NUMBERS), "source": None}


def completed_arm(document: Mapping[str, Any]) -> Robot:
    """Returns the arm of a cell file, with the numbers that its `[arm_data]` adds.

    Args:
        document: keys of the cell file, with defaults filled in.

    Raises:
        CellError: there is no such arm, it lacks numbers, or a number is refused: out of bounds, or already published.
    """
    table = document["arm_data"]
    name = str(document["robot"])
    try:
        numbers = {key: _read(table, key, name) for key in ARM_NUMBERS if table[key] is not None}
        if numbers:
            _require_source(table["source"])
        return completed(name, numbers)
    except UnknownRobot as error:
        meant = did_you_mean(document["robot"], error.known)
        raise must_be(f"one of {', '.join(error.known)}{meant}", "robot", document["robot"]) from error
    except IncompleteRobot as error:
        raise CellError("robot", name, f"is incomplete: {error.reason}") from error


def _read(table: Mapping[str, Any], key: str, name: str) -> Any:
    published: Any = published_number(name, key)
    if key.startswith("joint_position"):
        published = published or TURN_DEG
    if key in LAYOUT and published is not None:
        raise CellError(WHERE + key, table[key], f"is published for a {name}; [kinematics] takes a measured chain")
    if key == "payload_kg":
        mass_kg = number(table, key, WHERE, *BOUNDS[key])
        _require_within([mass_kg], [published], WHERE + key)
        return mass_kg
    if key not in PER_LINK:
        values = vector(table, key, WHERE, 6, *BOUNDS[key]).tolist()
        _require_layout(values, key)
        if not key.startswith("link_"):
            _require_within(values, published or [None] * 6, WHERE + key)
        return values
    rows = table[key]
    if not isinstance(rows, list | tuple) or len(rows) != 6:
        raise CellError(WHERE + key, rows, f"must be a list of 6 lists of {PER_LINK[key]} numbers")
    read = [
        vector({f"{key}[{i}]": row}, f"{key}[{i}]", WHERE, PER_LINK[key], *BOUNDS[key]).tolist()
        for i, row in enumerate(rows)
    ]
    if key == "link_inertia_kg_m2":
        _require_inertias(read)
    return read


def _require_within(values: Sequence[float], published: Sequence[float | None], field: str) -> None:
    """Raises a `CellError` where a limit is beyond the published one, which can be lowered alone."""
    for i, (value, own) in enumerate(zip(values, published, strict=True)):
        if own is not None and abs(value) > abs(own):
            place = field if len(values) == 1 else f"{field}[{i}]"
            raise CellError(place, value, f"is beyond the published {own:g}")


def _require_layout(values: list[float], key: str) -> None:
    for i, (value, sign) in enumerate(zip(values, LAYOUT.get(key, ()), strict=key in LAYOUT)):
        if value * sign <= 0.0 and (sign or value):
            words = {0: "must be 0", 1: "must be above 0", -1: "must be below 0"}[sign]
            raise CellError(f"{WHERE}{key}[{i}]", value, f"{words}: the axes of every arm of Universal Robots lie so")


def _require_inertias(rows: list[list[float]]) -> None:
    """Raises a `CellError` where a tensor [xx, xy, xz, yy, yz, zz] is that of no body."""
    for i, (xx, xy, xz, yy, yz, zz) in enumerate(rows):
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
            reason = "is the inertia of no body: the largest principal moment is at most the sum of the other two"
            raise CellError(f"{WHERE}link_inertia_kg_m2[{i}]", rows[i], reason)


def _require_source(source: object) -> None:
    if not isinstance(source, str) or not source.strip() or len(source) > SOURCE_MAX:
        reason = f"must say where the numbers are from, in {SOURCE_MAX} characters at most"
        raise CellError(f"{WHERE}source", source, reason)
