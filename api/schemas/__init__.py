"""Request and response bodies as pydantic models; OpenAPI is generated from them."""

from api.schemas.cells import Acknowledged, CellList, CellState, CellSummary, ExecutorAnswer, Readiness
from api.schemas.executions import ExecutionAnswer, ExecutionList
from api.schemas.plans import PlanAnswer, PlanList, TrajectoryAnswer
from api.schemas.quantities import AnswerModel, iso_time
from api.schemas.requests import EXECUTE_EXAMPLES, PLAN_EXAMPLES, ExecuteRequest, PlanRequest

__all__ = [
    "EXECUTE_EXAMPLES",
    "PLAN_EXAMPLES",
    "Acknowledged",
    "AnswerModel",
    "CellList",
    "CellState",
    "CellSummary",
    "ExecuteRequest",
    "ExecutionAnswer",
    "ExecutionList",
    "ExecutorAnswer",
    "PlanAnswer",
    "PlanList",
    "PlanRequest",
    "Readiness",
    "TrajectoryAnswer",
    "iso_time",
]
