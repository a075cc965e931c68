"""Answers that are streams of server-sent events."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import Any

from fastapi.responses import StreamingResponse
from pydantic import BaseModel

EVENTS = "text/event-stream"
REF = "#/components/schemas/"


def event_stream(chunks: AsyncGenerator[bytes], is_allowed: Callable[[], bool]) -> StreamingResponse:
    """Returns an answer that sends events as they come, through proxies that would keep them back.

    Args:
        chunks: the events; comments in silence.
        is_allowed: asked before each is sent; false ends the stream.
    """
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_while_allowed(chunks, is_allowed), 200, headers, EVENTS)


async def _while_allowed(chunks: AsyncGenerator[bytes], is_allowed: Callable[[], bool]) -> AsyncGenerator[bytes]:
    async with aclosing(chunks):
        async for chunk in chunks:
            if not is_allowed():  # its token was revoked, or has expired
                return
            yield chunk


def event_stream_answer(description: str, **events: type[BaseModel]) -> dict[str, Any]:
    """Returns the description of such an answer for OpenAPI: what each event is (`itemSchema`).

    `itemSchema` is OpenAPI 3.2's, which FastAPI writes too. A `schema` beside it would be that of the list of events;
    readers of 3.1 do without: the text is of no type that a schema could check.

    Args:
        description: of the whole answer.
        events: model of the data of each kind of event.
    """
    kinds = [_event(kind, model) for kind, model in events.items()]
    return {"content": {EVENTS: {"itemSchema": {"oneOf": kinds}}}, "description": description}


def _event(kind: str, model: type[BaseModel]) -> dict[str, Any]:
    """Returns the schema of one kind of event, as a reader of the stream has it."""
    data = {
        "type": "string",
        "contentMediaType": "application/json",
        "contentSchema": {"$ref": REF + model.__name__},
    }
    properties = {"event": {"const": kind}, "id": {"type": "string"}, "data": data}
    return {"type": "object", "properties": properties, "required": list(properties)}
