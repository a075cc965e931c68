"""Vectors and rules shared by every model."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Joints = Annotated[list[float], Field(min_length=6, max_length=6)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
PerJoint = float | Joints


class Question(BaseModel):
    """What a client sends: no unknown field, no conversion, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Answer(BaseModel):
    """What the service sends; the models describe it, the bytes are made elsewhere."""
