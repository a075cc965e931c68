"""Request and response bodies as pydantic models; OpenAPI is generated from them."""

from api.schemas.experiments import (
    EXPERIMENT_EXAMPLES,
    ExperimentAnswer,
    ExperimentHead,
    ExperimentList,
    ExperimentRequest,
)
from api.schemas.landings import LANDING_EXAMPLES, LandingAnswer, LandingList, LandingRequest
from api.schemas.requests import EXECUTE_EXAMPLES, PLAN_EXAMPLES, ExecuteRequest, PlanRequest
from api.schemas.responses import (
    Acknowledged,
    CellList,
    CellState,
    ExecutionAnswer,
    ExecutionList,
    PlanAnswer,
    PlanList,
    Readiness,
    TrajectoryAnswer,
    iso_time,
)

__all__ = [
    "EXECUTE_EXAMPLES",
    "EXPERIMENT_EXAMPLES",
    "LANDING_EXAMPLES",
    "PLAN_EXAMPLES",
    "Acknowledged",
    "CellList",
    "CellState",
    "ExecuteRequest",
    "ExecutionAnswer",
    "ExecutionList",
    "ExperimentAnswer",
    "ExperimentHead",
    "ExperimentList",
    "ExperimentRequest",
    "LandingAnswer",
    "LandingList",
    "LandingRequest",
    "PlanAnswer",
    "PlanList",
    "PlanRequest",
    "Readiness",
    "TrajectoryAnswer",
    "iso_time",
]
