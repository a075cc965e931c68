"""Bodies of `/batches`: many planning requests at once, their progress and their results."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, Field, field_validator, model_validator

from api.schemas.requests import PLAN_EXAMPLES, Number, PlanRequestEntry, RequestModel
from jobs.batches import check_axes


class AxisValues(RequestModel):
    """The values of one field of a grid, each as in a request."""

    values: list[Any] = Field(min_length=1, description="At least one.")


AxisRange = Annotated[list[Number], Field(min_length=3, max_length=3, description="[from, to, step]")]


class BatchRequest(RequestModel):
    """Many planning requests: a list, or a template with a grid."""

    requests: list[PlanRequestEntry] | None = Field(None, min_length=1, description="As for `POST /plan`, one by one.")
    template: dict[str, Any] | None = Field(
        None, description="A request as for `POST /plan`, in which the fields of `grid` may be absent."
    )
    grid: dict[str, AxisRange | AxisValues] | None = Field(
        None,
        min_length=1,
        description="Values by field, such as `release.position[0]`: `[from, to, step]`, both ends included, or "
        '`{"values": […]}`. The requests are all combinations; the last field changes fastest.',
    )

    @field_validator("grid", mode="before")
    @classmethod
    def _axes(cls, grid: Any) -> Any:
        """Names a wrong axis by its path: the errors of a union name its branches."""
        if isinstance(grid, Mapping):
            check_axes(grid)
        return grid

    @model_validator(mode="after")
    def _one_of_two(self) -> BatchRequest:
        is_grid = self.template is not None and self.grid is not None
        if (self.requests is None) != is_grid or (self.requests is not None and (self.template or self.grid)):
            raise ValueError("give either requests, or template and grid")
        return self


class BatchAnswer(BaseModel):
    """A batch and its progress."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    created_by: str
    state: str = Field(description="queued, running or finished.")
    outcome: str | None = Field(description="completed, cancelled or failed, once it is finished.")
    reason: str | None = Field(description="Why it failed.")
    total: int = Field(description="Number of requests.")
    done: int = Field(description="Number of results so far.")
    counts: dict[str, int] = Field(description="Results by outcome: `planned`, or the type of the problem.")
    rate_per_s: float | None = Field(description="Results per second since the batch was last taken up [1/s].")
    time_left_s: float | None = Field(description="At this rate [s].")
    cancel_requested: bool
    started_at: str | None = Field(description="When it was last taken up. UTC, ISO 8601.")
    finished_at: str | None


class BatchList(BaseModel):
    """A page of batches, newest first."""

    batches: list[BatchAnswer]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


class BatchResult(BaseModel):
    """The result of one request: its plan, or the reason why there is none."""

    number: int = Field(description="Of the request, counted from 0 in the order of list or grid.")
    parameters: dict[str, float | str] = Field(
        description="Values of the grid's axes, by path; an axis with other values than numbers has texts: "
        "strings as they are and the rest as JSON. Empty for a list."
    )
    outcome: str = Field(description="`planned`, or the type of the problem: `infeasible`, `solver-failed`, …")
    plan_id: str | None = Field(description="Of its plan; the same for requests that ask for the same.")
    problem_sha256: str = Field(description="Hash of request, cell and profile.")
    trajectory_sha256: str | None = Field(description="Hash of the plan's samples as they are stored.")
    release_time_s: float | None = Field(description="[s]")
    duration_s: float | None = Field(description="Duration of the motion [s].")
    release_speed_m_s: float | None = Field(description="Speed of the object at the release [m/s].")
    hit_probability: float | None = Field(description="[-]")
    planning_time_s: float = Field(description="What its planner took [s].")
    refusal: dict[str, Any] | None = Field(
        description="`name`, `detail`, and what a problem of this type has: `violations` and `nearest`, or `errors`."
    )


class BatchResultList(BaseModel):
    """A page of results, in the order of their requests. Those of a running batch have gaps, which fill."""

    results: list[BatchResult]
    next_cursor: int | None = Field(description="Pass as `cursor` for the next page; null on the last page so far.")


BATCH_EXAMPLES = {
    "grid": {
        "summary": "A template and a grid: two releases with three limits",
        "value": {
            "template": PLAN_EXAMPLES["joint"]["value"],
            "grid": {"release.positions[0]": {"values": [0.4, 0.5]}, "limits.jerk": [300.0, 400.0, 50.0]},
        },
    },
    "requests": {
        "summary": "A list of requests",
        "value": {"requests": [PLAN_EXAMPLES["joint"]["value"], PLAN_EXAMPLES["point"]["value"]]},
    },
}
