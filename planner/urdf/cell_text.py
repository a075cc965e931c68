"""The cell file that says what a URDF file says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.calibration import calibration_text, table_of
from planner.cell import DEFAULTS, Cell, CellSource, cell_of
from planner.documents import read_file, toml_text
from planner.errors import CellError, FileRefused
from planner.robots import Robot
from planner.rotations import invert_pose, matrix_to_rotation_vector
from planner.scenes import entries_of, with_entries
from planner.urdf.arm import DescribedArm, arm_in
from planner.urdf.surroundings import URDF_BYTES, notes_on_shapes, shapes_around
from planner.urdf.tree import UrdfRefused, UrdfTree, parse_urdf

ROUNDING = 1e-6  # [-] relative difference of limits that is the rounding of a file
DIGITS = 12  # decimals of a number in a cell file
TORQUE_FRACTION = 0.9  # [-] of a cell file's torques by default


@dataclass(frozen=True)
class WrittenCell:
    """A cell file, and the calibration file beside it.

    Attributes:
        cell: that they are read as.
        text: of the cell file.
        calibration: name and text of the calibration file; None where the chain is the published one.
        notes: what a person should know, in sentences.
    """

    cell: Cell
    text: str
    calibration: tuple[str, str] | None
    notes: Sequence[str]


def cell_from_urdf(path: Path | str, name: str, model: str | None = None, tcp: str | None = None) -> WrittenCell:
    """Returns the cell that a URDF file describes: a simulated one, for somebody to add the controller's address.

    The root of the file is the world. Links below the flange are the tool, whose joints stay at 0; boxes around the
    arm are kept out of.

    Args:
        path: of the URDF file.
        name: of the cell.
        model: name of the arm's model; None: the closest one.
        tcp: link whose origin is the tool centre point; None: the only one that ends the tool, or the flange.

    Raises:
        FileRefused: the file cannot be read, or does not describe an arm of Universal Robots; the reason says what
            does not fit.
    """
    text = read_file(path, URDF_BYTES)
    try:
        tree = parse_urdf(text)
        arm = arm_in(tree, model)
        return _written(tree, arm, name, tcp, Path(path).name)
    except UrdfRefused as error:
        raise FileRefused(path, str(error)) from error
    except CellError as error:
        raise FileRefused(path, f"describes a cell that is refused: {error}") from error


def _written(tree: UrdfTree, arm: DescribedArm, name: str, tcp: str | None, file: str) -> WrittenCell:
    limits, notes_on_limits = _limits(arm)
    tool, notes_on_tool = _tool(tree, arm, tcp)
    file = file.encode(errors="replace").decode()  # a name may hold bytes that are no text
    calibration = None
    if arm.robot.fixed is not None:
        calibration = f"{name}-kinematics.yaml", calibration_text(arm.robot.fixed, _hash(arm.robot))
    tables = {
        "arm_data": {**arm.numbers, "source": f"URDF file {file}"} if arm.numbers else {},
        "kinematics": {} if calibration is None else {"calibration": calibration[0]},
        "base_in_world": _pose(arm.X_RB, "position_m", "rotation_vector_rad"),
        "tool": tool,
        "limits": limits,
        "surroundings": {"floor_z_m": 0.0},
        "timing": {"lag_s": DEFAULTS["sim"]["lag_s"]},
        "link": {"kind": "sim", "host": "127.0.0.1"},
    }
    around = shapes_around(tree, arm.joints)
    lines = [f"# From the URDF file {toml_text(file)}.", f'robot = "{arm.robot.name}"']
    for key, table in tables.items():
        if table:
            lines += ["", f"[{key}]", *(f"{entry} = {toml_text(value)}" for entry, value in table.items())]
    text = "\n".join([*lines, ""])
    if around.shapes:
        text = with_entries(text, entries_of(around.shapes, [""] * len(around.shapes), ()), "the same file")
    cell = cell_of(CellSource(name, text.encode(), None if calibration is None else calibration[1].encode()))
    notes = [*arm.notes, *notes_on_limits, *notes_on_tool, *notes_on_shapes(around), *_notes_on_floor(tree, cell)]
    return WrittenCell(cell, text, calibration, notes)


def _notes_on_floor(tree: UrdfTree, cell: Cell) -> list[str]:
    """Returns a note where the arm does not stand on the floor, of which a URDF file says nothing."""
    height_m = round(float(cell.X_WB[2, 3]), 3)
    if height_m == 0.0:
        return []
    where = f"{abs(height_m):g} m {'below' if height_m > 0.0 else 'above'} the arm's base"
    return [f"the floor is taken to be at z = 0 of {tree.root}, {where}: surroundings.floor_z_m is its height"]


def _limits(arm: DescribedArm) -> tuple[dict[str, Any], list[str]]:
    """Returns the limits that are tighter than the arm's own, and notes on those that are wider."""
    own = arm.robot.published
    columns = {
        "joint_position_lower_rad": ([j.lower for j in arm.joints], own.q_lower, -1.0),
        "joint_position_upper_rad": ([j.upper for j in arm.joints], own.q_upper, 1.0),
        "joint_velocity_rad_s": ([j.velocity or None for j in arm.joints], own.qd_max, 1.0),
        "joint_torque_n_m": ([j.effort or None for j in arm.joints], own.tau_max, 1.0),
    }
    found: dict[str, Any] = {}
    notes = []
    for key, (given, bound, side) in columns.items():
        values = np.array([b if g is None else g for g, b in zip(given, bound, strict=True)])
        beyond = side * (values - bound) > ROUNDING * np.abs(bound)
        if beyond.any():
            notes.append(
                f"its {key} of {own.joint_names[int(beyond.argmax())]} is wider than the arm's: the arm's is kept"
            )
        kept = np.where(side * (values - bound) < 0.0, values, bound)
        if not (np.abs(kept - bound) > ROUNDING * np.abs(bound)).any():
            continue
        if key == "joint_torque_n_m":
            fraction = float(min(TORQUE_FRACTION, (kept / bound).min()))
            found["joint_torque_fraction"] = round(fraction, 6)
            notes.append(f"its joint torques are lower than the arm's: all are limited to {fraction:.2g} of these")
        else:
            found[key] = kept.tolist()  # exact: a limit that is rounded up is beyond the arm's own
    return found, notes


