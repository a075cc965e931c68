"""Bodies of `/jobs`: picks and throws one after another, how far they are, and what became of every object."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from pydantic import BaseModel, Field, PlainValidator

from api.schemas.requests import model_of
from jobs.cycles import JOB_REQUEST
from planner.request import read_request

JobRequest = model_of(JOB_REQUEST)
JobRequestBody = Annotated[
    dict[str, Any], PlainValidator(partial(read_request, record=JOB_REQUEST), json_schema_input_type=JobRequest)
]


class ShiftRecord(BaseModel):
    """The statistics of a job so far."""

    objects: dict[str, int] = Field(description="Objects by what became of them; see `result` of the results.")
    thrown: int = Field(description="Objects that were let go.")
    landings_seen: int = Field(description="Of these, landings that were observed or reported.")
    hits: int = Field(description="Of these, landings within the room of a hit: of the bin, or of the tolerance.")
    hit_share: float | None = Field(description="Hits of the landings seen [-].")
    hit_interval: list[float] | None = Field(description="Its 95 % interval by Wilson [-, -].")
    misses: dict[str, int] = Field(description="Objects that did not hit, by cause.")
    cycles_per_hour: float | None = Field(
        description="Throws from the first motion to the end of the last, pauses too [1/h]."
    )
    cycle_time_s: float | None = Field(
        description="Median from a throw's request to the arm's rest at the next pick [s]."
    )


class CurrentMotion(BaseModel):
    """The motion that runs."""

    kind: str = Field(description="approach or throw.")
    pick: int | None = Field(description="That the throw starts at; null of an approach.")
    next_pick: int | None = Field(description="Where it ends; null: at home.")
    target: int | None = Field(description="Number of the target.")
    attempt: int = Field(description="Of the pick, counted from 1.")
    execution_id: str


class JobHead(BaseModel):
    """A job without its record."""

    id: str
    created_at: str = Field(description="UTC, ISO 8601.")
    created_by: str
    cell: str
    state: str = Field(description="queued, running, paused or finished.")
    outcome: str | None = Field(description="completed, cancelled, or stopped: that can be resumed.")
    reason: str | None = Field(description="Why it stopped.")
    total: int = Field(description="Number of picks.")
    pause_requested: bool
    cancel_requested: bool
    started_at: str | None
    finished_at: str | None


class JobAnswer(JobHead):
    """A job, how far it is, and its record."""

    done: int = Field(description="Picks that are done: thrown, or put aside.")
    current: CurrentMotion | None = Field(description="null: the arm stands.")
    record: ShiftRecord


class JobList(BaseModel):
    """A page of jobs, newest first."""

    jobs: list[JobHead]
    next_cursor: str | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


class ObjectResult(BaseModel):
    """What became of one object."""

    pick: int = Field(description="Number of its pick, counted from 0.")
    object: str | None = Field(description="As the request names it.")
    result: str = Field(
        description="waiting; moving; hit, miss, or thrown where nobody saw the landing; missed_grip; not_planned: no "
        "motion was found; kept: still in the gripper; dropped on the way; unknown: in the gripper, or thrown."
    )
    object_at: str | None = Field(description="Where it is as far as known, in words; null while it moves.")
    reason: str | None = Field(description="Of the execution, or of the planner's refusal.")
    attempts: int = Field(description="Motions that began at its pick.")
    target: int | None = Field(description="Number of the target it was thrown at.")
    turn: int | None = Field(
        description="Counts the throws at targets; a target that gets another object keeps its turn."
    )
    outcome: str | None = Field(description="Of the execution.")
    plan_id: str | None
    execution_id: str | None
    landing_x_m: float | None = Field(description="Where it was seen to land [m].")
    landing_y_m: float | None = Field(description="[m]")
    landing_z_m: float | None = Field(description="[m]")
    error_m: float | None = Field(description="Horizontal distance from the target [m].")
    asked_at: str | None = Field(description="When its execution was asked for. UTC, ISO 8601.")
    ended_at: str | None


class ObjectResultList(BaseModel):
    """A page of results, in the order of the picks."""

    results: list[ObjectResult]
    next_cursor: int | None = Field(description="Pass as `cursor` for the next page; null on the last page.")


_DOWN = [3.141592653589793, 0.0, 0.0]
_BIN = {
    "kind": "target",
    "position": [1.1, -0.3, 0.0],
    "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
}
JOB_EXAMPLES = {
    "list": {
        "summary": "Two objects into a bin",
        "value": {
            "picks": [
                {"pose": {"position": [0.45, 0.2, 0.1], "rotation_vector": _DOWN}, "object": "ball 1"},
                {"pose": {"position": [0.45, 0.3, 0.1], "rotation_vector": _DOWN}, "object": "ball 2"},
            ],
            "targets": [_BIN],
            "policy": {"missed_grip": "retry", "missed_throw": "retry", "attempts": 2},
        },
    },
    "grid": {
        "summary": "A tray of four, at two points in turn",
        "value": {
            "picks": {
                "grid": {
                    "corner": {"position": [0.4, 0.2, 0.1], "rotation_vector": _DOWN},
                    "along_m": [0.0, 0.08, 0.0],
                    "across_m": [0.08, 0.0, 0.0],
                    "columns": 2,
                    "rows": 2,
                }
            },
            "targets": [
                {"kind": "target", "position": [1.2, 0.3, 0.0]},
                {"kind": "target", "position": [1.1, -0.3, 0.0]},
            ],
        },
    },
}
