"""Vectors, times and model settings shared by all schemas."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Joints = Annotated[list[float], Field(min_length=6, max_length=6)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
PerJoint = float | Joints


class RequestModel(BaseModel):
    """Base of request bodies: no unknown fields, no conversions, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class AnswerModel(BaseModel):
    """Base of response bodies. They document the responses; the JSON itself comes from planner and store."""


def iso_time(at: float | None) -> str | None:
    """Returns seconds since the epoch as UTC in ISO 8601 with milliseconds; None stays None."""
    if at is None:
        return None
    return datetime.fromtimestamp(at, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
