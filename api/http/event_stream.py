"""Answers that are streams of server-sent events."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

from fastapi.responses import StreamingResponse

MEDIA = "text/event-stream"


def event_stream(chunks: AsyncIterator[bytes]) -> StreamingResponse:
    """Returns an answer that sends events as they come, through proxies that would keep them back."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(chunks, 200, headers, MEDIA)


def event_stream_answer(description: str) -> dict[str, Any]:
    """Returns the description of such an answer for OpenAPI."""
    return {"content": {MEDIA: {"schema": {"type": "string"}}}, "description": description}