def _tool(tree: UrdfTree, arm: DescribedArm, tcp: str | None) -> tuple[dict[str, Any], list[str]]:
    """Returns the table of the tool: the links below the last joint."""
    last = arm.joints[5].child
    below = tree.below(last)
    beyond = [link for link in below if link != last]
    if tcp is not None and tcp not in below:
        raise UrdfRefused(f"has no link {tcp} below {last}; there are {', '.join(beyond) or 'none'}")
    X_RF = arm.X_RF
    ends = [link for link in beyond if not any(j.parent == link for j in tree.joints.values())]
    ends = [link for link in ends if not np.allclose(tree.pose(link)[:3, 3], X_RF[:3, 3], atol=1e-9)]
    notes = []
    if tcp is None and len(ends) == 1:
        tcp = ends[0]
    elif tcp is None and ends:
        notes.append(
            f"its tool has several ends ({', '.join(ends)}): the tool centre point is on the flange; see --tcp"
        )
    X_FT = np.eye(4) if tcp is None else invert_pose(X_RF) @ tree.pose(tcp)
    mass = sum(body.mass for link in beyond if (body := tree.bodies[link]) is not None)
    moving = [tree.joints[link].name for link in beyond if tree.joints[link].moves]
    if moving:
        notes.append(f"joints of its tool count as fixed at 0: {', '.join(moving)}")
    table = _pose(X_FT, "tcp_position_m", "tcp_rotation_vector_rad")
    if mass > 0.0:
        table["mass_kg"] = round(mass, DIGITS)
    if mass > 0.0 or tcp is not None:
        notes.append("the tool's shape is not taken over: tool.capsules takes it")
    return table, notes


def _hash(robot: Robot) -> str:
    """Returns the driver's name of a measured arm; one whose flange no table holds has none."""
    try:
        return table_of(robot).hash
    except ValueError:
        return "none"


def _pose(X: Array, position: str, rotation: str) -> dict[str, Any]:
    return {position: _numbers(X[:3, 3]), rotation: _numbers(matrix_to_rotation_vector(X[:3, :3]))}


def _numbers(x: Array) -> list[float]:
    return [round(float(value), DIGITS) + 0.0 for value in x]
