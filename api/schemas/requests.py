"""Request bodies of `POST /plan` and `POST /execute`, with their examples.

What a planning request may hold is stated in `planner.request`, which reads it too; its models here are derived from
that for OpenAPI, and read nothing.
"""

from __future__ import annotations

from functools import partial, reduce
from operator import or_
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, create_model

from planner.fields import (
    NUMBER_MAX,
    Choice,
    Flag,
    Kinds,
    ListOr,
    PerJoint,
    Record,
    RecordList,
    Shape,
    Text,
    Vector,
    Whole,
    Yes,
    YesOr,
)
from planner.fields import Number as NumberShape
from planner.request import PLAN_REQUEST, RETARGET_REQUEST, read_request

UUID_PATTERN = r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"
ID_PATTERN = f"^latest$|{UUID_PATTERN}"
Number = Annotated[float, Field(ge=-NUMBER_MAX, le=NUMBER_MAX)]
Joints = Annotated[list[Number], Field(min_length=6, max_length=6)]
Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]


class RequestModel(BaseModel):
    """Base of request bodies: no unknown fields, no conversions, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def _type_of(shape: Shape) -> Any:
    """Returns the type whose schema is that of a shape."""
    match shape:
        case Kinds(records):
            models = [model_of(shape.record(kind)) for kind in records]
            return Annotated[reduce(or_, models), Field(discriminator="kind")]
        case Record():
            return model_of(shape)
        case RecordList(record, least, most):
            return Annotated[list[model_of(record)], Field(min_length=least, max_length=most)]
    return _type_of_words(shape)


def _type_of_words(shape: Shape) -> Any:
    match shape:
        case Choice(values):
            return Literal[tuple(values)]
        case Text(most, least):
            return Annotated[str, Field(min_length=least or None, max_length=most)]
        case Yes():
            return Literal[True]
        case YesOr(most):
            return Literal[True] | Annotated[str, Field(min_length=1, max_length=most)]
        case Flag():
            return bool
    return _type_of_numbers(shape)


def _whole(value: Any) -> Any:
    """Returns a whole number that is written with a point, which JSON has as an integer, too; other values as given."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _type_of_numbers(shape: Shape) -> Any:
    match shape:
        case Whole(least, most):
            return Annotated[int, Field(ge=least, le=most), BeforeValidator(_whole)]
        case NumberShape(least, most, None):
            return Annotated[float, Field(ge=least, le=most)]
        case NumberShape(_, most, above):
            return Annotated[float, Field(gt=above, le=most)]
        case Vector(size):
            return Annotated[list[Number], Field(min_length=size, max_length=size)]
        case ListOr(listed, record):
            return _type_of(listed) | model_of(record)
        case PerJoint():
            return Number | Joints
    raise TypeError(shape)


def model_of(record: Record) -> Any:
    """Returns the model whose schema is that of a record."""
    fields: dict[str, Any] = {}
    for name, field in record.fields.items():
        kind = _type_of(field.shape)
        about = Field(description=field.text or None)
        if field.is_required:
            fields[name] = (Annotated[kind, about], ...)
        elif field.default is None:
            fields[name] = (Annotated[kind | None, about], None)
        else:
            fields[name] = (Annotated[kind, about], field.default)
    return create_model(record.name, __base__=RequestModel, __doc__=record.text, **fields)


PlanRequest = model_of(PLAN_REQUEST)
PlanRequestBody = Annotated[dict[str, Any], PlainValidator(read_request, json_schema_input_type=PlanRequest)]
RetargetRequest = model_of(RETARGET_REQUEST)
RetargetRequestBody = Annotated[
    dict[str, Any],
    PlainValidator(partial(read_request, record=RETARGET_REQUEST), json_schema_input_type=RetargetRequest),
]
# One of many, which is read with its place among them.
PlanRequestEntry = Annotated[Any, PlainValidator(lambda value: value, json_schema_input_type=PlanRequest)]


ExecutionMode = Literal["speedj", "servoj", "script"]
MODE_HELP = (
    "UR command by which the motion is streamed; `script`: it runs inside the controller, as one program, and neither "
    "a busy machine nor a bad link costs it a tick."
)


class ExecuteRequest(RequestModel):
    """One run of one plan."""

    plan_id: str = Field(
        description="Id of the plan; `latest` is the newest one, on simulated cells only.", pattern=ID_PATTERN
    )
    mode: ExecutionMode = Field("speedj", description=MODE_HELP)
    dry_run: bool = Field(False, description="true: everything except motion.")
    experiment_id: str | None = Field(
        None, description="Experiment that the execution belongs to.", pattern=UUID_PATTERN
    )


