"""The tables `[gripper]` and `[outputs]` of a cell file: outputs, buses, snippets and calls, how the object is held."""

from __future__ import annotations

import math
import re
import urllib.parse
from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.cell.fields import choice, number, optional, placement, vector
from planner.cell.model import ControllerAddress, DigitalOutput, Gripper, MountedGripper
from planner.cell.thrown_object import OBJECT, ThrownBody, object_of
from planner.errors import CellError
from planner.grippers import (
    INPUT_LINES,
    KINDS,
    MODELS,
    NOT_SUPPORTED,
    OUTPUTS,
    PORTS,
    GripperLink,
    SecondOutput,
)
from planner.rotations import pose

WHERE = "gripper."
TOOL_MAX_M = 3.0  # [m] from the flange: no arm carries a longer tool, and most that are longer are in millimetres
Lines = Iterable[tuple[str, int]]
# [m/s^2] a grip that withstands less holds nothing, and one that withstands a thousand times gravity is not limited
HOLD_ACCELERATION_RANGE = 1e-3, 1e4
OUTPUT_DELAY_MAX_S = 0.5  # [s] of an output beyond the lag of motions; catches milliseconds
OUTPUT_JITTER_MAX_S = 0.1  # [s] of an output; catches milliseconds
OUTPUT: dict[str, Any] = {"output": None, "index": None, "delay_s": 0.0, "jitter_s": 0.0, "sense_input": None}
CLOSE_MAX_S = 10.0  # [s] for a gripper to close; catches milliseconds
BLOW_OFF_MAX_S = 10.0  # [s] of compressed air after a release; catches milliseconds
TEXT_MAX = 4000  # characters of a snippet; it is sent in one piece
OPEN_LEVEL = {"digital": True, "vacuum": False}  # of the first output: a vacuum is off
GRIPPER: dict[str, Any] = {
    "kind": "digital",
    "output": "tool_digital",
    "index": 0,
    "open_level": None,
    **{key: None for kind in KINDS.values() for key in kind.keys},  # None means that a key is absent
    "delay_s": 0.040,
    "jitter_s": 0.0,
    "opening_direction": None,
    "opening_cone_rad": None,
    "hold_acceleration_m_s2": None,
    "close_s": None,
    "grip_input": None,
}

DIRECTION_MAX = 1e6  # of an entry of a direction, whose length does not matter; beyond, it is no longer finite
OBJECTS_APART_M = 0.001  # [m] between two held objects: what touches the thrown one is no obstacle until it is clear
FURTHER_MAX = 3  # [-] grippers of a tool besides the cell's own
NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
HOLDS = ("delay_s", "jitter_s", "opening_direction", "opening_cone_rad", "hold_acceleration_m_s2")
FURTHER_GRIPPER: dict[str, Any] = {  # one that a single output opens
    **{key: GRIPPER[key] for key in ("open_level", *HOLDS)},
    "output": None,
    "index": None,
    "tcp_position_m": None,
    "tcp_rotation_vector_rad": [0.0, 0.0, 0.0],
    "object": OBJECT,
}


def further_grippers(
    tables: Mapping[str, dict[str, Any]], own: MountedGripper, controller: ControllerAddress, outputs: Lines
) -> dict[str, MountedGripper]:
    """Returns every gripper of a tool that has several, the cell's own first; none where the cell file has one.

    Args:
        tables: of the further ones, by name.
        own: the cell's own.
        controller: of the cell.
        outputs: kind and number of the outputs that the cell file lists.

    Raises:
        CellError: a field is refused, an output is of two of them, or what one holds is no ball.
    """
    if not tables:
        return {}
    _check_own(own, len(tables))
    found = {"": own}
    taken = [*outputs, (own.gripper.output, own.gripper.index)]
    if own.gripper.second is not None:
        taken.append((own.gripper.second.output, own.gripper.second.index))
    for name, table in tables.items():
        where = f"grippers.{name}."
        if not NAME_PATTERN.fullmatch(name):
            raise CellError("grippers", name, "a name must be letters, digits, '-' and '_', 32 at most")
        found[name] = _further(table, controller, where)
        line = (found[name].gripper.output, found[name].gripper.index)
        if line in taken:
            raise CellError(f"{where}index", line[1], f"is an output of kind {line[0]} that is in use already")
        taken.append(line)
    for (one, first), (other, second) in combinations(found.items(), 2):
        apart_m = float(np.linalg.norm(first.X_FT[:3, 3] - second.X_FT[:3, 3]))
        least_m = first.object.radius_m + second.object.radius_m + OBJECTS_APART_M
        if apart_m < least_m:
            what = f"is {apart_m:.4f} m from the tool centre point of {one or '[gripper]'!r}"
            gap = f"{1e3 * OBJECTS_APART_M:.0f} mm between"
            reason = f"{what}: with their objects' radii and {gap}, {least_m:.4f} m at least"
            raise CellError(f"grippers.{other}.tcp_position_m", second.X_FT[:3, 3].tolist(), reason)
    return found


