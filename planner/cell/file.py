"""Reading a cell file, and the calibration file that it names: from TOML to a checked `Cell`.

Keys and units are described in `docs/cells.md`. Numbers are kept as written, so that `GET /cells/{name}` answers them
unchanged, with the defaults filled in.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.calibration import CalibrationFile, parse_calibration
from planner.cell.arm_data import ARM_DATA, completed_arm
from planner.cell.fields import (
    TablesByName,
    choice,
    exactly,
    merge_defaults,
    number,
    placement,
    tables,
    vector,
)
from planner.cell.gripper import (
    FURTHER_GRIPPER,
    GRIPPER,
    OUTPUT,
    TOOL_MAX_M,
    further_grippers,
    gripper_of,
    outputs_of,
)
from planner.cell.keep_out import contacts, keep_in_shapes, keep_out_shapes, tool_shapes
from planner.cell.limits import LIMITS, SAFETY_LIMITS, limits_of, safety_of
from planner.cell.model import (
    FARTHEST_M,
    FLIGHT_CLEARANCE_MIN_M,
    Cell,
    ControllerAddress,
    MountedGripper,
    Sim,
    Surroundings,
    Timing,
    Tool,
    ToolCapsule,
    balls,
    carried_by,
)
from planner.cell.source import CellSource, calibration_name, read_source
from planner.cell.thrown_object import OBJECT, object_of
from planner.documents import NotToml, parse_toml
from planner.errors import CellError
from planner.robots import Robot
from planner.rotations import pose

NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")  # a cell's name is part of URLs and file names
SERIAL_PATTERN = re.compile(r"[A-Za-z0-9]{1,64}")  # a robot's serial number, as its dashboard tells it

# Values of the keys that a cell file leaves out; None: required, taken from the arm, or not limited.
DEFAULTS: dict[str, Any] = {
    "robot": None,
    "arm_data": ARM_DATA,
    "home_rad": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
    "kinematics": {"calibration": None},
    "base_in_world": {"position_m": [0.0, 0.0, 0.0], "rotation_vector_rad": [0.0, 0.0, 0.0]},
    "tool": {
        "tcp_position_m": [0.0, 0.0, 0.0],
        "tcp_rotation_vector_rad": [0.0, 0.0, 0.0],
        "mass_kg": 0.0,
        "capsules": [],
        "shapes": [],
    },
    "limits": LIMITS,
    "surroundings": {
        "floor_z_m": 0.0,
        "clearance_m": 0.02,
        "flight_clearance_m": None,
        "gravity_m_s2": 9.81,
        "keep_in": [],
        "keep_out": [],
        "may_touch": [],
    },
    "object": OBJECT,
    "gripper": GRIPPER,
    "grippers": TablesByName(FURTHER_GRIPPER),
    "outputs": TablesByName(OUTPUT),
    "safety": dict.fromkeys(SAFETY_LIMITS),
    "timing": {"lag_s": 0.0},
    "link": {"kind": None, "host": "127.0.0.1", "serial": None},
    "sim": {
        "polyscope": None,
        "lag_s": 0.020,
        "gripper_delay_s": 0.040,
        "gripper_jitter_s": 0.0,
        "landing_height_m": 0.0,
        "seed": 0,
    },
}

POLYSCOPE = {"CB3": "3.15", "e-Series": "5.11.1"}  # default versions of the simulated controller
POLYSCOPE_X = "10.14.0"  # chosen: what a simulated controller presents that is asked for "x"
GRAVITY_RANGE = 1.0, 30.0  # [m/s^2] from below the Moon's, 1.62: without any, no flight comes down
TOOL_RADIUS_MIN_M = 1e-3  # [m] a thinner tool is a line, and nothing is that thin


def load_cell(path: Path | str) -> Cell:
    """Returns the cell of a TOML file; its name is the file's stem.

    Raises:
        CellError: a file cannot be read, or a field of it is refused.
    """
    return cell_of(read_source(path))


def parse_cell(text: bytes | str, name: str, calibration: bytes | None = None) -> Cell:
    """Returns the cell described by `text` (TOML) and by the calibration file that it names, if it names one.

    Raises:
        CellError: see `cell_of`.
    """
    return cell_of(CellSource(name, text.encode() if isinstance(text, str) else text, calibration))


def cell_of(source: CellSource, published: bool = False) -> Cell:
    """Returns the cell of a source.

    Args:
        source: what it is read from.
        published: whether the arm has the published table, whatever calibration file the cell names.

    Raises:
        CellError: the text is not TOML, or a field is refused: an unknown key, a number that is not finite, a limit
            beyond the arm's own, a calibration file that is missing or of another model.
    """
    return cell_of_document(toml_of(source), source, published)


def toml_of(source: CellSource) -> dict[str, Any]:
    """Returns the keys of a cell file, unchecked.

    Raises:
        CellError: the text is not TOML.
    """
    try:
        return parse_toml(source.text)
    except NotToml as error:
        raise CellError("file", source.name, str(error)) from error


def cell_of_document(given: Mapping[str, Any], source: CellSource, published: bool = False) -> Cell:
    """Returns the cell that the keys of a cell file describe, see `cell_of`.

    Raises:
        CellError: a field is refused.
    """
    if not NAME_PATTERN.fullmatch(source.name):
        raise CellError("name", source.name, "must be letters, digits, '-' and '_', 64 at most")
    document = merge_defaults(given, DEFAULTS)
    if published:
        document["kinematics"] = DEFAULTS["kinematics"]
    return _cell(document, source)


def _cell(document: dict[str, Any], source: CellSource) -> Cell:
    (calibration, arm) = _robot(document, source.calibration)
    safety = safety_of(document["safety"])
    limits = limits_of(document["limits"], arm)
    if safety.tool_speed_m_s is not None:
        limits = replace(limits, tcp_speed_max=min(limits.tcp_speed_max, safety.tool_speed_m_s))
    home = vector(document, "home_rad", "", 6)
    for i in range(6):
        if not limits.q_lower[i] <= home[i] <= limits.q_upper[i]:
            bounds = f"[{limits.q_lower[i]:.6g}, {limits.q_upper[i]:.6g}]"
            raise CellError(f"home_rad[{i}]", float(home[i]), f"is outside the joint's limits {bounds}")
    thing, p_TO = object_of(document["object"], source.meshes)
    tool = _tool(document["tool"], p_TO, source.meshes)
    controller = _link(document["link"])
    gripper = gripper_of(document["gripper"], controller)
    lag_s = number(document["timing"], "lag_s", "timing.", 0.0, 0.5)
    outputs = outputs_of(document["outputs"], lag_s, gripper.grip_input)
    lines = [(each.output, each.index) for each in outputs.values()]
    own = MountedGripper(gripper, tool.X_FT, thing)
    grippers = further_grippers(document["grippers"], own, controller, lines)
    if grippers and not tool.capsules:
        raise CellError("tool.capsules", None, "are missing: nobody knows the shape of a tool with several grippers")
    carried = carried_by(grippers, set(grippers) - {""})
    tool = replace(tool, capsules=(*tool.capsules, *balls(carried)))
    X_WB = placement(document["base_in_world"], "position_m", "rotation_vector_rad", "base_in_world.", FARTHEST_M)
    return Cell(
        name=source.name,
        sha256=source.sha256,
        robot=arm,
        calibration=calibration,
        home=home,
        X_WB=X_WB,
        tool=tool,
        limits=limits,
        surroundings=_surroundings(document["surroundings"], X_WB[:3, 3], source.meshes, arm, tool),
        object=thing,
        gripper=gripper,
        grippers=grippers,
        carried=carried,
        safety=safety,
        timing=Timing(lag_s),
        link=controller,
        sim=_sim(document["sim"], arm),
        outputs=outputs,
        document=document,
        meshes=source.meshes,
    )


def _robot(document: Mapping[str, Any], calibration: bytes | None) -> tuple[CalibrationFile | None, Robot]:
    """Returns the calibration file and the arm with its chain; without a file, None and the arm as it is published."""
    published = completed_arm(document)
    name = calibration_name(document)
    if name is None:
        return None, published
    if calibration is None:
        made = "" if document["link"]["kind"] == "sim" else ", or let `fling cell kinematics --from-robot` make it"
        raise CellError("kinematics.calibration", name, f"cannot be read: put it beside the cell file{made}")
    return parse_calibration(calibration, name, published)


def _tool(table: Mapping[str, Any], p_TO: Array, meshes: bytes | None) -> Tool:
    """Returns the tool; its centre point is where the object's centre lies, `p_TO` (3,) [m] from where it is given."""
    capsules = []
    for i, entry in enumerate(tables(table["capsules"], "tool.capsules")):
        where = f"tool.capsules[{i}]."
        entry = exactly(entry, ("from_m", "to_m", "radius_m"), where)
        ends = (vector(entry, end, where, 3, -TOOL_MAX_M, TOOL_MAX_M) for end in ("from_m", "to_m"))
        capsules.append(ToolCapsule(*ends, radius_m=number(entry, "radius_m", where, TOOL_RADIUS_MIN_M, 1.0)))
    for i, shape in enumerate(tool_shapes(table, meshes)):
        reach_m = max(float(np.abs([c.from_m, c.to_m]).max()) for c in shape.capsules)
        if reach_m > TOOL_MAX_M:
            reason = f"the {shape.kind} is {reach_m:.6g} m from the flange, more than {TOOL_MAX_M:g} m"
            raise CellError(f"tool.shapes[{i}].pose", table["shapes"][i].get("pose"), reason)
        capsules += shape.capsules
    X_FT = placement(table, "tcp_position_m", "tcp_rotation_vector_rad", "tool.", TOOL_MAX_M)
    mass_kg = number(table, "mass_kg", "tool.", 0.0)
    if not p_TO.any():
        return Tool(X_FT, mass_kg, tuple(capsules))
    return Tool(read_only(X_FT @ pose(p_TO, np.eye(3))), mass_kg, tuple(capsules), p_FH=X_FT[:3, 3])