class ReplaceRequest(RequestModel):
    """The plan that a running execution is to go on with."""

    plan_id: str = Field(
        description="Id of a plan that begins on the running motion: its `start` names the execution, or has the state "
        "that it has at a tick. `latest` is the newest plan, on simulated cells only.",
        pattern=ID_PATTERN,
    )


_TARGET = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
_JOINT = {
    "release": {
        "kind": "joint",
        "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
        "velocities": [0.8, 0.6, -0.5, 0.3, 0.0, 0.0],
    },
    "limits": {"velocity": 2.5, "jerk": 400.0},
}
_POINT = {"release": {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.6]}, "backend": "ruckig"}

_SOONEST = {**_TARGET, "release_window_s": 0.0}
_ODDS = {**_TARGET, "landing_tolerance_m": 0.1, "min_hit_probability": 0.2}
_BIN = {
    "release": {
        "kind": "target",
        "position": [1.1, -0.3, 0.0],
        "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
    }
}

_BELT = {
    "release": {
        "kind": "target",
        "position": [1.1, -0.5, 0.0],
        "velocity": [0.0, 0.3, 0.0],
        "observed_at_s": 100.0,
        "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
    },
    "starts_not_before_s": 100.8,
}

_TRACKED = {
    "release": {
        "kind": "target",
        "position": {"target": "latest"},
        "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
    },
    "starts_not_before_s": 1.8,
}

_DOWN = {"linear": [0.0, 0.8, 0.0], "angular": [0.0, 0.0, 0.0]}
_PASSAGES = {
    "passages": [
        {
            "name": f"part {i}",
            "state": {
                "kind": "pose",
                "pose": {"position": [0.5, y, 0.35], "rotation_vector": [3.141592653589793, 0.0, 0.0]},
                "twist": _DOWN,
            },
            "outputs": [
                {"output": "standard_digital", "index": i, "level": True},
                {"output": "standard_digital", "index": i, "level": False, "offset_s": 0.02},
            ],
        }
        for i, y in enumerate((-0.12, 0.0, 0.12))
    ],
    "end": {"kind": "home"},
}

_PASSING = {
    "passages": [
        {
            "name": "picture",
            "state": {"kind": "point", "position": [0.5, 0.3, 0.5], "velocity": [0.0, -0.4, 0.0]},
            "outputs": [{"output": "standard_digital", "index": 2, "level": True}],
        },
        {"name": "throw", "state": _BELT["release"], "releases": True},
    ],
    "starts_not_before_s": 100.5,
}

_MOVING = {
    "start": {
        "positions": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
        "velocities": [0.3, 0.1, -0.2, 0.1, 0.0, 0.0],
        "accelerations": [1.0, 0.5, 0.0, 0.0, 0.0, 0.0],
    },
    **_TARGET,
}

_ENDS = [{"position": [0.5, y, 0.25], "rotation_vector": [3.141592653589793, 0.0, 0.0]} for y in (-0.2, 0.2)]
_LINE = {
    "passages": [
        {
            "name": "bead",
            "line": {"from": _ENDS[0], "to": _ENDS[1], "speed_m_s": 0.4},
            "outputs": [
                {"output": "standard_digital", "index": 3, "level": True, "offset_m": 0.02},
                {"output": "standard_digital", "index": 3, "level": False, "offset_m": 0.38},
            ],
        }
    ],
    "end": {"kind": "home"},
}

PLAN_EXAMPLES = {
    "target": {"summary": "Hit a point on the floor, whenever the gripper opens", "value": _TARGET},
    "soonest": {"summary": "Hit it as soon as possible", "value": _SOONEST},
    "odds": {"summary": "Hit within 10 cm, at odds of 1 in 5 at least", "value": _ODDS},
    "bin": {"summary": "Throw into a bin", "value": _BIN},
    "belt": {"summary": "Throw into a bin on a belt, seen at 100 s of the controller's time", "value": _BELT},
    "tracked": {"summary": "Throw into a bin that is tracked", "value": _TRACKED},
    "joint": {"summary": "Pass a joint state, with tighter limits", "value": _JOINT},
    "point": {"summary": "Release at a point with a velocity", "value": _POINT},
    "moving": {"summary": "Start in motion", "value": _MOVING},
    "passages": {"summary": "Trigger a camera over each of three parts in passing", "value": _PASSAGES},
    "passing": {"summary": "Take a picture in passing, then throw into a bin on a belt", "value": _PASSING},
    "line": {"summary": "Lay a bead along a straight line", "value": _LINE},
}
EXECUTE_EXAMPLES = {"latest": {"summary": "Execute the newest plan (simulated cell)", "value": {"plan_id": "latest"}}}
REPLACE_EXAMPLES = {"latest": {"summary": "Go on with the newest plan", "value": {"plan_id": "latest"}}}
RETARGET_EXAMPLES = {"target": {"summary": "Throw at another point", "value": _TARGET}}