def _check_own(own: MountedGripper, further: int) -> None:
    """Raises a `CellError` where the cell's own gripper has no `further` ones beside it."""
    if further > FURTHER_MAX:
        raise CellError("grippers", further, f"besides [gripper] there are {FURTHER_MAX} at most")
    if own.gripper.kind != "digital":
        raise CellError("gripper.kind", own.gripper.kind, 'must be "digital" beside [grippers]')
    if isinstance(own.object, ThrownBody):
        raise CellError("object.shape", own.object.kind, "must be a sphere beside [grippers]")


def _further(table: dict[str, Any], controller: ControllerAddress, where: str) -> MountedGripper:
    """Returns a further gripper; `where` its table is, its object too."""
    placed = ("tcp_position_m", "tcp_rotation_vector_rad")
    for key in ("output", "index", placed[0]):
        if table[key] is None:
            raise CellError(where + key, None, "is missing")
    keys = {key: value for key, value in table.items() if key not in (*placed, "object")}
    try:
        gripper = gripper_of({**GRIPPER, **keys}, controller)
    except CellError as error:
        raise CellError(error.field.replace(WHERE, where, 1), error.value, error.reason) from None
    try:
        thing, p_TO = object_of(table["object"])
    except CellError as error:
        raise CellError(where + error.field, error.value, error.reason) from None
    if isinstance(thing, ThrownBody):
        raise CellError(f"{where}object.shape", thing.kind, "must be a sphere in one of several grippers")
    table["open_level"] = gripper.open_level
    X_FT = placement(table, *placed, where, TOOL_MAX_M)
    return MountedGripper(gripper, read_only(X_FT @ pose(p_TO, np.eye(3))), thing)


def gripper_of(table: dict[str, Any], controller: ControllerAddress) -> Gripper:
    """Returns the gripper that the table describes; fills in the defaults that depend on its kind.

    Raises:
        CellError: a field is refused.
    """
    kind = _kind(table)
    if table["open_level"] is None:
        table["open_level"] = OPEN_LEVEL.get(kind, True)
    if not isinstance(table["open_level"], bool):
        raise CellError("gripper.open_level", table["open_level"], "must be true or false")
    output, index = _line(table, "output", "index")
    if table["close_s"] is None:
        table["close_s"] = KINDS[kind].close_s
    link = None if KINDS[kind].is_wired else _link(table, kind, controller)
    quantum_s = 0.0 if link is None else link.quantum_s
    return Gripper(
        output,
        index,
        table["open_level"],
        delay_s=number(table, "delay_s", WHERE, 0.0, 2.0),
        jitter_s=math.hypot(_jitter(table, kind), quantum_s / math.sqrt(12.0)),  # that of an even distribution
        kind=kind,
        second=_second(table, kind, (output, index)),
        link=link,
        opening_direction=_direction(table, "opening_direction"),
        opening_cone_rad=optional(table, "opening_cone_rad", WHERE, math.pi),
        hold_acceleration_m_s2=_hold_acceleration(table),
        close_s=number(table, "close_s", WHERE, 0.0, CLOSE_MAX_S),
        grip_input=None if table["grip_input"] is None else _whole(table, "grip_input", 0, INPUT_LINES - 1),
    )


