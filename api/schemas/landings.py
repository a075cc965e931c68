"""Bodies of `/executions/{id}/landing`: where an object landed, or whether it hit."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field, model_validator

from api.schemas.requests import RequestModel, Vector3

SOURCE_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
STD_MAX_M = 10.0  # [m] an observation this vague says nothing


class LandingRequest(RequestModel):
    """One observation: a position with its standard deviation, or a result for a target of a radius."""

    position: Vector3 | None = Field(
        None, description="Where the object landed, in the world [m], within 100 m of the arm."
    )
    std_m: float | None = Field(
        None, ge=0.0, le=STD_MAX_M, description="Standard deviation of the position, along each axis [m]."
    )
    result: Literal["hit", "edge", "miss"] | None = Field(
        None, description="Whether it landed within `radius_m` of the target, on the edge, or beyond."
    )
    radius_m: float | None = Field(None, gt=0.0, le=STD_MAX_M, description="Radius that the result is about [m].")
    source: str = Field("person", pattern=SOURCE_PATTERN, description="What observed it: `person`, or a camera's name.")

    @model_validator(mode="after")
    def _one_of_two(self) -> LandingRequest:
        place = (self.position, self.std_m)
        judged = (self.result, self.radius_m)
        if (None in place or judged != (None, None)) and (None in judged or place != (None, None)):
            raise ValueError("give either position and std_m, or result and radius_m")
        return self


class LandingAnswer(BaseModel):
    """One observation of a landing; it is never changed, but may be withdrawn."""

    id: str
    execution_id: str
    at: str = Field(description="Time of the report, UTC, ISO 8601.")
    source: str = Field(description="`person`, `sim-camera` (a simulated cell's), or a client's name for its camera.")
    reported_by: str = Field(description="Owner of the token; empty for `sim-camera`.")
    position: Vector3 | None = Field(description="In the world [m].")
    std_m: float | None = Field(description="Standard deviation along each axis [m]; 0: exact.")
    result: str | None = Field(description="hit, edge or miss.")
    radius_m: float | None = Field(description="Radius that the result is about [m].")
    withdrawn_at: str | None = Field(None, description="UTC, ISO 8601; null: it counts.")
    withdrawn_by: str | None = Field(None, description="Owner of the token.")


class LandingList(BaseModel):
    """All observations of one throw, oldest first."""

    execution_id: str
    landings: list[LandingAnswer]


LANDING_EXAMPLES = {
    "measured": {"summary": "Measured, to 5 mm", "value": {"position": [1.21, 0.29, 0.0], "std_m": 0.005}},
    "camera": {
        "summary": "Observed by a camera",
        "value": {"position": [1.21, 0.29, 0.0], "std_m": 0.003, "source": "ceiling-camera"},
    },
    "miss": {"summary": "It missed the target's 10 cm", "value": {"result": "miss", "radius_m": 0.1}},
}
