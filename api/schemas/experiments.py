"""Bodies of `/experiments`: series of throws and their statistics."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from api.schemas.requests import RequestModel, Vector3

Offset = Annotated[list[float], Field(min_length=2, max_length=2)]


class ExperimentRequest(RequestModel):
    """A new experiment; its executions name it as `experiment_id`."""

    name: str = Field("", max_length=200, description="For people.")
    settings: dict[str, Any] = Field(
        default_factory=dict, description="Kept as it is: targets, repetitions, whatever belongs to the record."
    )


class ExperimentHead(BaseModel):
    """An experiment without its throws."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    name: str
    created_by: str
    settings: dict[str, Any]


class ExperimentList(BaseModel):
    """A page of experiments, newest first."""

    experiments: list[ExperimentHead]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


class ExperimentThrow(BaseModel):
    """One throw of an experiment."""

    execution_id: str
    plan_id: str
    state: str
    outcome: str | None
    reason: str | None
    target: Vector3 | None = Field(description="null for releases without a target [m].")
    landing: Vector3 | None = Field(description="Mean of the observed positions, by their certainty [m].")
    error_m: float | None = Field(description="Horizontal distance of the landing from the target [m].")
    results: list[str] = Field(description="hit, edge, miss as they were reported.")


class LandingStatistics(BaseModel):
    """Mean and spread of the landings about their targets."""

    throws: int
    outcomes: dict[str, int] = Field(description="Throws by outcome; unfinished ones by their state.")
    landed: int = Field(description="Throws with a target and an observed position.")
    mean_error_m: Offset | None = Field(description="Mean of landing less target, x and y in the world [m].")
    covariance_m2: list[Offset] | None = Field(description="Of the same; null below two landings [m^2].")
    median_distance_m: float | None = Field(description="Median distance of landing and target [m].")
    largest_distance_m: float | None = Field(description="[m]")
    results: dict[str, int] = Field(description="Reports of hit, edge and miss.")


class TargetStatistics(LandingStatistics):
    """The same for one target."""

    target: Vector3 | None = Field(description="[m]")


class ExperimentAnswer(ExperimentHead):
    """An experiment with its throws so far, and their statistics."""

    throws: list[ExperimentThrow]
    statistics: LandingStatistics
    targets: list[TargetStatistics]


EXPERIMENT_EXAMPLES = {
    "series": {"summary": "A series of throws", "value": {"name": "new fingers", "settings": {"repeat": 10}}}
}
