"""Answers that are streams of server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

from fastapi.responses import StreamingResponse
from pydantic import BaseModel

MEDIA = "text/event-stream"
REF = "#/components/schemas/"


def event_stream(chunks: AsyncIterator[bytes]) -> StreamingResponse:
    """Returns an answer that sends events as they come, through proxies that would keep them back."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(chunks, 200, headers, MEDIA)


def event_stream_answer(description: str, **events: type[BaseModel]) -> dict[str, Any]:
    """Returns the description of such an answer for OpenAPI: its text, and what each event is (`itemSchema`).

    `itemSchema` is OpenAPI 3.2's, which FastAPI writes too; readers of 3.1 take the text alone.

    Args:
        description: of the whole answer.
        events: model of the data of each kind of event.
    """
    kinds = [_event(kind, model) for kind, model in events.items()]
    return {"content": {MEDIA: {"schema": {"type": "string"}, "itemSchema": {"oneOf": kinds}}},
            "description": description}  # fmt: skip


def _event(kind: str, model: type[BaseModel]) -> dict[str, Any]:
    """Returns the schema of one kind of event, as a reader of the stream has it."""
    data = {
        "type": "string",
        "contentMediaType": "application/json",
        "contentSchema": {"$ref": REF + model.__name__},
    }
    properties = {"event": {"const": kind}, "id": {"type": "string"}, "data": data}
    return {"type": "object", "properties": properties, "required": list(properties)}
