"""Events of an execution as server-sent events, while they are written."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from api.dependencies import AnyCaller, ServiceDep
from api.http import event_stream, event_stream_answer, problem_answers
from api.routes.executions import ExecutionId, find_execution
from api.schemas import StateEvent, TelemetryEvent

router = APIRouter(tags=["executions"])

EVENT_STREAM_ANSWER = event_stream_answer(
    "State changes and telemetry; ends with the execution.", state=StateEvent, telemetry=TelemetryEvent
)


@router.get(
    "/executions/{id}/events",
    summary="Watch an execution",
    response_class=StreamingResponse,
    responses={200: EVENT_STREAM_ANSWER, **problem_answers("not-found", "invalid-request")},
)
async def watch_execution(
    id: ExecutionId,
    service: ServiceDep,
    caller: AnyCaller,
    last_event_id: Annotated[int, Header(ge=0, le=2**62, description="Resume after this event.")] = 0,
) -> StreamingResponse:
    """Streams state changes and telemetry (20 Hz or more) as server-sent events until the execution has ended."""
    row = await run_in_threadpool(find_execution, service, id)
    return event_stream(service.feeds.listen(row.id, last_event_id))