def _surroundings(table: dict[str, Any], base: Array, meshes: bytes | None, arm: Robot, tool: Tool) -> Surroundings:
    where = "surroundings."
    clearance_m = number(table, "clearance_m", where, 0.0, 1.0)
    if table["flight_clearance_m"] is None:
        table["flight_clearance_m"] = max(clearance_m, FLIGHT_CLEARANCE_MIN_M)
    keep_in = keep_in_shapes(table, base, meshes)
    keep_out, bodies = keep_out_shapes(table, meshes)
    return Surroundings(
        floor_z_m=number(table, "floor_z_m", where),
        clearance_m=clearance_m,
        flight_clearance_m=number(table, "flight_clearance_m", where, FLIGHT_CLEARANCE_MIN_M, 1.0),
        gravity_m_s2=number(table, "gravity_m_s2", where, *GRAVITY_RANGE),
        keep_in=keep_in,
        keep_out=keep_out,
        may_touch=contacts(table, arm, max(1, len(tool.capsules)), bodies),
    )


def _link(table: Mapping[str, Any]) -> ControllerAddress:
    if table["kind"] is None:
        raise CellError("link.kind", None, 'must be written down: "sim" or "ur"')
    kind = choice(table, "kind", "link.", ("sim", "ur"))
    if not isinstance(table["host"], str) or not table["host"].strip():
        raise CellError("link.host", table["host"], "must be a host name or address")
    serial = table["serial"]
    if serial is not None and not (isinstance(serial, str) and SERIAL_PATTERN.fullmatch(serial)):
        raise CellError("link.serial", serial, "must be a serial number in quotes: letters and digits, 64 at most")
    return ControllerAddress(kind, table["host"], serial)


