"""Request and response bodies as pydantic models; OpenAPI is generated from them."""

from api.schemas.experiments import (
    EXPERIMENT_EXAMPLES,
    ExperimentAnswer,
    ExperimentHead,
    ExperimentList,
    ExperimentRequest,
)
from api.schemas.landings import LANDING_EXAMPLES, LandingAnswer, LandingList, LandingRequest
from api.schemas.profiles import Adoption, ProfileAnswer, ProfileList
from api.schemas.requests import EXECUTE_EXAMPLES, PLAN_EXAMPLES, ExecuteRequest, PlanRequest
from api.schemas.responses import (
    Acknowledged,
    CellHistory,
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
from api.schemas.timing import TimingAnswer

__all__ = [
    "EXECUTE_EXAMPLES",
    "EXPERIMENT_EXAMPLES",
    "LANDING_EXAMPLES",
    "PLAN_EXAMPLES",
    "Acknowledged",
    "Adoption",
    "CellHistory",
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
    "ProfileAnswer",
    "ProfileList",
    "Readiness",
    "TimingAnswer",
    "TrajectoryAnswer",
    "iso_time",
]
