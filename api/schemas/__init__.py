"""Request and response bodies as pydantic models; OpenAPI is generated from them."""

from api.schemas.batches import BATCH_EXAMPLES, BatchAnswer, BatchList, BatchRequest, BatchResultList
from api.schemas.cell_states import (
    ROBOT_EXAMPLES,
    Acknowledged,
    CellHistory,
    CellList,
    CellState,
    RobotActionAnswer,
    RobotActionRequest,
)
from api.schemas.execution_records import ExecutionAnswer, ExecutionList, Outcome, StateEvent, TelemetryEvent
from api.schemas.experiments import (
    EXPERIMENT_EXAMPLES,
    ExperimentAnswer,
    ExperimentHead,
    ExperimentList,
    ExperimentRequest,
)
from api.schemas.landings import LANDING_EXAMPLES, LandingAnswer, LandingList, LandingRequest
from api.schemas.maps import MAP_EXAMPLES, MapAnswer, MapBody, MapHead
from api.schemas.profiles import Adoption, CalibrationMoves, ProfileAnswer, ProfileList
from api.schemas.requests import (
    EXECUTE_EXAMPLES,
    ID_PATTERN,
    PLAN_EXAMPLES,
    REPLACE_EXAMPLES,
    UUID_PATTERN,
    ExecuteRequest,
    PlanRequest,
    PlanRequestBody,
    ReplaceRequest,
)
from api.schemas.responses import (
    Health,
    PlanAnswer,
    PlanList,
    PlanPreview,
    PlanProgress,
    Readiness,
    TrajectoryAnswer,
    iso_time,
)
from api.schemas.scene import CellModel, PlanCurves
from api.schemas.timing import TimingAnswer

__all__ = [
    "BATCH_EXAMPLES",
    "EXECUTE_EXAMPLES",
    "REPLACE_EXAMPLES",
    "EXPERIMENT_EXAMPLES",
    "ID_PATTERN",
    "LANDING_EXAMPLES",
    "MAP_EXAMPLES",
    "PLAN_EXAMPLES",
    "ROBOT_EXAMPLES",
    "UUID_PATTERN",
    "Acknowledged",
    "Adoption",
    "BatchAnswer",
    "BatchList",
    "BatchRequest",
    "BatchResultList",
    "CalibrationMoves",
    "CellHistory",
    "CellList",
    "CellModel",
    "CellState",
    "ExecuteRequest",
    "ReplaceRequest",
    "ExecutionAnswer",
    "ExecutionList",
    "ExperimentAnswer",
    "ExperimentHead",
    "ExperimentList",
    "ExperimentRequest",
    "Health",
    "LandingAnswer",
    "LandingList",
    "LandingRequest",
    "MapAnswer",
    "MapBody",
    "MapHead",
    "Outcome",
    "PlanAnswer",
    "PlanCurves",
    "PlanList",
    "PlanPreview",
    "PlanProgress",
    "PlanRequest",
    "PlanRequestBody",
    "ProfileAnswer",
    "ProfileList",
    "Readiness",
    "RobotActionAnswer",
    "RobotActionRequest",
    "StateEvent",
    "TelemetryEvent",
    "TimingAnswer",
    "TrajectoryAnswer",
    "iso_time",
]
