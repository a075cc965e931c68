"""Bodies of `/cells/{name}/targets`: targets that are observed again and again."""

from __future__ import annotations

from pydantic import BaseModel, Field, model_validator

from api.schemas.requests import RequestModel, Vector3
from planner.releases import UPTIME_MAX_S
from planner.releases.target import DRIFT_MAX_M_S, TARGET_SPEED_MAX_M_S
from planner.tracking import DRIFT_M_S

STD_MIN = 1e-6  # [m, m/s] nothing is measured better
STD_MAX_M = 10.0  # [m] an observation this vague says nothing


class ObservationRequest(RequestModel):
    """Where a target was seen at an instant, and its velocity where an encoder tells it."""

    position: Vector3 = Field(description="In the world [m], within 100 m of the arm.")
    std_m: float = Field(ge=STD_MIN, le=STD_MAX_M, description="Standard deviation along each axis [m].")
    observed_at_s: float = Field(
        ge=0.0, le=UPTIME_MAX_S, description="When, on the controller's clock (RTDE `timestamp`) [s]."
    )
    velocity: Vector3 | None = Field(None, description="In the world [m/s]; level.")
    velocity_std_m_s: float | None = Field(
        None, ge=STD_MIN, le=TARGET_SPEED_MAX_M_S, description="Its standard deviation along each axis [m/s]."
    )

    @model_validator(mode="after")
    def _both(self) -> ObservationRequest:
        if (self.velocity is None) != (self.velocity_std_m_s is None):
            raise ValueError("velocity and velocity_std_m_s belong together")
        return self


class TrackedTargetRequest(ObservationRequest):
    """The first observation of a target."""

    drift_m_s: float = Field(
        DRIFT_M_S, ge=0.0, le=DRIFT_MAX_M_S, description="Standard deviation that its velocity gains in a second [m/s]."
    )


class UncertaintyAnswer(BaseModel):
    """How well place and velocity are known at the last observation, along each horizontal axis."""

    position_std_m: float = Field(description="Standard deviation of the place [m].")
    velocity_std_m_s: float = Field(description="Of the velocity [m/s]; 5: it is not known.")
    correlation: float = Field(description="Of the two [-].")
    drift_m_s: float = Field(description="Standard deviation that the velocity gains in a second [m/s].")


class TrackedTargetAnswer(BaseModel):
    """A tracked target as of its last observation."""

    id: str
    cell: str
    created_at: str = Field(description="UTC, ISO 8601.")
    created_by: str = Field(description="Owner of the token.")
    position: Vector3 = Field(description="In the world [m].")
    velocity: Vector3 = Field(description="In the world [m/s].")
    uncertainty: UncertaintyAnswer
    height_std_m: float = Field(description="Standard deviation of the height [m].")
    observed_at_s: float = Field(description="On the controller's clock [s].")
    observations: int = Field(description="Number of observations.")
    chi_square: float | None = Field(
        description="Squared distance of the last observation from what was predicted, in standard deviations [-]; "
        "null of the first."
    )
    chi_square_max: float | None = Field(description="The largest that would have been taken [-].")


class TrackedTargetList(BaseModel):
    """The tracked targets of a cell, newest first."""

    cell: str
    targets: list[TrackedTargetAnswer]


# Soon after a controller's start: what is ahead of its clock is refused.
_SEEN = {"position": [1.1, -0.5, 0.0], "std_m": 0.003, "observed_at_s": 1.0}
TARGET_EXAMPLES = {
    "camera": {"summary": "Seen by a camera, to 3 mm", "value": _SEEN},
    "encoder": {
        "summary": "On a belt whose encoder tells its velocity",
        "value": {**_SEEN, "velocity": [0.0, 0.3, 0.0], "velocity_std_m_s": 0.003},
    },
}
OBSERVATION_EXAMPLES = {
    "camera": {
        "summary": "Seen again, a thirtieth of a second later",
        "value": {"position": [1.1, -0.49, 0.0], "std_m": 0.003, "observed_at_s": 1.0333},
    }
}