def checked_polyscope(polyscope: Any, arm: Robot) -> str:
    """Returns a version of PolyScope that a simulated controller of an arm may present.

    Raises:
        CellError: it is no version, or does not run on this arm.
    """
    if isinstance(polyscope, str) and polyscope.lower() == "x":
        polyscope = POLYSCOPE_X
    if not isinstance(polyscope, str) or not re.fullmatch(r"\d+\.\d+(\.\d+)?", polyscope):
        raise CellError("sim.polyscope", polyscope, 'must be a version such as "5.11.1", or "x" for PolyScope X')
    if (int(polyscope.split(".")[0]) <= 3) != (arm.generation == "CB3"):
        raise CellError("sim.polyscope", polyscope, f"does not run on a {arm.generation} arm")
    return polyscope


def _sim(table: dict[str, Any], arm: Robot) -> Sim:
    if table["polyscope"] is None:
        table["polyscope"] = POLYSCOPE[arm.generation]
    return Sim(
        polyscope=checked_polyscope(table["polyscope"], arm),
        lag_s=number(table, "lag_s", "sim.", 0.0, 0.5),
        gripper_delay_s=number(table, "gripper_delay_s", "sim.", 0.0, 2.0),
        gripper_jitter_s=number(table, "gripper_jitter_s", "sim.", 0.0, 0.5),
        landing_height_m=number(table, "landing_height_m", "sim."),
        seed=int(number(table, "seed", "sim.", 0, 2**31 - 1)),
    )