def outputs_of(
    tables: Mapping[str, Mapping[str, Any]], lag_s: float, grip_input: int | None = None
) -> dict[str, DigitalOutput]:
    """Returns the further outputs that a cell file lists, by name.

    Args:
        tables: of the outputs.
        lag_s: the arm's lag [s]: an output may change up to so much sooner than a motion, at its command.
        grip_input: input that shows whether the gripper holds an object; None without one.

    Raises:
        CellError: a field is refused, or two names are of one output, or of one input.
    """
    found: dict[str, DigitalOutput] = {}
    for name, table in tables.items():
        where = f"outputs.{name}."
        line = _line(table, "output", "index", where)
        if any(line == (other.output, other.index) for other in found.values()):
            raise CellError(f"{where}index", line[1], f"is an output of kind {line[0]} that has another name already")
        sense = table["sense_input"]
        if sense is not None:
            sense = _whole(table, "sense_input", 0, INPUT_LINES - 1, where)
            if any(sense == other.sense_input for other in found.values()):
                raise CellError(f"{where}sense_input", sense, "is wired to another output already")
            if sense == grip_input:
                raise CellError("gripper.grip_input", sense, f"is wired to an output already ({where}sense_input)")
        delay_s = number(table, "delay_s", where, 0.0 - lag_s, OUTPUT_DELAY_MAX_S)
        found[name] = DigitalOutput(*line, delay_s, number(table, "jitter_s", where, 0.0, OUTPUT_JITTER_MAX_S), sense)
    return found


def _kind(table: Mapping[str, Any]) -> str:
    kind = table["kind"]
    if isinstance(kind, str) and kind in NOT_SUPPORTED:
        raise CellError("gripper.kind", kind, NOT_SUPPORTED[kind])
    kind = choice(table, "kind", WHERE, KINDS)
    for key in (key for other in KINDS.values() for key in other.keys if key not in KINDS[kind].keys):
        if table[key] is not None:
            of = " or ".join(f'"{name}"' for name, other in KINDS.items() if key in other.keys)
            raise CellError(WHERE + key, table[key], f'is a key of kind {of}, and the kind is "{kind}"')
    return kind


def _line(table: Mapping[str, Any], output: str, index: str, where: str = WHERE) -> tuple[str, int]:
    """Returns kind and number of a digital output."""
    kind = choice(table, output, where, OUTPUTS)
    return kind, _whole(table, index, 0, OUTPUTS[kind] - 1, where)


def _whole(table: Mapping[str, Any], key: str, lower: int, upper: int, where: str = WHERE) -> int:
    value = number(table, key, where, lower, upper)
    if value != int(value):
        raise CellError(where + key, value, "must be a whole number")
    return int(value)


def _second(table: Mapping[str, Any], kind: str, first: tuple[str, int]) -> SecondOutput | None:
    """Returns the output that closes the gripper, or that blows the object off; None without one."""
    if not KINDS[kind].is_wired:
        return None
    keys = KINDS[kind].keys
    missing = [key for key in keys if table[key] is None]
    if len(missing) == len(keys):
        return None
    if missing:
        raise CellError(WHERE + missing[0], None, f"is missing: {', '.join(keys[:-1])} and {keys[-1]} belong together")
    output, index, *_ = keys
    line = _line(table, output, index)
    if line == first:
        raise CellError(WHERE + output, line[0], "is the output that opens the gripper")
    blows = kind == "vacuum"
    lasts_s = number(table, "blow_off_s", WHERE, 1e-3, BLOW_OFF_MAX_S) if blows else None
    return SecondOutput(*line, open_level=blows, lasts_s=lasts_s)


def _jitter(table: Mapping[str, Any], kind: str) -> float:
    """Returns the stated standard deviation [s]; of a kind that nobody has timed it has to be stated."""
    jitter_s = number(table, "jitter_s", WHERE, 0.0, 0.5)
    if jitter_s == 0.0 and KINDS[kind].untimed:
        why = f'must be stated for kind "{kind}": {KINDS[kind].untimed}. `fling calibrate gripper` measures it'
        raise CellError("gripper.jitter_s", jitter_s, why)
    return jitter_s


