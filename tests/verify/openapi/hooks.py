"""What schemathesis does beside its own checks: it keeps plans short, and compares the schema with the models."""

from __future__ import annotations

from typing import Any

import requests
import schemathesis
from pydantic import BaseModel, ValidationError

from api.schemas import (
    BatchRequest,
    ExecuteRequest,
    ExperimentRequest,
    JobRequest,
    LandingRequest,
    MapBody,
    ObservationRequest,
    PlanRequest,
    RetargetRequest,
    TrackedTargetRequest,
)
from planner.errors import InvalidProblem
from planner.problem import TIME_LIMIT_MAX_S

PLAN_S = 0.5  # [s] of a search: this is about the interface, not the planner
MODELS: dict[str, type[BaseModel]] = {
    "make_plan": PlanRequest,
    "retarget_motion": RetargetRequest,
    "execute_plan": ExecuteRequest,
    "report_landing": LandingRequest,
    "begin_experiment": ExperimentRequest,
    "make_batch": BatchRequest,
    "make_job": JobRequest,
    "make_cell_map": MapBody,
    "track_target": TrackedTargetRequest,
    "observe_target": ObservationRequest,
}
KILLED = "the planner process was ended"  # in the detail of a problem
TIMEOUT_S = 600.0  # [s] of a request that is sent again
NOT_OF_THE_BODY = ("infeasible", "idempotency-conflict")  # refusals of bodies that are in order


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Bounds the search of a plan; a time limit that is refused stays as it is."""
    if case.path == "/plan" and isinstance(case.body, dict):
        given = case.body.setdefault("time_limit_s", PLAN_S)
        is_number = isinstance(given, int | float) and not isinstance(given, bool)
        if is_number and PLAN_S < given <= TIME_LIMIT_MAX_S:
            case.body["time_limit_s"] = PLAN_S


@schemathesis.check
def schema_and_models_agree(context: Any, response: Any, case: Any) -> None:
    """What the schema allows, the model of the body allows too, but for rules over several fields."""
    meta = case.meta
    if meta is None or not meta.generation.mode.is_positive or response.status_code != 422:
        return
    problem = response.json()["type"].rpartition("/")[2]
    model = MODELS.get(case.operation.definition.raw.get("operationId", ""))
    if problem in NOT_OF_THE_BODY:
        return
    assert model is not None, f"a valid request was refused: {response.text}"
    try:
        model.model_validate(case.body)
    except InvalidProblem:  # an axis of a grid: its bounds and its step belong together
        assert problem == "invalid-request", response.text
    except ValidationError as error:
        wrong = [found for found in error.errors() if found["type"] != "value_error"]
        assert not wrong, f"the schema allows what the model refuses: {wrong}"


@schemathesis.check
def no_other_failure(context: Any, response: Any, case: Any) -> None:
    """Where the server may answer 503, it does so because the time that it was given is over.

    A planner process that does not end a search is killed 20 s later. Beside twenty busy processes that happens to any
    request once; to one that does not end it happens again.
    """
    if response.status_code == 503 and KILLED in response.text:
        response = requests.Session().send(response.request, timeout=TIMEOUT_S)
    if response.status_code == 503:
        problem = response.json()
        assert problem["type"] == "/problems/solver-failed", response.text
        assert problem["solver"]["status"] == "time_limit", response.text