def _link(table: dict[str, Any], kind: str, controller: ControllerAddress) -> GripperLink:
    if kind == "script":
        open_text, close_text = _texts(table, "script")
        return GripperLink(kind=kind, port=PORTS["secondary"], open_text=open_text, close_text=close_text)
    if kind == "http":
        return _http(table)
    return _bus(table, kind, controller)


def _texts(table: Mapping[str, Any], name: str) -> list[str]:
    """Returns what opens and what closes the gripper."""
    texts = []
    for does in ("open", "close"):
        text = table[f"{does}_{name}"]
        if not isinstance(text, str) or not text.strip():
            raise CellError(f"{WHERE}{does}_{name}", text, f"is missing: what {does}s the gripper")
        if len(text) > TEXT_MAX:
            raise CellError(f"{WHERE}{does}_{name}", f"{len(text)} characters", f"must be at most {TEXT_MAX} long")
        texts.append(text)
    return texts


def _http(table: Mapping[str, Any]) -> GripperLink:
    texts = _texts(table, "url")
    where = set()
    for does, text in zip(("open", "close"), texts, strict=True):
        field = f"{WHERE}{does}_url"
        try:
            parts = urllib.parse.urlsplit(text)
            port = parts.port or 80
        except ValueError as error:
            raise CellError(field, text, str(error)) from error
        if parts.scheme != "http" or not parts.hostname or not text.isascii() or not text.isprintable() or " " in text:
            why = "must be a URL that begins with http://, without blanks; encryption takes too long for a tick"
            raise CellError(field, text, why)
        where.add((parts.hostname, port))
    if len(where) > 1:
        raise CellError("gripper.close_url", texts[1], "must be of the same host and port as open_url")
    ((host, port),) = where
    return GripperLink(kind="http", host=host, port=port, open_text=texts[0], close_text=texts[1])


def _bus(table: dict[str, Any], kind: str, controller: ControllerAddress) -> GripperLink:
    name = choice(table, "model", WHERE, [name for name, model in MODELS.items() if model.kind == kind])
    model = MODELS[name]
    table["transport"] = table["transport"] or model.transports[0]
    transport = choice(table, "transport", WHERE, model.transports)
    if table["host"] is None and transport == "modbus_tcp" and controller.kind != "sim":
        why = "is missing: the address of the compute box, 192.168.1.1 as delivered"
        raise CellError("gripper.host", None, why)
    if table["host"] is not None and (not isinstance(table["host"], str) or not table["host"].strip()):
        raise CellError("gripper.host", table["host"], "must be a host name or address")
    defaults = {"port": PORTS[transport], "slave_id": model.slave_id, "open_width_m": model.stroke_m}
    for key, value in defaults.items():
        table[key] = value if table[key] is None else table[key]
    if model.stroke_m == 0.0 and table["open_width_m"] != 0.0:
        raise CellError("gripper.open_width_m", table["open_width_m"], f"a {name} has no fingers")
    return GripperLink(
        kind=kind,
        model=name,
        transport=transport,
        host=table["host"] or "",
        port=_whole(table, "port", 1, 65535),
        slave_id=_whole(table, "slave_id", 1, 247),
        stroke_m=model.stroke_m,
        open_width_m=number(table, "open_width_m", WHERE, 0.0 if model.stroke_m == 0.0 else 1e-3, model.stroke_m),
    )


def _direction(table: Mapping[str, Any], key: str) -> Array | None:
    """Returns a direction (3,) as a unit vector; None where it is absent."""
    if table[key] is None:
        return None
    direction = vector(table, key, WHERE, 3, -DIRECTION_MAX, DIRECTION_MAX)
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise CellError(WHERE + key, direction.tolist(), "must not be zero")
    return read_only(direction / length)


def _hold_acceleration(table: Mapping[str, Any]) -> Array | None:
    """Returns what the grip withstands: one number for any direction (1,), or one for each axis (3,) [m/s^2]."""
    key = "hold_acceleration_m_s2"
    if table[key] is None:
        return None
    if isinstance(table[key], list | tuple):
        return vector(table, key, WHERE, 3, *HOLD_ACCELERATION_RANGE)
    return read_only([number(table, key, WHERE, *HOLD_ACCELERATION_RANGE)])
